// SPDX-License-Identifier: Apache-2.0
// Mip levels and tiles of textures, and the bound on their memory. A loader calls finishTextures once, before Scene::seal().
// Filter: each texel of a level is the mean over its exact area of the level above (a box, with fractional weights where a
// size is odd), in linear light; colours of pictures that cut surfaces out are weighted with alpha, so that what is cut away
// does not bleed into what stays. The mean of every level is the mean of level 0 up to 8-bit rounding.
// Cost: about 25 ns a texel of level 0. Not thread-safe on one scene; deterministic.
#pragma once

#include <cstdint>

#include "base/stop.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {

/// log2 of the tile side: 4 x 4 RGBA8 texels are one cache line. Chosen by `bench/ingest_bench --layout`.
inline constexpr int kTextureTile = 2;

/// `texture` (one level of rows) with all its mip levels down to 1 x 1, tiled; `drop` finest levels are left out (at most
/// all but the last). Sealed. CHECKs levels = 1 and tile = 0.
/// `stop` is polled every row; the texture is of no use then.
Texture mipmapped(const Texture& texture, bool coverage, int drop = 0, int tile = kTextureTile, const StopToken& stop = {});

/// Replaces every texture of the scene by its mip-mapped form. When all of them together need more than `maxBytes`, the
/// largest one loses its finest level, again and again, until they fit (or all are 1 x 1); each texture that lost levels is
/// named in scene.warnings. Among equals the first loses first. Textures that share their texels go on sharing them (as far as
/// colour space and cut-outs allow): the levels of one picture are made, kept and counted once.
/// After `stop` the scene is of no use.
void finishTextures(Scene& scene, uint64_t maxBytes, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo
