// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf.h"

#include <algorithm>

#include "trace/bsdf_base_impl.h"
#include "trace/bsdf_layers.h"
#include "trace/bsdf_lobe_terms.h"

namespace gobo {
inline namespace trace {
namespace {

/// One look at a material from `o`: base, layers, and the geometric plane where the shading normal is another.
struct Look {
  const BsdfParams& p;
  const Vec3& o;
  BaseLobes base;
  bool layered, tilted;
  Look(const BsdfParams& p, const Vec3& o) : p(p), o(o), base(p), layered(Layers::any(p)), tilted(p.facing != Vec3(0, 0, 1)) { base.view(o); }

  Vec3 mirrored(const Vec3& i) const { return i - (2.0f * glm::dot(i, p.facing)) * p.facing; }
  /// Light of a pair; `layers` as the material has them. Layers are specular, but for what they let through.
  void evaluate(const Layers* layers, const Vec3& i, BsdfValue& value, float& pdf) const {
    if (!tilted) return upright(layers, i, value, pdf, false);
    pdf = 0.0f;
    const float side = glm::dot(i, p.facing);
    if (!(side * i.z > 0.0f)) return;  // its light is at mirrored(i)
    upright(layers, i, value, pdf, false);
    const Vec3 m = mirrored(i);
    if (!(side * m.z > 0.0f)) return;
    BsdfValue folded;
    float density;
    upright(layers, m, folded, density, true);
    value.specular += folded.specular;
    pdf += density;
  }
  /// A drawn direction on its lobe's side of the plane. False: lost.
  bool turn(BsdfSample& s) const {
    if (!tilted || (glm::dot(s.wi, p.facing) < 0.0f) == s.transmitted) return true;
    if (!s.specularLobe) return false;
    s.wi = glm::normalize(mirrored(s.wi));
    return s.folded = true;
  }

 private:
  void upright(const Layers* layers, const Vec3& i, BsdfValue& value, float& pdf, bool specularOnly) const {
    base.evaluate(o, i, value, pdf, specularOnly);
    if (!layers) return;
    const float passed = layers->passed(i);
    value.diffuse *= passed;
    value.specular *= passed;
    pdf *= layers->baseP;
    if (i.z > 0.0f) layers->evaluate(o, i, value, pdf);
  }
};

/// Nothing but Lambert: half of a usual scene's surfaces.
inline bool isLambert(const BsdfParams& p) {
  return !(p.metallic > 0.0f) && !(p.specular > 0.0f) && !(p.transmission > 0.0f) && !(p.diffuseTransmission > 0.0f) && !(p.iridescence > 0.0f) &&
         !Layers::any(p);
}
inline Vec3 lambertAlbedo(const BsdfParams& p) { return Vec3(clamp01(p.albedo.x), clamp01(p.albedo.y), clamp01(p.albedo.z)); }

}  // namespace

BsdfValue bsdfEvalPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi, float& pdf) {
  BsdfValue value;
  pdf = 0.0f;
  if (!(wo.z > 0.0f) || !(std::fabs(wi.z) > 0.0f)) return value;
  if (isLambert(p)) {
    const Vec3 albedo = lambertAlbedo(p);
    if (!(wi.z > 0.0f) || !(maxComponent(albedo) > 0.0f)) return value;
    pdf = kInvPi * wi.z;
    value.diffuse = albedo * pdf;
    return value;
  }
  const Look look(p, wo);
  if (!look.layered) {
    look.evaluate(nullptr, wi, value, pdf);
    return value;
  }
  Layers layers(p, wo);
  layers.choose(look.base.energy);
  look.evaluate(&layers, wi, value, pdf);
  return value;
}

BsdfValue bsdfEval(const BsdfParams& p, const Vec3& wo, const Vec3& wi) {
  float pdf;
  return bsdfEvalPdf(p, wo, wi, pdf);
}

void bsdfDiffuse(const BsdfParams& p, const Vec3& wo, std::span<const float> cosines, std::span<Vec3> out) {
  std::fill(out.begin(), out.end(), Vec3(0.0f));
  if (!(wo.z > 0.0f)) return;
  BaseLobes base(p);
  base.view(wo);
  if (!(base.upP > 0.0f)) return;
  for (size_t k = 0; k < cosines.size(); ++k)
    if (cosines[k] > 0.0f) out[k] = base.diffuse(true, cosines[k], base.lookUp(Vec3(0, 0, cosines[k])));
}

float bsdfPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi) {
  float pdf;
  bsdfEvalPdf(p, wo, wi, pdf);
  return pdf;
}

