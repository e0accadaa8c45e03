// SPDX-License-Identifier: Apache-2.0
// Directional albedos of the rough models, from tables that bench/bsdf_tables.cpp integrated in double precision (numbers in
// bsdf_*_data.h: the same on every machine, nothing is computed at start-up).
//   deficit(mu)  1 - albedo of single-scattering GGX with reflectance 1: what bounces between microfacets and is lost. The tables
//                hold slightly less (0.001; glass 0.004), so that interpolation never makes a surface give more than it got.
//   schlick(mu)  albedo for the reflectance (1-c)^5, slightly more than the truth; GGX with Schlick's Fresnel reflects
//                f0 (1 - deficit) + (f90 - f0) schlick.
// Axes: roughness, and t with t^2 = mu (1+s)/(mu+s), s = 2 alpha: for small alpha the deficit is a function of mu/alpha (8.6 % at mu =
// 2 alpha however small alpha is), which a grid in mu would miss. Bilinear; error (bench/bsdf_tables prints it): deficit
// -0.0015..+0.0001, schlick -0.0006..+0.0028, glass -0.011..+0.0012 for any index 1.02..2.6.
// Means are hemisphere integrals of the interpolated tables, so K(o,i) = deficit(o) deficit(i) / (pi mean) returns exactly deficit(o).
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// What the schlick tables have added to the truth (bench/bsdf_tables.cpp).
inline constexpr float kSchlickPadding = 0.001f;

/// GGX reflection of one roughness (alpha >= kDeltaAlpha).
class ReflectionAlbedo {
 public:
  ReflectionAlbedo() = default;
  ReflectionAlbedo(float alpha, float roughness);  ///< roughness = sqrt(alpha), which the caller has
  struct Value {
    float deficit = 0, schlick = 0;
  };
  Value at(float mu) const;
  /// The table's nodes at this roughness, for who looks at many cosines: deficit, and what schlick is above (1 - mu)^5 (1 - deficit) before it is clamped to
  /// 0..1. Node k is t = k / (kNodes - 1).
  static constexpr int kNodes = 32;
  void nodes(float* deficit, float* extra) const;
  float deficitMean = 0, schlickMean = 1.0f / 21.0f;

 private:
  int row_ = 0;
  float f_ = 0, s_ = 0;
};

/// Rough dielectric, both lobes together (exact Fresnel, tint 1), for both sides of one interface. ior 1..3 (clamped).
class GlassAlbedo {
 public:
  GlassAlbedo() = default;
  GlassAlbedo(float alpha, float ior);
  float deficit(float mu, bool inside) const;  ///< inside: in the denser medium
  float mean[2] = {0, 0};                      ///< outside, inside

 private:
  int base_ = 0;
  float fRow_ = 0, fIor_ = 0, s_ = 0;
};

/// Directional albedo of white sheen (Charlie), upper bound within 0.01; above 1 at grazing angles for roughness < 0.25.
float sheenAlbedo(float mu, float roughness);

}  // namespace trace
}  // namespace gobo
