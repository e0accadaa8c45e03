// SPDX-License-Identifier: Apache-2.0
// ShadowLightProfile: how the points of a rectangle are drawn and weighed for axis-aligned filtering. Literal modes of its source (Wang, UCB/EECS-2013-118, and
// its released code; filters/axis_aligned/literal.h): requests have uniform lights, weighed as their light arrives.
#pragma once

#include "base/hash.h"
#include "terms/light_points.h"

namespace gobo {
inline namespace terms {

struct ShadowLightProfile {
  enum Shape : uint8_t {
    Uniform,            ///< any light
    GaussianTruncated,  ///< rectangles: even points of weight e^-(x^2 + y^2)/2, x and y in half sides: cut at one standard deviation, as the released code has
                        ///< it
    Gaussian,           ///< rectangles: points of that Gaussian all over the rectangle's plane
  } shape = Uniform;
  bool flat = false;  ///< weights without cosines and distance: visibility as the source factors it, beside unshadowed light from the light's centre

  bool literal() const { return shape != Uniform || flat; }
};

inline void hashShadowLightProfile(Hasher& h, const ShadowLightProfile& p) {
  if (p.literal()) h.add("profile").add(int(p.shape)).add(p.flat);  // the others keep the keys that they had without
}

/// LightPoints by a profile. Reads what those read. Shapes but Uniform: Rect lights only (CHECKed). Immutable; any thread.
class ProfiledPoints {
 public:
  ProfiledPoints(const SceneView& view, int light, const ShadowLightProfile& profile);
  bool sample(const Vec3& p, const Vec3& N, const Vec3& Ng, const Vec2& u, LightPoint& out) const {
    return profile_.literal() ? literal(p, N, Ng, u, out) : points_.sample(p, N, Ng, u, out);
  }

 private:
  bool literal(const Vec3& p, const Vec3& N, const Vec3& Ng, const Vec2& u, LightPoint& out) const;
  LightPoints points_;
  ShadowLightProfile profile_;
};

}  // namespace terms
}  // namespace gobo
