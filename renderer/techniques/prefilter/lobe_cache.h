// SPDX-License-Identifier: Apache-2.0
// A radiance cache (Miller, Hoffman 1984; radiance_cache.h) of the house's own materials, whatever their colours: by shading normal n, for one direction o to
// the eye, the means of the map's radiance that trace/bsdf_lobe_terms.h makes the light of a material of. For each roughness four of them, which hold
// what that lobe sees with its horizon, its masking and the rise of Fresnel's term; one for all of them of what is Lambert. A mean, not a product: divided by
// what the kernel has of uniform light, so that uniform light is exact at every o.
//   microfacets, grazing   `samples` visible normals of GGX (Hammersley points in the plane of n and o), each with the map's mean over the solid angle
//                          that it stands for: detail finer than that is lost. Where n faces away from o, which only perspective shows, o is lifted to
//                          a cosine of 0.02.
//   deficit, schlick, E    sums over lights that stand for the map (extract_lights)
// Map axes. Sums in double.
#pragma once

#include <span>

#include "base/stop.h"
#include "base/task_arena.h"
#include "techniques/prefilter/environment_pyramid.h"
#include "techniques/prefilter/normal_picture.h"
#include "terms/texel_cells.h"

namespace gobo::prefilter {

inline constexpr int kLobeMeans = 4;  ///< microfacets, grazing, deficit, schlick
inline constexpr int kLobeSamples = 256;

/// Mean radiance by the cosine (irradiance / pi) at each texel of `picture`: texels x 3. False: stopped. Cost: 2 ns x texels x lights.
bool cosineMeans(const NormalPicture& picture, std::span<const MapLight> lights, const TaskArena& arena, const StopToken& stop, std::span<float> out);

/// The means of one roughness, whose alpha is at least kDeltaAlpha (raised to it): texels x 4 x 3. False: stopped.
/// Cost: texels x (samples x 0.1 us + lights x 10 ns): 0.8 s of one core for 128 x 128, 256 samples and 2048 lights.
bool lobeMeans(const NormalPicture& picture, const EnvironmentPyramid& map, std::span<const MapLight> lights, float roughness, int samples,
               const TaskArena& arena, const StopToken& stop, std::span<float> out);

}  // namespace gobo::prefilter
