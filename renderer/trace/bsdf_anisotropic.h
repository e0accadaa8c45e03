// SPDX-License-Identifier: Apache-2.0
// Directional albedos of GGX with two alphas (bsdf_albedo.h for one), from tables over roughness, anisotropy, cosine and azimuth (and
// index) that bench/bsdf_anisotropic_tables.cpp integrated. Linear between the nodes of bsdf_anisotropic_grid.h. Nodes are fitted
// so that interpolation is below the truth; that program prints the distances.
#pragma once

#include "trace/bsdf_albedo.h"

namespace gobo {
inline namespace trace {

/// GGX reflection. Directions are local (x along the larger alpha).
class AnisotropicAlbedo {
 public:
  AnisotropicAlbedo() = default;
  AnisotropicAlbedo(float roughness, float anisotropy);
  ReflectionAlbedo::Value at(const Vec3& direction) const;
  float deficitMean = 0, schlickMean = 1.0f / 21.0f;

 private:
  float ax_ = 1, ay_ = 1, fR_ = 0, fS_ = 0;
  int r_ = 0, s_ = 0;
};

/// Rough dielectric, both lobes together, for both sides of one interface. ior 1..3 (clamped).
class AnisotropicGlassAlbedo {
 public:
  AnisotropicGlassAlbedo() = default;
  AnisotropicGlassAlbedo(float roughness, float anisotropy, float ior);
  float deficit(const Vec3& direction, bool inside) const;  ///< inside: in the denser medium
  float mean[2] = {0, 0};                                   ///< outside, inside

 private:
  float ior_ = 1.5f, ax_ = 1, fR_ = 0, fS_ = 0, fIor_ = 0;
  int r_ = 0, s_ = 0, i_ = 0;
};

}  // namespace trace
}  // namespace gobo
