// SPDX-License-Identifier: Apache-2.0
// The GGX microfacet distribution with two alphas (along local x and y), Smith's height-correlated masking (Heitz 2014), sampling of
// visible normals (Dupuy & Benyoub 2023), Fresnel and refraction. Inline: they are the inner loop of every BSDF.
// Pure functions of unit vectors in the local frame (z: shading normal). Nothing here divides by a cosine that may be 0.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace trace {

inline float pow5(float x) {
  const float x2 = x * x;
  return x2 * x2 * x;
}
/// (1 - c)^5 of Schlick's Fresnel.
inline float schlickWeight(float c) { return pow5(clamp01(1.0f - c)); }

/// Unpolarised Fresnel reflectance at a smooth dielectric; c = cosine on the viewer's side, eta = far over near index.
inline float fresnelDielectric(float c, float eta) {
  c = clamp01(c);
  const float sin2 = (1.0f - c * c) / (eta * eta);
  if (sin2 >= 1.0f) return 1.0f;  // total internal reflection
  const float ct = std::sqrt(1.0f - sin2);
  const float s = c - eta * ct, p = eta * c - ct;
  const float ds = c + eta * ct, dp = eta * c + ct;
  return clamp01(0.5f * (sqr(s / ds) + sqr(p / dp)));
}

struct Ggx {
  float x = 1, y = 1;    // alphas
  float xy = 1, yx = 1;  // x/y and y/x
  Ggx() = default;
  explicit Ggx(float alpha) : x(alpha), y(alpha) {}
  Ggx(float alphaX, float alphaY) : x(alphaX), y(alphaY), xy(alphaX / alphaY), yx(alphaY / alphaX) {}

  /// Density of normals. The sum of three squares keeps its digits for small alpha where 1 + z^2 (a^2 - 1) does not.
  float density(const Vec3& h) const {
    const float a2 = x * y, d = h.x * h.x * yx + h.y * h.y * xy + a2 * h.z * h.z;
    return a2 / (kPi * d * d);
  }
  /// |v.z| sqrt(1 + a^2 tan^2): the Smith masking of one direction is 2 |v.z| / (|v.z| + root).
  float root(const Vec3& v) const { return std::sqrt(v.z * v.z + sqr(x * v.x) + sqr(y * v.y)); }

  /// Visible normal by spherical caps.
  Vec3 sample(const Vec3& o, const Vec2& u) const {
    const Vec3 v = glm::normalize(Vec3(x * o.x, y * o.y, o.z));
    const float phi = 2.0f * kPi * u.x;
    const float z = (1.0f - u.y) * (1.0f + v.z) - v.z;
    const float r = std::sqrt(clamp01(1.0f - z * z));
    const Vec3 c = Vec3(r * std::cos(phi), r * std::sin(phi), z) + v;
    const Vec3 h(x * c.x, y * c.y, maxOf(c.z, 0.0f));
    const float l = glm::dot(h, h);
    return l > 1e-30f ? h / std::sqrt(l) : Vec3(0, 0, 1);
  }
};

/// Height-correlated G2 / |o.z|. Written as a ratio because oz * si + iz * so underflows when both directions graze.
inline float smithG2OverViewCosine(float oz, float so, float iz, float si) { return 2.0f / (oz * (si / iz) + so); }

/// Mirror reflection by microfacets without Fresnel: f cos and the density of sampling it by visible normals; c = cosine to the
/// half vector. False where there is no half vector. o.z, i.z > 0.
inline bool ggxReflection(const Ggx& g, const Vec3& o, const Vec3& i, float& f, float& pdf, float& c) {
  const Vec3 m = o + i;
  const float len2 = glm::dot(m, m);
  if (!(len2 > 0.0f)) return false;
  const Vec3 h = m / std::sqrt(len2);
  c = clamp01(glm::dot(o, h));
  const float d = g.density(h), so = g.root(o), si = g.root(i);
  f = 0.25f * d * smithG2OverViewCosine(o.z, so, i.z, si);
  pdf = d * 0.5f / (o.z + so);
  return true;
}

inline Vec3 sampleCosine(const Vec2& u) {
  const float phi = 2.0f * kPi * u.x, r = std::sqrt(u.y);
  return Vec3(r * std::cos(phi), r * std::sin(phi), std::sqrt(maxOf(1.0f - u.y, 0.0f)));
}

/// Snell; false: total internal reflection.
inline bool refract(const Vec3& o, const Vec3& h, float eta, Vec3& i) {
  const float c = glm::dot(o, h), sin2 = maxOf(1.0f - c * c, 0.0f) / (eta * eta);
  if (sin2 >= 1.0f) return false;
  i = glm::normalize(-o / eta + (c / eta - std::sqrt(1.0f - sin2)) * h);
  return true;
}

}  // namespace trace
}  // namespace gobo
