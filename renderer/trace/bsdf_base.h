// SPDX-License-Identifier: Apache-2.0
// The base material below sheen and clearcoat, as seen from one direction: weights of its lobes and the chances of choosing them.
//   up, down    Lambert into the upper and lower hemisphere
//   bounce      the light that bounces between microfacets (Kulla & Conty 2017), up and down: K(o,i) = deficit(o) deficit(i) / (pi mean
//               deficit), reciprocal. Sampled by mu / (mu^2 + b^2), b = 2 alpha, which is a cosine lobe for alpha 1 and follows the
//               deficit to grazing angles for small alpha (cosine samples would weigh up to 600 there).
//   interface   microfacet reflection and transmission sharing one normal; smooth: two discrete directions
//   pass        straight through (index 1)
// Internal to bsdf.cpp; formulas and energies: docs/materials.md.
#pragma once

#include "trace/bsdf.h"
#include "trace/bsdf_albedo.h"
#include "trace/bsdf_anisotropic.h"
#include "trace/bsdf_ggx.h"

namespace gobo {
inline namespace trace {

struct BaseLobes {
  Ggx g;
  ReflectionAlbedo table;
  GlassAlbedo glassTable;
  AnisotropicAlbedo brushed;  // instead of these where there are two alphas
  AnisotropicGlassAlbedo brushedGlass;
  float deficitMean = 0, schlickMean = 1.0f / 21.0f, glassMean[2] = {0, 0};  // of the one in use; outside, inside
  float ior = 1, eta = 1;                                                    // eta: far over near index
  bool smooth, thin, anisotropic = false;
  bool filmed = false, plainGlass = true;  // plainGlass: exact Fresnel, neither specular nor film change it
  Vec3 albedo, throughColor{0.0f};
  float opaque, metal, glass, pass;  // shares of the four materials
  float through;                     // share of the opaque part's diffuse light that is transmitted
  Vec3 f0{0.0f};                     // dielectric, with specularColor and specular
  float f90 = 0;
  float f0Bound = 0, f90Bound = 0, msBound = 0;  // Schlick's curve above every channel of the dielectric; and of its multiple scattering
  float film = 0, filmIor, filmThickness;

  Vec3 msUp{0.0f}, msDown{0.0f};        // colour of K by ReflectionAlbedo
  Vec3 glassUp{0.0f}, glassDown{0.0f};  // glass's own K, same side and other side, without the means
  float kernel = 0;                     // 1 / (pi mean deficit)
  float diffuseNorm = 0;                // 1 / (1 - mean albedo of the dielectric)
  ReflectionAlbedo::Value ao;           // at the viewer's direction
  float glassO = 0;
  float diffuseO = 1;  // 1 - albedo of the dielectric interface

  float bounceB2 = 1, bounceLog = 1;  // b^2, log(1 + 1/b^2)

  float upP = 0, downP = 0, bounceUpP = 0, bounceDownP = 0, interfaceP = 0, passP = 0;
  float energy = 0;  // estimate of the albedo (luminance), 0: nothing is reflected or transmitted

  explicit BaseLobes(const BsdfParams& p);
  void view(const Vec3& o);

  bool hasDiffuse() const {
    return opaque > 0.0f && ((through < 1.0f && maxComponent(albedo) > 0.0f) || (through > 0.0f && maxComponent(throughColor) > 0.0f));
  }
  bool hasDielectric() const { return opaque > 0.0f && (f90 > 0.0f || filmed); }
  bool hasInterface() const { return metal > 0.0f || glass > 0.0f || hasDielectric(); }
  bool hasPass() const { return pass > 0.0f && maxComponent(albedo) > 0.0f; }
  bool evaluable() const { return hasDiffuse() || (!smooth && hasInterface()); }

  /// Reflectance and transmittance of a facet at cosine c.
  void split(float c, Vec3& reflected, Vec3& refracted) const;
  /// Everything about a pair of directions but delta lobes; pdf of this material's own strategy; without the diffuse lobes where
  /// `specularOnly`. o.z > 0.
  void evaluate(const Vec3& o, const Vec3& i, BsdfValue& value, float& pdf, bool specularOnly = false) const;
  /// Of the interface, to or from this direction.
  ReflectionAlbedo::Value lookUp(const Vec3& direction) const;
  /// The diffuse lobe alone, for light at cosine iz that the interface reflects as `ai` says.
  Vec3 diffuse(bool up, float iz, const ReflectionAlbedo::Value& ai) const;
  /// Draws out.wi; delta lobes come with their weight, others without. False: absorbed.
  bool sample(const Vec3& o, float uLobe, const Vec2& u, BsdfSample& out) const;

 private:
  void setMeansOfFilm(Vec3& metalMean, Vec3& dielectricMean);
  Vec3 metalReflected(float w, float c) const;
  Vec3 glassReflected(float c) const;
  Vec3 dielectricReflected(float w, float c) const;
  float interfaceAlbedo(const ReflectionAlbedo::Value& a) const {
    return f0Bound * (1.0f - a.deficit) + (f90Bound - f0Bound) * a.schlick + msBound * a.deficit;
  }
  float glassDeficit(const Vec3& direction, bool inside) const {
    return anisotropic ? brushedGlass.deficit(direction, inside) : glassTable.deficit(std::fabs(direction.z), inside);
  }
  bool usesTable_ = false, usesGlass_ = false;
};

}  // namespace trace
}  // namespace gobo
