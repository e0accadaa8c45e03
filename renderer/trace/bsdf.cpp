// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf.h"

#include <algorithm>
#include <new>
#include <optional>
#include <type_traits>

#include "trace/bsdf_base_impl.h"
#include "trace/bsdf_layers.h"
#include "trace/bsdf_lobe_terms.h"

namespace gobo {
inline namespace trace {

/// One look at a material from `o`: base, layers, and the geometric plane where the shading normal is another.
struct BsdfView::Look {
  const BsdfParams& p;
  const Vec3& o;
  BaseLobes base;
  bool tilted;
  std::optional<Layers> layers;
  Look(const BsdfParams& p, const Vec3& o, bool seen) : p(p), o(o), base(p), tilted(p.facing != Vec3(0, 0, 1)) {
    if (!seen) return;
    base.view(o);
    if (Layers::any(p)) layers.emplace(p, o).choose(base.energy);
  }

  Vec3 mirrored(const Vec3& i) const { return i - (2.0f * glm::dot(i, p.facing)) * p.facing; }
  /// Light of a pair. Layers are specular, but for what they let through.
  void evaluate(const Vec3& i, BsdfValue& value, float& pdf) const {
    if (!tilted) return upright(i, value, pdf, false);
    pdf = 0.0f;
    const float side = glm::dot(i, p.facing);
    if (!(side * i.z > 0.0f)) return;  // its light is at mirrored(i)
    upright(i, value, pdf, false);
    const Vec3 m = mirrored(i);
    if (!(side * m.z > 0.0f)) return;
    BsdfValue folded;
    float density;
    upright(m, folded, density, true);
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
  void upright(const Vec3& i, BsdfValue& value, float& pdf, bool specularOnly) const {
    base.evaluate(o, i, value, pdf, specularOnly);
    if (!layers) return;
    const float passed = layers->passed(i);
    value.diffuse *= passed;
    value.specular *= passed;
    pdf *= layers->baseP;
    if (i.z > 0.0f) layers->evaluate(o, i, value, pdf);
  }
};

namespace {

/// Nothing but Lambert: half of a usual scene's surfaces.
inline bool isLambert(const BsdfParams& p) {
  return !(p.metallic > 0.0f) && !(p.specular > 0.0f) && !(p.transmission > 0.0f) && !(p.diffuseTransmission > 0.0f) && !(p.iridescence > 0.0f) &&
         !Layers::any(p);
}
inline Vec3 lambertAlbedo(const BsdfParams& p) { return Vec3(clamp01(p.albedo.x), clamp01(p.albedo.y), clamp01(p.albedo.z)); }

}  // namespace

BsdfView::BsdfView(const BsdfParams& p, const Vec3& wo) : p_(p), wo_(wo), lambert_(isLambert(p)), seen_(wo.z > 0.0f) {
  static_assert(sizeof(Look) <= sizeof look_ && alignof(Look) <= 16 && std::is_trivially_destructible_v<Look>);
  if (!lambert_) new (look_) Look(p_, wo_, seen_);
}

const BsdfView::Look& BsdfView::look() const { return *std::launder(reinterpret_cast<const Look*>(look_)); }

bool BsdfView::isDelta() const {
  if (lambert_) return !(maxComponent(lambertAlbedo(p_)) > 0.0f);
  return !look().base.evaluable() && !Layers::evaluable(p_);
}

BsdfValue BsdfView::evalPdf(const Vec3& wi, float& pdf) const {
  BsdfValue value;
  pdf = 0.0f;
  if (!seen_ || !(std::fabs(wi.z) > 0.0f)) return value;
  if (!lambert_) {
    look().evaluate(wi, value, pdf);
    return value;
  }
  const Vec3 albedo = lambertAlbedo(p_);
  if (!(wi.z > 0.0f) || !(maxComponent(albedo) > 0.0f)) return value;
  pdf = kInvPi * wi.z;
  value.diffuse = albedo * pdf;
  return value;
}

bool BsdfView::sample(float uLobe, const Vec2& u, BsdfSample& out) const {
  BsdfValue value;
  return sample(uLobe, u, out, value);
}

bool BsdfView::sample(float uLobe, const Vec2& u, BsdfSample& out, BsdfValue& value) const {
  out = {};
  value = {};
  if (!seen_) return false;
  if (lambert_) {
    out.wi = sampleCosine(u);
    out.weight = lambertAlbedo(p_);
    out.pdf = kInvPi * out.wi.z;
    value.diffuse = out.weight * out.pdf;
    return out.wi.z > 0.0f && maxComponent(out.weight) > 0.0f;
  }
  const Look& look = this->look();
  const BaseLobes& base = look.base;
  if (!look.layers) {
    if (!(base.energy > 0.0f) || !base.sample(wo_, uLobe, u, out)) return false;
    if (!look.turn(out)) return false;
    if (out.delta) return isFinite(out.weight);
  } else {
    const Layers& layers = *look.layers;
    const float above = layers.coatP + layers.sheenP;
    if (uLobe < above || !(layers.baseP > 0.0f)) {
      if (!layers.sample(uLobe, u, out) || !look.turn(out)) return false;
      if (out.delta) return maxComponent(out.weight) > 0.0f;
    } else {
      if (!base.sample(wo_, clamp01((uLobe - above) / layers.baseP), u, out)) return false;
      if (out.delta) {
        out.weight *= layers.passed(out.wi) / layers.baseP;
        return look.turn(out) && isFinite(out.weight) && maxComponent(out.weight) > 0.0f;
      }
    }
    if (!look.turn(out)) return false;
  }
  look.evaluate(out.wi, value, out.pdf);
  out.weight = value.sum() / out.pdf;
  return out.pdf > 0.0f && isFinite(out.weight) && maxComponent(out.weight) > 0.0f;
}

BsdfValue bsdfEvalPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi, float& pdf) { return BsdfView(p, wo).evalPdf(wi, pdf); }

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

bool bsdfSample(const BsdfParams& p, const Vec3& wo, float uLobe, const Vec2& u, BsdfSample& out) { return BsdfView(p, wo).sample(uLobe, u, out); }

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

namespace {

/// What the specular lobe itself reflects: its table has some more, so that the diffuse lobe below it never gains energy.
float unpadded(float schlick) { return maxOf(schlick - kSchlickPadding, 0.0f); }

}  // namespace

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
  const float schlick = base.smooth ? a.schlick : unpadded(a.schlick);
  // Schlick's Fresnel between f0 and f90 over the microfacets, and what leaves them after further bounces.
  const auto reflected = [&](const Vec3& f0, float f90) { return f0 * (1.0f - a.deficit) + (Vec3(f90) - f0) * schlick; };
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
    out.grazing = (Vec3(base.metal + base.opaque * base.f90) - normal) * unpadded(base.ao.schlick);
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

bool bsdfIsDelta(const BsdfParams& p) {
  // Most materials have a lobe that can be seen from their parameters alone.
  const float roughness = clamp01(p.roughness), metallic = clamp01(p.metallic);
  const bool opaque = metallic < 1.0f && clamp01(p.transmission) < 1.0f;
  if (opaque && clamp01(p.diffuseTransmission) < 1.0f && maxComponent(clamped(p.albedo)) > 0.0f) return false;
  if (!(p.anisotropy > 0.0f) && roughness * roughness >= kDeltaAlpha && (metallic > 0.0f || (opaque && clamp01(p.specular) > 0.0f))) return false;
  return !BaseLobes(p).evaluable() && !Layers::evaluable(p);
}

}  // namespace trace
}  // namespace gobo
