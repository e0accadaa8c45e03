// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf.h"

namespace gobo {
namespace {

/// Closer to 1 than this the refracted lobe is narrower than float can hold: light passes straight on.
constexpr float kStraightIor = 1e-3f;

float pow5(float x) { const float x2 = x * x; return x2 * x2 * x; }
float schlickWeight(float c) { return pow5(clamp01(1.0f - c)); }

/// Unpolarised Fresnel reflectance at a smooth dielectric; c = cosine on the viewer's side, eta = far over near index.
float fresnelDielectric(float c, float eta) {
  c = clamp01(c);
  const float sin2 = (1.0f - c * c) / (eta * eta);
  if (sin2 >= 1.0f) return 1.0f;  // total internal reflection
  const float ct = std::sqrt(1.0f - sin2);
  const float s = c - eta * ct, p = eta * c - ct;
  const float ds = c + eta * ct, dp = eta * c + ct;
  return clamp01(0.5f * (sqr(s / ds) + sqr(p / dp)));
}

/// The GGX distribution; the sum x^2 + y^2 + a^2 z^2 keeps its digits for small alpha where 1 + z^2 (a^2 - 1) does not.
float ggxD(const Vec3& h, float a) {
  const float d = h.x * h.x + h.y * h.y + a * a * h.z * h.z;
  return a * a / (kPi * d * d);
}
/// |v.z| sqrt(1 + a^2 tan^2): the Smith shadowing of one direction is 2 |v.z| / (|v.z| + s).
float smithRoot(const Vec3& v, float a) { return std::sqrt(v.z * v.z + a * a * (v.x * v.x + v.y * v.y)); }
/// Height-correlated G2 / |o.z|. Written as a ratio because oz * si + iz * so underflows when both directions graze.
float smithG2OverViewCosine(float oz, float so, float iz, float si) { return 2.0f / (oz * (si / iz) + so); }

/// Visible normal by spherical caps (Dupuy & Benyoub 2023).
Vec3 sampleVisibleNormal(const Vec3& o, float a, const Vec2& u) {
  const Vec3 v = glm::normalize(Vec3(a * o.x, a * o.y, o.z));
  const float phi = 2.0f * kPi * u.x;
  const float z = (1.0f - u.y) * (1.0f + v.z) - v.z;
  const float r = std::sqrt(clamp01(1.0f - z * z));
  const Vec3 c = Vec3(r * std::cos(phi), r * std::sin(phi), z) + v;
  const Vec3 h(a * c.x, a * c.y, maxOf(c.z, 0.0f));
  const float l = glm::dot(h, h);
  return l > 1e-30f ? h / std::sqrt(l) : Vec3(0, 0, 1);
}

Vec3 sampleCosine(const Vec2& u) {
  const float phi = 2.0f * kPi * u.x, r = std::sqrt(u.y);
  return Vec3(r * std::cos(phi), r * std::sin(phi), std::sqrt(maxOf(1.0f - u.y, 0.0f)));
}

/// What the parameters amount to: weights of the lobes, and the chances of choosing them as seen from wo.
/// Lobes: diffuse; interface (microfacet reflection and refraction, sharing one normal); pass (straight through, ior 1).
struct Lobes {
  float alpha, eta;
  bool smooth;                 // the interface is a delta lobe
  Vec3 albedo;
  float opaque, metal, glass, pass;
  float f0, specular;
  float diffuseP = 0, interfaceP = 0, passP = 0;

  explicit Lobes(const BsdfParams& p) {
    const float roughness = clamp01(p.roughness), metallic = clamp01(p.metallic), transmission = clamp01(p.transmission);
    alpha = roughness * roughness;
    smooth = alpha < kDeltaAlpha;
    albedo = Vec3(clamp01(p.albedo.x), clamp01(p.albedo.y), clamp01(p.albedo.z));
    const float ior = minOf(maxOf(p.ior, 0.1f), 10.0f);
    eta = p.entering ? ior : 1.0f / ior;
    const bool straight = std::fabs(ior - 1.0f) < kStraightIor;
    metal = metallic;
    opaque = (1.0f - metallic) * (1.0f - transmission);
    glass = straight ? 0.0f : (1.0f - metallic) * transmission;
    pass = straight ? (1.0f - metallic) * transmission : 0.0f;
    f0 = sqr((ior - 1.0f) / (ior + 1.0f));
    specular = clamp01(p.specular);
  }

  bool hasDiffuse() const { return opaque > 0.0f && maxComponent(albedo) > 0.0f; }
  bool hasInterface() const { return metal > 0.0f || glass > 0.0f || opaque * specular > 0.0f; }
  bool hasPass() const { return pass > 0.0f && maxComponent(albedo) > 0.0f; }

