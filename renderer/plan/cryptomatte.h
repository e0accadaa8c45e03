// SPDX-License-Identifier: Apache-2.0
// Cryptomatte outputs of a plan, and what their files say (Cryptomatte Specification 1.2.0): layers, manifest. docs/cryptomatte.md is the users' page.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace plan {

/// What a matte tells apart.
enum class MatteOf : uint8_t { Objects, Materials };

/// Name of each instance or material: its own as UTF-8; of those without one "material7" (its number), with "#2", "#3" ... where another has that name.
std::vector<std::string> matteNames(const Scene& scene, MatteOf of);

/// "LAYER00.R", "LAYER00.G", ... "LAYER02.A": pairs (id, coverage), two a layer.
std::vector<std::string> cryptomatteChannels(std::string_view layer);

/// The EXR attributes of a layer of these names: cryptomatte/KEY/name, hash, conversion and manifest, where KEY is made from the layer's name.
std::map<std::string, std::string> cryptomatteAttributes(const std::string& layer, const std::vector<std::string>& names);

/// "names 'a' and 'b' have one id": different names that no matte tells apart; empty: there are none.
std::string cryptomatteCollisions(const std::vector<std::string>& names);

/// Rays a pixel of a picture of so many passes (trace/sample_passes.h): as many as its samples, at least 16 and at most 256; of a shutter's slice its share of
/// them.
int cryptomatteSamples(uint32_t passes, uint32_t slices);
/// Whether a picture of more passes has mattes of more rays.
bool cryptomatteTakesMore(uint32_t passes, uint32_t slices);

}  // namespace plan
}  // namespace gobo
