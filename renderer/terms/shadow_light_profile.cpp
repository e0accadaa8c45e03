// SPDX-License-Identifier: Apache-2.0
#include "terms/shadow_light_profile.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"

namespace gobo {
inline namespace terms {

ProfiledPoints::ProfiledPoints(const SceneView& view, int light, const ShadowLightProfile& profile) : points_(view, light), profile_(profile) {
  GOBO_CHECK(profile.shape == ShadowLightProfile::Uniform || view.lightShape(light).kind == LightKind::Rect);
}

bool ProfiledPoints::literal(const Vec3& p, const Vec3& N, const Vec3& Ng, const Vec2& u, LightPoint& out) const {
  Vec2 at = u;
  if (profile_.shape == ShadowLightProfile::Gaussian) {
    // Box and Muller 1958. A rectangle's points are linear in u, so that places beyond it have u beyond 0..1.
    const float r = std::sqrt(-2.0f * std::log(std::max(1.0f - u.x, 1.0e-7f))), phi = 2.0f * std::numbers::pi_v<float> * u.y;
    at = Vec2(0.5f) + 0.5f * r * Vec2(std::cos(phi), std::sin(phi));
  }
  if (!points_.sample(p, N, Ng, at, out)) return false;
  if (profile_.flat) out.weight = 1.0f;
  if (profile_.shape == ShadowLightProfile::GaussianTruncated) {
    const Vec2 half = 2.0f * u - Vec2(1.0f);
    out.weight *= std::exp(-0.5f * glm::dot(half, half));
  }
  return true;
}

}  // namespace terms
}  // namespace gobo