  float opaqueFresnel(float c) const { return specular * (f0 + (1.0f - f0) * schlickWeight(c)); }
  /// Reflectance of the interface at cosine c to the (micro)normal.
  Vec3 reflected(float c) const {
    const float w = schlickWeight(c);
    float grey = opaque * specular * (f0 + (1.0f - f0) * w);
    if (glass > 0.0f) grey += glass * fresnelDielectric(c, eta);
    return metal * (albedo + (1.0f - albedo) * w) + grey;
  }
  Vec3 refracted(float c) const { return glass > 0.0f ? glass * (1.0f - fresnelDielectric(c, eta)) * albedo : Vec3(0.0f); }

  /// Albedo-weighted Fresnel at the shading normal. Lobes that exist keep a tenth, because a tilted microfacet may reflect
  /// or transmit where the macroscopic surface does not.
  void choose(float oz) {
    float d = 0, s = 0, t = 0;
    if (hasDiffuse()) d = maxOf(opaque * (1.0f - opaqueFresnel(oz)) * luminance(albedo), 1e-6f);
    if (hasInterface()) s = maxOf(luminance(reflected(oz) + refracted(oz)), 1e-6f);
    if (hasPass()) t = maxOf(pass * luminance(albedo), 1e-6f);
    const float sum = d + s + t;
    if (!(sum > 0.0f)) return;
    const float floor = 0.1f * sum;
    if (d > 0.0f) d = maxOf(d, floor);
    if (s > 0.0f) s = maxOf(s, floor);
    if (t > 0.0f) t = maxOf(t, floor);
    const float total = d + s + t;
    diffuseP = d / total;
    interfaceP = s / total;
    passP = t / total;
  }
  float reflectP(float c) const {
    const float r = luminance(reflected(c)), t = luminance(refracted(c));
    return r + t > 0.0f ? r / (r + t) : 1.0f;
  }

  Vec3 diffuse(const Vec3& o, const Vec3& i) const {
    return albedo * (kInvPi * i.z) * (opaque * (1.0f - opaqueFresnel(o.z)) * (1.0f - opaqueFresnel(i.z)));
  }
};

/// Rough interface, reflection: f cos and density of the whole interface strategy (before interfaceP).
void roughReflection(const Lobes& l, const Vec3& o, const Vec3& i, Vec3& f, float& pdf) {
  f = Vec3(0.0f);
  pdf = 0.0f;
  const Vec3 m = o + i;
  const float len2 = glm::dot(m, m);
  if (!(len2 > 0.0f)) return;
  const Vec3 h = m / std::sqrt(len2);
  const float c = clamp01(glm::dot(o, h)), d = ggxD(h, l.alpha);
  const float so = smithRoot(o, l.alpha), si = smithRoot(i, l.alpha);
  f = l.reflected(c) * (0.25f * d * smithG2OverViewCosine(o.z, so, i.z, si));
  pdf = l.reflectP(c) * d * 0.5f / (o.z + so);
}

/// Rough interface, refraction (Walter et al. 2007, equations 17 and 21), radiance: 1/eta^2 of the flux.
void roughRefraction(const Lobes& l, const Vec3& o, const Vec3& i, Vec3& f, float& pdf) {
  f = Vec3(0.0f);
  pdf = 0.0f;
  if (!(l.glass > 0.0f)) return;
  Vec3 m = o + l.eta * i;
  const float len2 = glm::dot(m, m);
  if (!(len2 > 0.0f)) return;
  m /= std::sqrt(len2);
  if (m.z < 0.0f) m = -m;
  const float oh = glm::dot(o, m), ih = glm::dot(i, m);
  if (!(oh > 0.0f && ih < 0.0f)) return;
  const float d = ggxD(m, l.alpha);
  const float so = smithRoot(o, l.alpha), si = smithRoot(i, l.alpha), iz = -i.z;
  const float den = sqr(l.eta * ih + oh);
  if (!(den > 0.0f)) return;
  const float jacobian = -ih * oh / den;
  f = l.refracted(oh) * (jacobian * d * smithG2OverViewCosine(o.z, so, iz, si));
  pdf = (1.0f - l.reflectP(oh)) * l.eta * l.eta * jacobian * d * 2.0f / (o.z + so);
}

/// Everything about a pair of directions but delta lobes.
void evaluate(const Lobes& l, const Vec3& o, const Vec3& i, BsdfValue& value, float& pdf) {
  pdf = 0.0f;
  if (!(o.z > 0.0f) || !(std::fabs(i.z) > 0.0f)) return;
  const bool rough = !l.smooth && l.interfaceP > 0.0f;
  float interfacePdf = 0.0f;
  if (i.z > 0.0f) {
    if (l.diffuseP > 0.0f) {
      value.diffuse = l.diffuse(o, i);
      pdf = l.diffuseP * i.z * kInvPi;
    }
    if (rough) roughReflection(l, o, i, value.specular, interfacePdf);
  } else if (rough) {
    roughRefraction(l, o, i, value.specular, interfacePdf);
  }
  pdf += l.interfaceP * interfacePdf;
}

bool refract(const Vec3& o, const Vec3& h, float eta, Vec3& i) {
  const float c = glm::dot(o, h), sin2 = maxOf(1.0f - c * c, 0.0f) / (eta * eta);
  if (sin2 >= 1.0f) return false;
  i = glm::normalize(-o / eta + (c / eta - std::sqrt(1.0f - sin2)) * h);
  return true;
}

/// Smooth interface: one of two discrete directions.
bool sampleSmooth(const Lobes& l, const Vec3& o, bool reflect, float chance, BsdfSample& out) {
  out.delta = out.specularLobe = true;
  if (reflect) {
    out.wi = Vec3(-o.x, -o.y, o.z);
    out.weight = l.reflected(o.z) / chance;
  } else {
    if (!refract(o, Vec3(0, 0, 1), l.eta, out.wi)) return false;
    out.transmitted = true;
    out.weight = l.refracted(o.z) / (chance * l.eta * l.eta);
  }
  return maxComponent(out.weight) > 0.0f;
}

}  // namespace

BsdfValue bsdfEvalPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi, float& pdf) {
  BsdfValue value;
  Lobes l(p);
  l.choose(wo.z);
  evaluate(l, wo, wi, value, pdf);
  return value;
}

