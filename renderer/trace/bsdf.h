// SPDX-License-Identifier: Apache-2.0
// The reference's surface models: glTF 2.0 metallic-roughness with the KHR_materials extensions ior, specular, transmission (into a
// volume or thin-walled), clearcoat, sheen, anisotropy, iridescence, diffuse_transmission. Formulas, sources and energies:
// docs/materials.md. Local frame: z is the shading normal on the viewer's side, x the direction of anisotropy; wo, wi point away.
//   bsdf_base     Lambert, GGX reflection and refraction with the light that bounces between microfacets, thin film
//   bsdf_layers   sheen and clearcoat above it
//   bsdf_albedo   directional albedos, tabulated: they conserve energy within 1 % (white furnace) and never exceed 1
// Radiance is carried: weights of light that enters or leaves a volume hold 1/eta^2, eta = index of wi's side over wo's.
// ior 0 or >= 1000 is infinite (everything is reflected); refraction clamps it to 1/3..3; |ior - 1| < 1e-3 passes light straight on.
// Cost of eval and sample in ns (bench/sampling_bench): Lambert 10 and 20, metal and plastic 80 to 100 and 150, rough glass 100 and 200,
// a coat adds 30, sheen 100, a film 900. All functions are pure. Densities are over solid angle; delta lobes have pdf 0 in bsdfPdf and
// f = 0 in bsdfEval. Parameters out of range are clamped (NaN to a range's end); results are finite and >= 0.
// Interpolated and mapped normals send light to the wrong side of the triangle. What a specular lobe sends there is mirrored at the
// triangle's plane (`facing`), as if the facet's flat neighbourhood reflected it a second time (microfacet-based normal mapping,
// Schuessler et al. 2017, with one flat neighbour): f'(o,i) = f(o,i) + f(o,mirrored i). It keeps the albedo of the untilted lobe exactly, is
// continuous at the horizon, and keeps densities. Diffuse light on the wrong side is lost, as in every tracer with shading normals:
// (1 - n.facing)/2 of it at most.
#pragma once

#include <span>

#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// GGX alpha below this is a mirror (delta lobe).
inline constexpr float kDeltaAlpha = 1e-3f;
/// An index closer to 1 than this refracts more narrowly than float can hold: light passes straight on.
inline constexpr float kStraightIor = 1e-3f;

struct BsdfParams {
  Vec3 albedo{0.5f};
  float metallic = 0, roughness = 1;  ///< alpha = roughness^2
  float specular = 1;                 ///< scales F0 and F90 of the dielectric, transmitting or not; 0 with metallic 0 is exact Lambert
  float ior = 1.5f;
  float transmission = 0;    ///< 1: dielectric interface, no diffuse lobe
  bool entering = true;      ///< viewer outside (geometric side); decides the relative ior and where the layers are
  bool thin = false;         ///< thin-walled: both interfaces at once, light goes straight on (KHR_materials_transmission)
  Vec3 specularColor{1.0f};  ///< scales the dielectric's F0
  float anisotropy = 0;      ///< strength along local x, 0..1
  float clearcoat = 0, clearcoatRoughness = 0;
  Vec3 clearcoatNormal{0, 0, 1};  ///< local frame
  Vec3 sheenColor{0.0f};
  float sheenRoughness = 0;
  float iridescence = 0, iridescenceIor = 1.3f, iridescenceThickness = 0;  ///< thickness in nanometres
  float diffuseTransmission = 0;
  Vec3 diffuseTransmissionColor{1.0f};  ///< of the transmitted part; albedo colours the reflected one
  Vec3 facing{0, 0, 1};                 ///< geometric normal on the viewer's side, local frame, unit; z > 0
};

struct BsdfValue {
  Vec3 diffuse{0.0f}, specular{0.0f};
  Vec3 sum() const { return diffuse + specular; }
};

struct BsdfSample {
  Vec3 wi{0.0f};
  Vec3 weight{0.0f};  ///< f |cos| / pdf over the whole sampling strategy (finite, >= 0)
  float pdf = 0;      ///< solid-angle density of wi; 0 for delta lobes
  bool delta = false, transmitted = false, specularLobe = false;
  bool straight = false;  ///< wi = -wo: thin smooth glass, or index 1
  bool folded = false;    ///< mirrored at the geometric plane
};

/// f(wo, wi) * |cos(wi)|, diffuse and specular lobes apart; delta lobes give 0.
BsdfValue bsdfEval(const BsdfParams& p, const Vec3& wo, const Vec3& wi);
/// bsdfEval's `diffuse` for directions above the surface at these cosines (0 < cosine <= 1), which is all that it depends on: an isotropic material
/// without layers (left out, as is `facing`). One look at the material for all. `out`: as many.
void bsdfDiffuse(const BsdfParams& p, const Vec3& wo, std::span<const float> cosines, std::span<Vec3> out);
/// Density with which bsdfSample gives wi (its non-delta part).
float bsdfPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi);
/// Both at once for the price of one: the same bits as bsdfEval and bsdfPdf.
BsdfValue bsdfEvalPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi, float& pdf);
/// u: lobe choice, then two for the direction; all in [0,1). False: the path ends (absorbed).
bool bsdfSample(const BsdfParams& p, const Vec3& wo, float uLobe, const Vec2& u, BsdfSample& out);
/// What makes the weight of a delta sample, drawn for radiance, the weight of flux that comes from wo and leaves along wi: the
/// squared relative index where light was refracted (Veach 1997, section 5.2), else 1.
float bsdfFluxScale(const BsdfParams& p, const BsdfSample& s);
/// Share of the light that goes straight on, the expected weight of a `straight` sample; 0 for materials that have no such lobe.
Vec3 bsdfStraight(const BsdfParams& p, const Vec3& wo);
/// True if no lobe can be evaluated (mirror or smooth glass): next-event estimation is useless.
bool bsdfIsDelta(const BsdfParams& p);

/// A material as one viewer sees it, for who asks more than once: bsdfIsDelta, bsdfEvalPdf and bsdfSample, the same bits, with what depends on material and
/// viewer alone found once (about 40 ns of each). The parameters must outlive it.
class BsdfView {
 public:
  BsdfView(const BsdfParams& p, const Vec3& wo);
  BsdfView(const BsdfView&) = delete;
  BsdfView& operator=(const BsdfView&) = delete;
  bool isDelta() const;
  BsdfValue evalPdf(const Vec3& wi, float& pdf) const;
  bool sample(float uLobe, const Vec2& u, BsdfSample& out) const;
  /// With evalPdf's value of what is drawn, which was found on the way; 0 of a delta lobe.
  bool sample(float uLobe, const Vec2& u, BsdfSample& out, BsdfValue& value) const;

 private:
  struct Look;  // bsdf.cpp
  const Look& look() const;
  const BsdfParams& p_;
  const Vec3 wo_;
  const bool lambert_, seen_;
  alignas(16) unsigned char look_[1024];  // not for Lambert; in place, because a vertex must not allocate
};

struct LobeAlbedos {
  Vec3 diffuse{0.0f}, specular{0.0f};
};
/// What an opaque isotropic material without layers, film or transmission (which are left out) reflects of uniform light of radiance 1 to a viewer at cosine
/// `mu` above it, 0 < mu <= 1. Of a diffuse lobe below a specular one it is exact under uniform light. Within the tables' error (bsdf_albedo.h).
LobeAlbedos bsdfLobeAlbedos(const BsdfParams& p, float mu);

}  // namespace trace
}  // namespace gobo
