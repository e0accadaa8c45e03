// SPDX-License-Identifier: Apache-2.0
// Shadow rays of a rectangular light that keep where on the light they went: what filters over receiver and light together need (filters/sheared), or, summed
// up by part of the light, filters by bands of light frequency (filters/multiple_axis_aligned).
#pragma once

#include <vector>

#include "scene/light.h"
#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace terms {

/// The light's own coordinates: -1..1 along both half edges.
struct LightRectangle {
  Vec3 centre{0.0f}, axis{0, -1, 0};
  Vec3 u{1, 0, 0}, v{0, 0, 1};  ///< unit, along the edges
  float halfU = 1.0f, halfV = 1.0f;
};
constexpr bool hasLightRectangle(LightKind kind) { return kind == LightKind::Rect; }
LightRectangle lightRectangle(const LightShape& shape);  ///< of a Rect (CHECKed)
void hashLightRectangle(Hasher& h, const LightRectangle& r);

/// Profiles that a light is split into (Wu, Yan, Kuznetsov, Ramamoorthi 2017, bands of light frequency; on a light that ends somewhere a profile of low
/// frequencies is one that falls to 0 at its edges). Profile j is taper j less taper j-1; taper j rises from 0 at an edge to 1 at `rims[j]` half edges from it
/// by 3z^2 - 2z^3, along both axes. rims falls; the last is 0 (the whole light), so that the profiles sum to 1.
struct LightBands {
  std::vector<float> rims;
  int count() const { return int(rims.size()); }
  /// The tapers' values at a point of the light, -1..1 along both axes; differences of neighbours are the profiles.
  float taper(int j, float u, float v) const;
  float profile(int j, float u, float v) const { return taper(j, u, v) - (j > 0 ? taper(j - 1, u, v) : 0.0f); }
  float mean(int j) const;  ///< of profile j over the light
};

struct LightSamplesSettings {
  uint32_t pilot = 4;  ///< as that of "shadow_slopes", with the plane "blocked"
  uint32_t most = 4;   ///< as that of "shadow_slopes"
  uint32_t kept = 4;   ///< samples that are kept, a multiple of 4: the largest count rounded up; more are not taken
  bool samples = true;
  LightBands bands;  ///< none: no plane of them
  uint64_t seed = 0;
  Extent extent;
  ViewPlace place;
};
/// Source "light_samples". Inputs 0: "gbuffer", 1: "shadow_slopes" with plane "blocked", 2: a term with plane n u32, rays of a view sample in all.
/// Planes V f32: what "shadow_adaptive" would give (terms/shadow_slopes.h), from the same rays. With `samples`: point f32, 4 `kept` channels: first the places
/// along u, then along v, then weights, then weight times visibility; all 0 where there is no sample. With `bands`: band f32, a channel each: sum of weight,
/// visibility and profile over the sum of weights, plus what the profile's mean over the points misses times V, so that their sum is V and each is V times the
/// profile's mean where V is 0 or 1.
NodePtr makeLightSamplesNode(const LightSamplesSettings& settings);

}  // namespace terms
}  // namespace gobo
