// SPDX-License-Identifier: Apache-2.0
// The members of BaseLobes. Included by bsdf.cpp alone: inlined into eval and sample, what a material does not have costs a branch.
#pragma once

#include "trace/bsdf_base.h"
#include "trace/bsdf_film.h"

namespace gobo {
inline namespace trace {

/// From here on (and for 0, as glTF writes it) the index is infinite: everything is reflected.
inline constexpr float kInfiniteIor = 1e3f;
/// The tables of rough glass end here (diamond 2.42, rutile 2.9); a higher index refracts as this one.
inline constexpr float kLargestGlassIor = 3.0f;
inline constexpr float kNegligibleBounce = 0.005f;

inline Vec3 clamped(const Vec3& c) { return Vec3(clamp01(c.x), clamp01(c.y), clamp01(c.z)); }
inline float minComponent(const Vec3& c) { return minOf(c.x, minOf(c.y, c.z)); }

/// Colour of the light that left the microfacets after two and more bounces: mean^2 E / (1 - mean D), E + D = 1.
inline Vec3 bounced(const Vec3& mean, float deficitMean) {
  const Vec3 m = clamped(mean);
  return m * m * (1.0f - deficitMean) / (Vec3(1.0f) - m * deficitMean);
}
/// Cosine-weighted mean of Schlick's Fresnel.
inline Vec3 schlickMeanOf(const Vec3& f0, float f90) { return f0 + (Vec3(f90) - f0) * (1.0f / 21.0f); }

inline ReflectionAlbedo::Value BaseLobes::lookUp(const Vec3& direction) const {
  const float mu = std::fabs(direction.z);
  if (smooth) return {0.0f, schlickWeight(mu)};
  return anisotropic ? brushed.at(direction) : table.at(mu);
}

inline BaseLobes::BaseLobes(const BsdfParams& p) {
  const float roughness = clamp01(p.roughness), metallic = clamp01(p.metallic), transmission = clamp01(p.transmission);
  const float alpha = roughness * roughness, anisotropy = clamp01(p.anisotropy);
  thin = p.thin;
  if (anisotropy > 0.0f) {
    const float ax = alpha + (1.0f - alpha) * sqr(anisotropy);
    smooth = ax < kDeltaAlpha;
    const float ay = maxOf(alpha, kDeltaAlpha);
    g = Ggx(maxOf(ax, ay), ay);
    anisotropic = !smooth;
  } else {
    smooth = alpha < kDeltaAlpha;
    g = Ggx(alpha);
  }
  albedo = clamped(p.albedo);
  metal = metallic;
  const float clear = (1.0f - metallic) * transmission;
  opaque = 1.0f - metallic;
  glass = pass = through = 0.0f;
  float f0Grey = 0.0f;
  if (metallic < 1.0f) {  // pure metals skip the dielectric's arithmetic
    const bool infinite = !(p.ior > 0.0f) || p.ior >= kInfiniteIor;
    f0Grey = infinite ? 1.0f : sqr((p.ior - 1.0f) / (p.ior + 1.0f));
    if (clear > 0.0f && !infinite) {
      ior = minOf(maxOf(p.ior, 1.0f / kLargestGlassIor), kLargestGlassIor);
      if (thin) ior = maxOf(ior, 1.0f / ior);
      eta = p.entering || thin ? ior : 1.0f / ior;
      (std::fabs(ior - 1.0f) < kStraightIor ? pass : glass) = clear;
      opaque -= clear;
      plainGlass = p.specular >= 1.0f && p.specularColor == Vec3(1.0f);
    }
    through = clamp01(p.diffuseTransmission);
    if (through > 0.0f) throughColor = clamped(p.diffuseTransmissionColor);
    f90 = clamp01(p.specular);
    f0 = clamped(f0Grey * glm::max(p.specularColor, Vec3(0.0f))) * f90;
    f0Bound = maxComponent(f0);
    f90Bound = f90;
  }

  film = clamp01(p.iridescence);
  filmed = film > 0.0f && p.iridescenceThickness > 0.0f;
  const bool rough = !smooth;
  usesTable_ = rough && (metal > 0.0f || hasDielectric() || (thin && glass > 0.0f));
  usesGlass_ = rough && glass > 0.0f && !thin;
  if (usesTable_) {
    if (anisotropic) {
      brushed = AnisotropicAlbedo(roughness, anisotropy);
      deficitMean = brushed.deficitMean;
      schlickMean = brushed.schlickMean;
    } else {
      table = ReflectionAlbedo(alpha, roughness);
      deficitMean = table.deficitMean;
      schlickMean = table.schlickMean;
    }
  }
  Vec3 metalMean(0.0f), dielectricMean(0.0f);
  if (metal > 0.0f) metalMean = schlickMeanOf(albedo, 1.0f);
  if (opaque + glass > 0.0f) dielectricMean = schlickMeanOf(f0, f90);
  if (filmed) {
    filmIor = p.iridescenceIor;
    filmThickness = p.iridescenceThickness;
    plainGlass = false;
    setMeansOfFilm(metalMean, dielectricMean);
  }
  if (usesTable_ && deficitMean > 1e-7f) {
    kernel = kInvPi / deficitMean;
    if (metal > 0.0f) msUp += metal * bounced(metalMean, deficitMean);
    if (hasDielectric()) {
      // Of an index near 1.5 less than 0.4 % bounces out again; the rest goes into what is below, and so may this.
      const Vec3 b = bounced(dielectricMean, deficitMean);
      if (maxComponent(b) > kNegligibleBounce) {
        msBound = maxComponent(b);
        msUp += opaque * b;
      }
    }
    if (thin && glass > 0.0f) {
      msUp += glass * dielectricMean;
      msDown += (glass * (1.0f - maxComponent(dielectricMean))) * albedo;
    }
  }
  if (!(maxComponent(msUp) + maxComponent(msDown) > 0.0f)) kernel = 0.0f;
  if (hasDiffuse() && hasDielectric()) {
    const float mean = interfaceAlbedo({deficitMean, schlickMean});
    diffuseNorm = mean < 0.9999f ? 1.0f / (1.0f - mean) : 0.0f;
  }
  if (usesGlass_) {
    if (anisotropic) brushedGlass = AnisotropicGlassAlbedo(roughness, anisotropy, maxOf(ior, 1.0f / ior));
    else glassTable = GlassAlbedo(alpha, maxOf(ior, 1.0f / ior));
    // The mean transmittance of the smooth interface (fit of Kulla & Conty 2017) from outside; 1/n^2 of it from inside. Reciprocity
    // ties the transmitted shares of both sides: outside / inside = n^2 mean[inside] / mean[outside]; the larger of both gives way.
    const float n = maxOf(ior, 1.0f / ior), t = 1.0f - (n - 1.0f) / (4.08567f + 1.00071f * n);
    const float* mean = anisotropic ? brushedGlass.mean : glassTable.mean;
    glassMean[0] = mean[0];
    glassMean[1] = mean[1];
    if (mean[0] > 1e-7f && mean[1] > 1e-7f) {
      const float q = mean[1] / mean[0];
      const bool inside = eta < 1.0f;
      const float share = inside ? t / (n * n) / maxOf(q, 1.0f) : t * minOf(q, 1.0f);
      // Where `specular` or a film takes from the reflection, less is lost between the facets.
      float kept = 1.0f;
      if (!plainGlass) kept = clamp01(minComponent(dielectricMean) / maxOf(schlickMeanOf(Vec3(f0Grey), 1.0f).x, 1e-6f));
      glassUp = Vec3(glass * kept * (1.0f - share) * kInvPi / mean[inside ? 1 : 0]);
      glassDown = (glass * kept * share * kInvPi / mean[inside ? 0 : 1] / (eta * eta)) * albedo;
    }
  }
}

/// Hemisphere means of the film's reflectance by four Gauss points in cos^2, and a Schlick curve above it at these and at normal
/// incidence (energy of the diffuse light below; the random sweep of the tests is its check).
inline void BaseLobes::setMeansOfFilm(Vec3& metalMean, Vec3& dielectricMean) {
  static constexpr float at[5] = {0.263495f, 0.574464f, 0.818529f, 0.964666f, 1.0f};
  static constexpr float weight[5] = {0.173927f, 0.326073f, 0.326073f, 0.173927f, 0.0f};
  metalMean = dielectricMean = Vec3(0.0f);
  float bound = 0.0f;
  for (int k = 0; k < 5; ++k) {
    const float w = schlickWeight(at[k]);
    if (metal > 0.0f) metalMean += weight[k] * metalReflected(w, at[k]);
    if (!(opaque + glass > 0.0f)) continue;
    const Vec3 d = dielectricReflected(w, at[k]);
    dielectricMean += weight[k] * d;
    bound = maxOf(bound, (maxComponent(d) - w) / (1.0f - w));
  }
  f0Bound = minOf(bound, 1.0f);
  f90Bound = 1.0f;
}

inline Vec3 BaseLobes::metalReflected(float w, float c) const {
  const Vec3 f = albedo + (1.0f - albedo) * w;
  return filmed ? glm::mix(f, filmReflectance(c, filmIor, filmThickness, albedo), film) : f;
}
inline Vec3 BaseLobes::dielectricReflected(float w, float c) const {
  const Vec3 f = f0 + (Vec3(f90) - f0) * w;
  return filmed ? glm::mix(f, filmReflectance(c, filmIor, filmThickness, f0), film) : f;
}
/// Exact Fresnel bent to the ends that `specular` gives Schlick's; total reflection stays total.
inline Vec3 BaseLobes::glassReflected(float c) const {
  const float f = fresnelDielectric(c, eta);
  if (plainGlass || f >= 1.0f) return Vec3(f);
  const float grey = sqr((ior - 1.0f) / (ior + 1.0f));
  Vec3 r = f0 + (Vec3(f90) - f0) * clamp01((f - grey) / (1.0f - grey));
  if (filmed) {
    const float outer = eta >= 1.0f ? c : std::sqrt(clamp01(1.0f - (1.0f - c * c) / (eta * eta)));
    r = glm::mix(r, filmReflectance(outer, filmIor, filmThickness, f0), film);
  }
  return clamped(r);
}

inline void BaseLobes::split(float c, Vec3& reflected, Vec3& refracted) const {
  const float w = schlickWeight(c);
  reflected = refracted = Vec3(0.0f);
  if (metal > 0.0f) reflected += metal * metalReflected(w, c);
  if (opaque > 0.0f) reflected += opaque * dielectricReflected(w, c);
  if (glass > 0.0f) {
    const Vec3 r = glassReflected(c);
    reflected += glass * r;
    refracted = (glass * (1.0f - maxComponent(r))) * albedo;
  }
}

/// Lobes that exist keep a tenth of the chances, because a tilted microfacet may reflect or transmit where the macroscopic surface
/// does not. Bounced light alone keeps only its share: it is smooth and small.
inline void BaseLobes::view(const Vec3& o) {
  if (usesTable_ || diffuseNorm > 0.0f) ao = lookUp(o);
  if (usesGlass_) glassO = glassDeficit(o, eta < 1.0f);
  float up = 0, down = 0, s = 0, t = 0;
  bool diffuseUp = false, diffuseDown = false;
  if (hasDiffuse()) {
    diffuseO = hasDielectric() ? (diffuseNorm > 0.0f ? maxOf(1.0f - interfaceAlbedo(ao), 0.0f) : 0.0f) : 1.0f;
    const float d = opaque * diffuseO;
    diffuseUp = d > 0.0f && through < 1.0f && maxComponent(albedo) > 0.0f;
    diffuseDown = d > 0.0f && through > 0.0f && maxComponent(throughColor) > 0.0f;
    if (diffuseUp) up = maxOf(d * (1.0f - through) * luminance(albedo), 1e-6f);
    if (diffuseDown) down = maxOf(d * through * luminance(throughColor), 1e-6f);
  }
  if (hasInterface()) {
    Vec3 r, f;
    split(o.z, r, f);
    s = maxOf(luminance(r + f), 1e-6f);
  }
  if (hasPass()) t = maxOf(pass * luminance(albedo), 1e-6f);
  const float floor = 0.1f * (up + down + s + t);
  if (!(floor > 0.0f)) return;
  if (diffuseUp) up = maxOf(up, floor);
  if (diffuseDown) down = maxOf(down, floor);
  if (s > 0.0f) s = maxOf(s, floor);
  if (t > 0.0f) t = maxOf(t, floor);
  float bounceUp = 0, bounceDown = 0;
  if (kernel > 0.0f) {
    bounceUp = luminance(msUp) * ao.deficit;
    bounceDown = luminance(msDown) * ao.deficit;
  }
  if (glassO > 0.0f) {
    bounceUp += luminance(glassUp) * (kPi * glassMean[eta < 1.0f ? 1 : 0]) * glassO;
    bounceDown += luminance(glassDown) * (kPi * glassMean[eta < 1.0f ? 0 : 1] * eta * eta) * glassO;
  }
  if (bounceUp + bounceDown > 0.0f) {
    bounceB2 = sqr(2.0f * maxOf(g.x, g.y));
    bounceLog = std::log(1.0f + 1.0f / bounceB2);
  }
  energy = up + down + bounceUp + bounceDown + s + t;
  const float scale = 1.0f / energy;
  upP = up * scale;
  downP = down * scale;
  bounceUpP = bounceUp * scale;
  bounceDownP = bounceDown * scale;
  interfaceP = s * scale;
  passP = t * scale;
}

inline Vec3 BaseLobes::diffuse(bool up, float iz, const ReflectionAlbedo::Value& ai) const {
  const float cosine = kInvPi * iz;
  float factor = opaque * diffuseO;
  if (hasDielectric()) factor *= maxOf(1.0f - interfaceAlbedo(ai), 0.0f) * diffuseNorm;
  return up ? albedo * cosine * (factor * (1.0f - through)) : throughColor * cosine * (factor * through);
}

inline void BaseLobes::evaluate(const Vec3& o, const Vec3& i, BsdfValue& value, float& pdf, bool specularOnly) const {
  pdf = 0.0f;
  const bool up = i.z > 0.0f;
  const float iz = std::fabs(i.z);
  if (!(o.z > 0.0f) || !(iz > 0.0f)) return;
  const float cosine = kInvPi * iz, lobeP = specularOnly ? 0.0f : up ? upP : downP, bounceP = up ? bounceUpP : bounceDownP;
  pdf = lobeP * cosine;
  const bool specular = !smooth && interfaceP > 0.0f;
  if (lobeP + bounceP > 0.0f) {
    ReflectionAlbedo::Value ai;
    if (usesTable_ || diffuseNorm > 0.0f) ai = lookUp(i);
    if (lobeP > 0.0f) value.diffuse = diffuse(up, iz, ai);
    if (bounceP > 0.0f) {
      if (kernel > 0.0f) value.specular = (up ? msUp : msDown) * (kernel * ao.deficit * ai.deficit * iz);
      if (glassO > 0.0f) value.specular += (up ? glassUp : glassDown) * (glassO * glassDeficit(i, (eta < 1.0f) == up) * iz);
      pdf += bounceP * cosine / (bounceLog * (iz * iz + bounceB2));
    }
  }
  if (!specular) return;
  float f, density, c;
  Vec3 r, t;
  if (up || thin) {
    if (!ggxReflection(g, o, Vec3(i.x, i.y, iz), f, density, c)) return;
    split(c, r, t);
    const float lr = luminance(r), lt = luminance(t), reflectP = lr + lt > 0.0f ? lr / (lr + lt) : 1.0f;
    value.specular += (up ? r : t) * f;
    pdf += interfaceP * (up ? reflectP : 1.0f - reflectP) * density;
    return;
  }
  // Refraction (Walter et al. 2007, equations 17 and 21), radiance: 1/eta^2 of the flux.
  if (!(glass > 0.0f)) return;
  Vec3 m = o + eta * i;
  const float len2 = glm::dot(m, m);
  if (!(len2 > 0.0f)) return;
  m /= std::sqrt(len2);
  if (m.z < 0.0f) m = -m;
  const float oh = glm::dot(o, m), ih = glm::dot(i, m);
  if (!(oh > 0.0f && ih < 0.0f)) return;
  const float den = sqr(eta * ih + oh);
  if (!(den > 0.0f)) return;
  const float d = g.density(m), so = g.root(o), si = g.root(i), jacobian = -ih * oh / den;
  split(oh, r, t);
  const float lr = luminance(r), lt = luminance(t);
  if (!(lt > 0.0f)) return;
  value.specular += t * (jacobian * d * smithG2OverViewCosine(o.z, so, iz, si));
  pdf += interfaceP * (lt / (lr + lt)) * eta * eta * jacobian * d * 2.0f / (o.z + so);
}

inline bool BaseLobes::sample(const Vec3& o, float uLobe, const Vec2& u, BsdfSample& out) const {
  if (uLobe < upP + downP) {
    const bool up = uLobe < upP;
    out.wi = sampleCosine(u);
    if (!(out.wi.z > 0.0f)) return false;
    if (!up) out.wi.z = -out.wi.z;
    out.transmitted = !up;
    return true;
  }
  const float bounce = bounceUpP + bounceDownP;
  if (uLobe < upP + downP + bounce) {
    const bool up = uLobe < upP + downP + bounceUpP;
    const float z = minOf(std::sqrt(bounceB2 * std::expm1(u.y * bounceLog)), 1.0f), r = std::sqrt(1.0f - z * z), phi = 2.0f * kPi * u.x;
    if (!(z > 0.0f)) return false;
    out.wi = Vec3(r * std::cos(phi), r * std::sin(phi), up ? z : -z);
    out.transmitted = !up;
    return out.specularLobe = true;
  }
  if (uLobe < upP + downP + bounce + passP || !(interfaceP > 0.0f)) {
    if (!(passP > 0.0f)) return false;
    out.wi = -o;
    out.weight = albedo * (pass / passP);
    return out.delta = out.transmitted = out.specularLobe = out.straight = true;
  }
  const Vec3 h = smooth ? Vec3(0, 0, 1) : g.sample(o, u);
  const float c = glm::dot(o, h);
  if (!(c > 0.0f)) return false;
  Vec3 r, t;
  split(c, r, t);
  const float lr = luminance(r), lt = luminance(t), reflectP = lr + lt > 0.0f ? lr / (lr + lt) : 1.0f;
  const float v = (uLobe - upP - downP - bounce - passP) / interfaceP;
  const bool reflect = v < reflectP || reflectP >= 1.0f;
  out.specularLobe = true;
  out.transmitted = !reflect;
  if (smooth) {
    out.delta = true;
    const float chance = interfaceP * (reflect ? reflectP : 1.0f - reflectP);
    if (reflect) out.wi = Vec3(-o.x, -o.y, o.z);
    else if (thin) {
      out.wi = -o;
      out.straight = true;
    } else if (!refract(o, h, eta, out.wi)) return false;
    out.weight = reflect ? r / chance : t / (thin ? chance : chance * eta * eta);
    return maxComponent(out.weight) > 0.0f;
  }
  if (reflect || thin) {
    out.wi = glm::normalize(2.0f * c * h - o);
    if (!(out.wi.z > 0.0f)) return false;
    if (!reflect) out.wi.z = -out.wi.z;
    return true;
  }
  return refract(o, h, eta, out.wi) && out.wi.z < 0.0f;
}

}  // namespace trace
}  // namespace gobo
