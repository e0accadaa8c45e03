// SPDX-License-Identifier: Apache-2.0
// Unshadowed light of an environment by a radiance cache (Miller, Hoffman 1984; chapter 4 of the thesis): tables over all shading normals for one direction to
// the camera, its axis, which pixels look up. Exact for an orthographic camera but for the look-up; the farther a pixel is from the middle of a perspective
// one, the more its highlights lie where the axis would see them.
#pragma once

#include <vector>

#include "scene/scene.h"
#include "terms/gbuffer.h"

namespace gobo::subtractive {

inline constexpr int kCacheSide = 128;
inline constexpr int kMostRoughnesses = 16;

struct RadianceCacheSettings {
  EnvironmentPtr map;
  DVec3 towards{0.0};            ///< who looks, along the camera's axis; map axes
  std::vector<float> roughness;  ///< one lobe each, ascending; none: what is Lambert alone
  int side = kCacheSide;
  int samples = 256;  ///< of a lobe (techniques/prefilter/lobe_cache.h)
};

/// The roughnesses of the materials that instances use and that shine, at least that of kDeltaAlpha. Textured ones, and more than kMostRoughnesses, are
/// kMostRoughnesses from the lowest to the highest that may occur, evenly apart, between which light is interpolated.
std::vector<float> cachedRoughnesses(const Scene& scene);

/// World to the axes of a map that is turned.
DVec3 toMapAxes(const Vec3& world, float rotation);

/// Term "radiance_cache", domain Table: "cosine" f32 x 3 texels | "lobe0", ... f32 x 4 x 3 texels, one for each roughness. Input: environment split: of the map
/// without its peaks. Cost: 0.2 s of one core, and 0.8 s a roughness. 0.8 MB a roughness.
NodePtr makeRadianceCacheNode(const RadianceCacheSettings& settings);

/// Term "unshadowed_map", as makeUnshadowedMapNode has it: each lobe's parts (trace/bsdf_lobe_terms.h), at the viewer's own cosine, times their means in the
/// cache, bilinear in the normal and linear between two roughnesses. Inputs: G-buffer, surface, radiance cache of `cache`.
/// Uniform maps: the lobes' albedos, within 1e-5. Cost: 0.2 us a sample.
NodePtr makeCachedMapNode(const GBufferSettings& view, const RadianceCacheSettings& cache, float rotation, const Vec3& scale);

}  // namespace gobo::subtractive