BsdfValue bsdfEval(const BsdfParams& p, const Vec3& wo, const Vec3& wi) {
  float pdf;
  return bsdfEvalPdf(p, wo, wi, pdf);
}

float bsdfPdf(const BsdfParams& p, const Vec3& wo, const Vec3& wi) {
  float pdf;
  bsdfEvalPdf(p, wo, wi, pdf);
  return pdf;
}

bool bsdfSample(const BsdfParams& p, const Vec3& wo, float uLobe, const Vec2& u, BsdfSample& out) {
  out = {};
  if (!(wo.z > 0.0f)) return false;
  Lobes l(p);
  l.choose(wo.z);
  if (uLobe < l.diffuseP) {
    out.wi = sampleCosine(u);
    if (!(out.wi.z > 0.0f)) return false;
  } else if (uLobe < l.diffuseP + l.passP || !(l.interfaceP > 0.0f)) {
    if (!(l.passP > 0.0f)) return false;
    out.wi = -wo;
    out.weight = l.albedo * (l.pass / l.passP);
    return out.delta = out.transmitted = out.specularLobe = true;
  } else {
    const Vec3 h = l.smooth ? Vec3(0, 0, 1) : sampleVisibleNormal(wo, l.alpha, u);
    const float c = glm::dot(wo, h);
    if (!(c > 0.0f)) return false;
    const float v = (uLobe - l.diffuseP - l.passP) / l.interfaceP, chance = l.reflectP(c);
    const bool reflect = v < chance || chance >= 1.0f;
    if (l.smooth) return sampleSmooth(l, wo, reflect, l.interfaceP * (reflect ? chance : 1.0f - chance), out);
    out.specularLobe = true;
    out.transmitted = !reflect;
    if (reflect) {
      out.wi = glm::normalize(2.0f * c * h - wo);
    } else if (!refract(wo, h, l.eta, out.wi)) {
      return false;
    }
    if (reflect ? !(out.wi.z > 0.0f) : !(out.wi.z < 0.0f)) return false;
  }
  BsdfValue value;
  evaluate(l, wo, out.wi, value, out.pdf);
  if (!(out.pdf > 0.0f)) return false;
  if (!(l.interfaceP + l.passP > 0.0f)) {
    // Diffuse alone: the cosine cancels exactly, so Lambert's weight is its albedo to the last bit.
    out.weight = l.albedo * (l.opaque * (1.0f - l.opaqueFresnel(wo.z)) * (1.0f - l.opaqueFresnel(out.wi.z)));
  } else {
    out.weight = value.sum() / out.pdf;
  }
  return isFinite(out.weight) && maxComponent(out.weight) > 0.0f;
}

bool bsdfIsDelta(const BsdfParams& p) {
  const Lobes l(p);
  return !l.hasDiffuse() && (l.smooth || !l.hasInterface());
}

}  // namespace gobo