bool bsdfSample(const BsdfParams& p, const Vec3& wo, float uLobe, const Vec2& u, BsdfSample& out) {
  out = {};
  if (!(wo.z > 0.0f)) return false;
  if (isLambert(p)) {
    out.wi = sampleCosine(u);
    out.weight = lambertAlbedo(p);
    out.pdf = kInvPi * out.wi.z;
    return out.wi.z > 0.0f && maxComponent(out.weight) > 0.0f;
  }
  const Look look(p, wo);
  const BaseLobes& base = look.base;
  BsdfValue value;
  if (!look.layered) {
    if (!(base.energy > 0.0f) || !base.sample(wo, uLobe, u, out)) return false;
    if (!look.turn(out)) return false;
    if (out.delta) return isFinite(out.weight);
    look.evaluate(nullptr, out.wi, value, out.pdf);
    out.weight = value.sum() / out.pdf;
  } else {
    Layers layers(p, wo);
    layers.choose(base.energy);
    const float above = layers.coatP + layers.sheenP;
    if (uLobe < above || !(layers.baseP > 0.0f)) {
      if (!layers.sample(uLobe, u, out) || !look.turn(out)) return false;
      if (out.delta) return maxComponent(out.weight) > 0.0f;
    } else {
      if (!base.sample(wo, clamp01((uLobe - above) / layers.baseP), u, out)) return false;
      if (out.delta) {
        out.weight *= layers.passed(out.wi) / layers.baseP;
        return look.turn(out) && isFinite(out.weight) && maxComponent(out.weight) > 0.0f;
      }
    }
    if (!look.turn(out)) return false;
    look.evaluate(&layers, out.wi, value, out.pdf);
    out.weight = value.sum() / out.pdf;
  }
  return out.pdf > 0.0f && isFinite(out.weight) && maxComponent(out.weight) > 0.0f;
}

float bsdfFluxScale(const BsdfParams& p, const BsdfSample& s) {
  if (!s.delta || !s.transmitted) return 1.0f;
  const BaseLobes base(p);
  return base.glass > 0.0f && !base.thin ? base.eta * base.eta : 1.0f;
}

Vec3 bsdfStraight(const BsdfParams& p, const Vec3& wo) {
  if (!(wo.z > 0.0f) || !(p.transmission > 0.0f) || p.metallic >= 1.0f) return Vec3(0.0f);
  const BaseLobes base(p);
  Vec3 through = base.pass * base.albedo;
  if (base.smooth && base.thin && base.glass > 0.0f) {
    Vec3 reflected, passed;
    base.split(wo.z, reflected, passed);
    through += passed;
  }
  if (!(maxComponent(through) > 0.0f) || !isFinite(through)) return Vec3(0.0f);
  return Layers::any(p) ? through * Layers(p, wo).passed(-wo) : through;
}

LobeAlbedos bsdfLobeAlbedos(const BsdfParams& p, float mu) {
  LobeAlbedos out;
  if (!(mu > 0.0f)) return out;
  if (isLambert(p)) {
    out.diffuse = lambertAlbedo(p);
    return out;
  }
  BaseLobes base(p);
  base.view(Vec3(std::sqrt(clamp01(1.0f - mu * mu)), 0.0f, minOf(mu, 1.0f)));
  const ReflectionAlbedo::Value a = base.smooth ? ReflectionAlbedo::Value{0.0f, schlickWeight(mu)} : base.ao;
  // Schlick's Fresnel between f0 and f90 over the microfacets, and what leaves them after further bounces.
  const auto reflected = [&](const Vec3& f0, float f90) { return f0 * (1.0f - a.deficit) + (Vec3(f90) - f0) * a.schlick; };
  out.specular = base.metal * reflected(base.albedo, 1.0f) + base.opaque * reflected(base.f0, base.f90);
  if (base.kernel > 0.0f) out.specular += base.msUp * a.deficit;
  if (base.hasDiffuse()) out.diffuse = base.albedo * (base.opaque * base.diffuseO * (1.0f - base.through));
  return out;
}

LobeTerms bsdfLobeTerms(const BsdfParams& p, float mu) {
  LobeTerms out;
  if (!(mu > 0.0f)) return out;
  if (isLambert(p)) {
    out.diffuse = lambertAlbedo(p);
    return out;
  }
  BaseLobes base(p);
  base.view(Vec3(std::sqrt(clamp01(1.0f - mu * mu)), 0.0f, minOf(mu, 1.0f)));
  if (!base.smooth) {
    const Vec3 normal = base.metal * base.albedo + base.opaque * base.f0;
    out.microfacets = normal * (1.0f - base.ao.deficit);
    out.grazing = (Vec3(base.metal + base.opaque * base.f90) - normal) * base.ao.schlick;
    if (base.kernel > 0.0f) out.bounced = base.msUp * base.ao.deficit;
  }
  if (!base.hasDiffuse()) return out;
  out.diffuse = base.albedo * (base.opaque * base.diffuseO * (1.0f - base.through));
  if (!(base.diffuseNorm > 0.0f)) return out;
  out.open = (1.0f - base.f0Bound) * base.diffuseNorm;
  out.deficit = (base.f0Bound - base.msBound) * base.deficitMean * base.diffuseNorm;
  out.schlick = (base.f0Bound - base.f90Bound) * base.schlickMean * base.diffuseNorm;
  return out;
}

bool bsdfIsDelta(const BsdfParams& p) { return !BaseLobes(p).evaluable() && !Layers::evaluable(p); }

}  // namespace trace
}  // namespace gobo
