// SPDX-License-Identifier: Apache-2.0
// Reflected radiance of unshadowed surfaces by their normal alone, for one direction to the eye and one BRDF (Miller, Hoffman 1984):
//   T(n) = integral of f(w, n, o) L(w) max(n . w, 0) dw,
// in a square picture of all normals about o (normal_picture.h).
// Of a distant eye it is exact but for the look-up between texels. A picture with perspective has another o at each pixel: diffuse surfaces do not mind, and
// for others the error grows with the field of view (RadianceCache.AWideViewIsWrongForWhatShines).
#pragma once

#include <functional>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"
#include "techniques/prefilter/normal_picture.h"

namespace gobo::prefilter {

/// f(w, n, o), 1/sr; unit directions in the map's axes. Isotropic: it gets no tangent.
using IsotropicBrdf = std::function<double(const DVec3& in, const DVec3& normal, const DVec3& out)>;

class RadianceCache {
 public:
  /// `towardsEye`: o, map axes. `piece`: how wide what is summed may be, radians; the BRDF must change little over it. Null BRDF: 1, so irradiance.
  /// Empty if `stop` fired first. The same bits for any arena. Cost: side^2 x pieces x (2 ns + the BRDF's).
  RadianceCache(const Environment& map, const DVec3& towardsEye, const IsotropicBrdf& brdf, int side, double piece, const TaskArena& arena,
                const StopToken& stop = {});
  bool empty() const { return radiance_.empty(); }
  /// Bilinear between texels.
  DVec3 at(const DVec3& normal) const;
  /// Of a texel.
  DVec3 normal(int x, int y) const { return picture_.normal(x, y); }

 private:
  NormalPicture picture_;
  std::vector<DVec3> radiance_;
};

}  // namespace gobo::prefilter
