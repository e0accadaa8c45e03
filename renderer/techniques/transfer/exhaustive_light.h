// SPDX-License-Identifier: Apache-2.0
// Direct light of an environment map by all of it: some directions in every texel, each with its own shadow ray. The reference of the thesis of 2007 on hybrid
// environment light (digest of seed 004, C7: a map of 6 x 64 x 64 and 4 x 4 directions a texel, 393 216 rays a pixel). Nothing is drawn: a texel's directions
// are the middles of equal steps of azimuth and polar angle, each weighted by the solid angle that it stands for, in double, so that it has no noise and two
// runs have the same bits. What it shares with the path tracer is the ray, the map's look-up and the BSDF; sampling, densities and their weights are not in it:
// an error there shows as a difference that does not fall with samples. Its own error is that of midpoints (below half a sub-texel where shadows
// or horizons cut one), the same for all places, so it is no better than texels are fine. For small pictures and maps; renders ask the path tracer.
// Left out: bounces, alpha below 1 in part (as shadow rays see it, trace/accel.h), light that glass lets through (it blocks), mirrors (no lobe to evaluate).
#pragma once

#include <cstdint>
#include <vector>

#include "base/image.h"
#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"
#include "terms/surface_reader.h"

namespace gobo::transfer {

/// A map's directions. Immutable; any thread. 24 bytes a direction that has light.
class ExhaustiveSky {
 public:
  static constexpr size_t kMost = size_t(1) << 25;  ///< directions
  /// In world axes: the map as it is turned, times `scale` (a light's power). `across` x `across` directions a texel, 1 .. 16. Errors: InvalidArgument where
  /// they are out of range or more than kMost.
  static Result<ExhaustiveSky> of(const Environment& map, int across, const Vec3& scale = Vec3(1.0f));

  struct Direction {
    Vec3 towards;     ///< unit
    Vec3 irradiance;  ///< radiance x solid angle, W/m^2 on a plane facing it; never 0
  };
  const std::vector<Direction>& directions() const { return directions_; }  ///< texel by texel

 private:
  std::vector<Direction> directions_;
};

/// Mean over a view's samples, W/m^2/sr: the parts of bsdfEval.
struct ExhaustivePicture {
  Image diffuse, specular;  ///< width x height x 3; empty where `stop` fired first
  uint64_t rays = 0;
};
inline constexpr Facet kExhaustiveFacets = kAccelFacets | kSurfaceFacets;
/// `scene` allows kExhaustiveFacets; `gbuffer` is its view from `camera`. O(samples x directions).
ExhaustivePicture exhaustivePicture(const ExhaustiveSky& sky, const SceneView& scene, const AccelPtr& accel, const Term& gbuffer, const Camera& camera,
                                    const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::transfer
