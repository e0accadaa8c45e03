// SPDX-License-Identifier: Apache-2.0
#include "trace/interior.h"

namespace gobo {
inline namespace trace {

Interior makeInterior(const Bsdf& b) {
  Interior m;
  m.ior = b.ior;
  m.g = std::fmin(std::fmax(b.scatterAnisotropy, -0.99f), 0.99f);
  for (int c = 0; c < 3; ++c) {
    // Black would be an infinite extinction, which no float holds: a millionth passes in one attenuation distance.
    if (b.attenuationDistance > 0.0f) m.sigma[c] = -std::log(std::fmin(std::fmax(b.attenuationColor[c], 1e-6f), 1.0f)) / b.attenuationDistance;
    if (!std::isfinite(m.sigma[c])) m.sigma[c] = 1e30f;
    m.albedo[c] = singleScatteringAlbedo(b.scatterAlbedo[c], m.g);
    m.absorbs = m.absorbs || m.sigma[c] > 0.0f;
    m.scatters = m.scatters || (m.sigma[c] > 0.0f && m.albedo[c] > 0.0f);
  }
  return m;
}

float singleScatteringAlbedo(float multiple, float g) {
  if (multiple >= 1.0f) return 1.0f;
  if (!(multiple > 0.0f)) return 0.0f;  // the formula's rounded constants leave 6e-6, which would make every absorbing volume scatter
  const double m = std::fmax(double(multiple), 0.0);
  const double s = 4.09712 + 4.20863 * m - std::sqrt(9.59217 + 41.6808 * m + 17.7126 * m * m);
  return clamp01(float((1.0 - s * s) / (1.0 - double(g) * s * s)));
}

float henyeyGreenstein(float c, float g) {
  const float d = 1.0f + g * g - 2.0f * g * c;
  return 0.25f * kInvPi * (1.0f - g * g) / (d * std::sqrt(maxOf(d, 1e-12f)));
}

Vec3 sampleHenyeyGreenstein(const Vec3& d, float g, const Vec2& u) {
  float c;
  if (std::fabs(g) < 1e-3f) c = 1.0f - 2.0f * u.x;
  else {
    const float q = (1.0f - g * g) / (1.0f - g + 2.0f * g * u.x);
    c = (1.0f + g * g - q * q) / (2.0f * g);
  }
  c = minOf(maxOf(c, -1.0f), 1.0f);
  const float s = std::sqrt(maxOf(1.0f - c * c, 0.0f)), phi = 2.0f * kPi * u.y;
  const Vec3 w = Frame(d).toWorld(Vec3(s * std::cos(phi), s * std::sin(phi), c));
  return w * (1.0f / std::sqrt(glm::dot(w, w)));
}

}  // namespace trace
}  // namespace gobo
