// SPDX-License-Identifier: Apache-2.0
#include "terms/unoccluded_light.h"

#include <numbers>

#include "base/sobol.h"
#include "trace/area_lights.h"
#include "trace/distant_light.h"

namespace gobo {
inline namespace terms {

namespace {

/// The part of the light above the surface is the same by both normals. above: cosine of the light's centre to the geometric one; sine: of its half angle.
bool sameHorizon(const LitPoint& r, double above, double sine) { return r.n == r.ng || above >= sine; }

/// As the tracer has it, from the front. What comes through the surface is no part of this term: its shadows are other ones.
bool arrives(const LitPoint& r, const Vec3& wi) { return glm::dot(wi, r.ng) > 0 && glm::dot(wi, r.n) > 0; }

constexpr int kParallels = 5;
constexpr double kGaussNode[kParallels] = {-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640};
constexpr double kGaussWeight[kParallels] = {0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665, 0.2369268850561891};

/// Where the highlight of a glossy surface is, a few samples of either kind are too few: a light at infinity takes a share of the lobe, and one BSDF
/// sample more or less that falls inside it changes hundreds of times the picture's mean by a quarter. cosine: of the mirror direction to the
/// light's centre; h: tangent of its larger half angle. Lights in the sky lie in few lobes; wide lobes have no such peaks.
constexpr int kHighlightScale = 16;
constexpr double kHighlightAlpha = 0.1;
bool inHighlight(const LitPoint& r, double cosine, double h) {
  double alpha = 1e9;
  for (const float roughness : {r.bsdf.roughness, r.bsdf.clearcoat > 0.0f ? r.bsdf.clearcoatRoughness : 1.0f})
    if (const double a = double(roughness) * roughness; a >= kDeltaAlpha) alpha = std::min(alpha, a);
  return alpha < std::min(8.0 * h, kHighlightAlpha) && std::acos(std::clamp(cosine, -1.0, 1.0)) < 1.5 * h + 4.0 * alpha;
}

}  // namespace

/// A point with what depends on its material and viewer alone, found once for all directions that light may come from.
struct UnoccludedLight::Seen {
  explicit Seen(const LitPoint& r) : r(r), frame(r.frame()), wo(frame.toLocal(r.wo)), view(r.bsdf, wo) {}
  BsdfValue value(const Vec3& local, float& pdf) const { return r.value(view, wo, local, pdf); }
  BsdfValue value(const Vec3& local) const {
    float pdf;
    return value(local, pdf);
  }
  const LitPoint& r;
  const Frame frame;
  const Vec3 wo;
  const BsdfView view;
};

Vec3 UnoccludedLight::at(const LitPoint& r, size_t element, LobePart lobe) const {
  Vec3 value(0.0f);
  if (r.lambert() && (bsdfIsDelta(r.bsdf) || closedForm(r, lobe, value))) return value;
  const Seen seen(r);
  return !r.lambert() && seen.view.isDelta() ? value : sampled(seen, element, lobe);
}

BsdfValue UnoccludedLight::lobes(const LitPoint& r, size_t element) const {
  BsdfValue out;
  if (r.lambert() && !isDeltaLight(shape_)) {
    out.diffuse = at(r, element, LobePart::Diffuse);
    return out;
  }
  const Seen seen(r);  // one look at the material for both
  if (seen.view.isDelta()) return out;
  if (isDeltaLight(shape_)) {
    LightSample ls;
    if (!sampler_->sample(light_, r.p, Vec2(0.5f), ls) || !arrives(r, ls.direction)) return out;
    out = seen.value(seen.frame.toLocal(ls.direction));
    out.diffuse *= ls.radiance;
    out.specular *= ls.radiance;
    return out;
  }
  if (isWideDirectional(shape_)) {
    out.diffuse = sampled(seen, element, LobePart::Diffuse);
    out.specular = sampled(seen, element, LobePart::Specular);
    return out;
  }
  DVec3 diffuse(0.0), specular(0.0);
  drawn(seen, element, [&](const BsdfValue& f, const Vec3& radiance, double density) {
    diffuse += DVec3(f.diffuse * radiance) / density;
    specular += DVec3(f.specular * radiance) / density;
  });
  out.diffuse = Vec3(diffuse);
  out.specular = Vec3(specular);
  return out;
}

bool UnoccludedLight::sees(const LitPoint& r, const LightFacet& facet, SeenFacet& out) const {
  const DVec3 p(r.p), corner = DVec3(facet.p) - p;
  if (!twoSided_ && glm::dot(corner, DVec3(facet.n)) >= 0) return false;
  out = {{corner, corner + DVec3(facet.e1), corner + DVec3(facet.e2)}, false};
  double highest[2] = {-1, -1}, reach = 0;
  for (const DVec3& c : out.corners) {
    const double up[2] = {glm::dot(c, DVec3(r.n)), glm::dot(c, DVec3(r.ng))};
    for (int k = 0; k < 2; ++k) highest[k] = std::max(highest[k], up[k]);
    out.crossed = out.crossed || up[1] <= 0;
    reach = std::max(reach, glm::dot(c, c));
  }
  const double rounding = 1e-5 * std::sqrt(reach) + 4e-7 * std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  return highest[0] > rounding && highest[1] > rounding;
}

bool UnoccludedLight::closedForm(const LitPoint& r, LobePart lobe, Vec3& value) const {
  const LightShape& s = shape_;
  if (!r.lambert()) return false;
  if (lobe == LobePart::Specular) {
    value = Vec3(0.0f);
    return true;
  }
  const DVec3 p(r.p), n(r.n);
  if (s.kind == LightKind::Rect) {
    const DVec3 u(s.u), v(s.v), corner = DVec3(s.position) - u - v;
    if (!s.twoSided && glm::dot(p - DVec3(s.position), DVec3(s.axis)) <= 0) {
      value = Vec3(0.0f);
      return true;
    }
    if (r.n != r.ng) {  // the tracer also wants light above the geometric horizon; where the light crosses it, sample
      int below = 0;
      for (int k = 0; k < 4; ++k) below += glm::dot(corner + u * double(2 * (k & 1)) + v * double(k & 2) - p, DVec3(r.ng)) <= 0;
      if (below == 4) value = Vec3(0.0f);
      if (below > 0) return below == 4;
    }
    value = r.bsdf.albedo * float(rectFormFactor(p, n, corner, 2.0 * u, 2.0 * v));
    return true;
  }
  if (!facets_.empty()) {
    double sum = 0;
    for (const LightFacet& f : facets_) {
      SeenFacet seen;
      if (!sees(r, f, seen)) continue;
      if (seen.crossed && r.n != r.ng) return false;
      sum += triangleFormFactor(seen.corners, n);
    }
    value = r.bsdf.albedo * float(sum);
    return true;
  }
  if (s.kind == LightKind::Disk) {
    const DVec3 axis(s.axis), d = DVec3(s.position) - p;
    const auto whole = [&](const DVec3& normal) {
      const double along = glm::dot(normal, axis);
      return glm::dot(d, normal) >= double(s.radius) * std::sqrt(std::max(1.0 - along * along, 0.0));
    };
    if (!whole(n) || !whole(DVec3(r.ng))) return false;
    value = r.bsdf.albedo * float(diskFormFactor(p, n, DVec3(s.position), s.twoSided && glm::dot(d, axis) > 0 ? -axis : axis, double(s.radius)));
    return true;
  }
  if (s.kind == LightKind::Sphere) {
    const DVec3 d = DVec3(s.position) - p;
    const double distance = glm::length(d), above = glm::dot(d, DVec3(r.ng));
    if (!(distance > double(s.radius))) return false;
    if (above <= -double(s.radius) || glm::dot(d, n) <= -double(s.radius)) {
      value = Vec3(0.0f);
      return true;
    }
    if (!sameHorizon(r, above / distance, double(s.radius) / distance)) return false;
    value = r.bsdf.albedo * float(sphereFormFactor(p, n, DVec3(s.position), double(s.radius)));
    return true;
  }
  return false;
}

/// The diffuse lobe under a sun of some size, whose visible part is the same by both normals. What a plane gets of it is exact: it falls with the cosine
/// of its centre, as of a ball. A lobe below an interface is a smooth function of the light's cosine times it: of a disk that is whole above the horizon
/// four places (two of them at one cosine) on the circle whose mean is the disk's, exact for what is linear in the cosine and to the third order of the
/// disk's angle otherwise; of one that is cut by it, five parallels.
bool UnoccludedLight::sunlit(const LitPoint& r, Vec3& value) const {
  const LightShape& s = shape_;
  value = Vec3(0.0f);
  if (r.extended) return false;
  const double sine = std::sin(0.5 * double(s.angularSize)), up = -glm::dot(DVec3(r.n), DVec3(s.axis)), above = -glm::dot(DVec3(r.ng), DVec3(s.axis));
  if (up <= -sine || above <= -sine) return true;
  if (!sameHorizon(r, above, sine)) return false;
  if (r.lambert()) {
    value = r.bsdf.albedo * float((up >= sine ? up : capFormFactor(up, sine) / (sine * sine)) / std::numbers::pi);
    return true;
  }
  const double cosine = std::sqrt(1.0 - sine * sine), out = std::sqrt(std::max(1.0 - up * up, 0.0));
  const Vec3 wo = r.frame().toLocal(r.wo);
  if (up >= sine) {
    // Mean cosine to the centre is (1 + cos a) / 2 for half angle a; the disk's solid angle over its irradiance is the reciprocal.
    const double mean = 0.5 * (1.0 + cosine), across = std::sqrt(1.0 - mean * mean) * out;
    const float cosines[3] = {float(mean * up), float(mean * up + across), float(std::max(mean * up - across, 1e-9))};
    Vec3 f[3];
    bsdfDiffuse(r.bsdf, wo, cosines, f);
    value = (0.5f * f[0] + 0.25f * (f[1] + f[2])) * float(1.0 / mean);
    return true;
  }
  // By Gauss's rule in t: cosines are middle + half sin t from the horizon to the highest, where the parallel's arc within the disk ends like a root.
  const double middle = up * cosine, half = out * sine, from = std::asin(std::clamp(-middle / half, -1.0, 1.0)), to = 0.5 * std::numbers::pi;
  float cosines[kParallels];
  double weights[kParallels];
  for (int k = 0; k < kParallels; ++k) {
    const double t = 0.5 * (from + to) + 0.5 * (to - from) * kGaussNode[k], m = std::max(middle + half * std::sin(t), 1e-9);
    const double arc = 2.0 * std::acos(std::clamp((cosine - m * up) / (std::sqrt(std::max(1.0 - m * m, 1e-30)) * out), -1.0, 1.0));
    cosines[k] = float(m);
    weights[k] = 0.5 * (to - from) * kGaussWeight[k] * half * std::cos(t) * arc;
  }
  Vec3 f[kParallels];
  bsdfDiffuse(r.bsdf, wo, cosines, f);
  DVec3 sum(0.0);
  for (int k = 0; k < kParallels; ++k) sum += weights[k] * DVec3(f[k]);
  value = Vec3(sum / (std::numbers::pi * sine * sine));
  return true;
}

Vec3 UnoccludedLight::sampled(const Seen& seen, size_t element, LobePart part) const {
  const LightShape& shape = shape_;
  const LitPoint& r = seen.r;
  if (isWideDirectional(shape)) {
    const bool along = arrives(r, -shape.axis);
    if (shape.angularSize != 0.0f) {
      Vec3 diffuse;
      if (part == LobePart::Specular || !sunlit(r, diffuse)) return distant(seen, element, part);
      return r.lambert() || part == LobePart::Diffuse ? diffuse : diffuse + distant(seen, element, LobePart::Specular);
    }
    const auto alongAxis = [&] { return seen.value(seen.frame.toLocal(-shape.axis)); };
    if (r.lambert()) return along ? partOf(alongAxis(), part) : Vec3(0.0f);
    Vec3 value(0.0f);
    if (part != LobePart::Specular && along) value += alongAxis().diffuse;
    if (part != LobePart::Diffuse) value += distant(seen, element, LobePart::Specular);
    return value;
  }
  if (isDeltaLight(shape)) {
    LightSample ls;
    if (!sampler_->sample(light_, r.p, Vec2(0.5f), ls)) return Vec3(0.0f);
    return (arrives(r, ls.direction) ? partOf(seen.value(seen.frame.toLocal(ls.direction)), part) : Vec3(0.0f)) * ls.radiance;
  }
  DVec3 sum(0.0);
  drawn(seen, element, [&](const BsdfValue& f, const Vec3& radiance, double density) { sum += DVec3(partOf(f, part) * radiance) / density; });
  return Vec3(sum);
}

/// Light samples and BSDF samples by the balance heuristic; BSDF samples only for lights that a ray can be tested against here. add(f cos, radiance, density
/// of all samples together), whose sum of f radiance / density is the light.
template <class Add>
void UnoccludedLight::drawn(const Seen& seen, size_t element, const Add& add) const {
  const LightShape& shape = shape_;
  const LitPoint& r = seen.r;
  const bool both = shape.kind != LightKind::Mesh && !r.lambert();
  const int nLight = both ? (samples_ + 1) / 2 : samples_, nBsdf = samples_ - nLight;
  const uint64_t seed = hash64(hash64(seed_, 0x646972u), element);
  for (int k = 0; k < nLight; ++k) {
    SobolSampler u(seed, uint32_t(k));
    LightSample ls;
    if (!sampler_->sample(light_, r.p, u.next2D(), ls) || !arrives(r, ls.direction)) continue;
    float pb;
    const BsdfValue f = seen.value(seen.frame.toLocal(ls.direction), pb);
    add(f, ls.radiance, double(nLight * ls.pdf + (nBsdf ? nBsdf * pb : 0.0f)));
  }
  for (int k = 0; k < nBsdf; ++k) {
    SobolSampler u(hash64(seed, 1), uint32_t(k));
    BsdfSample b;
    BsdfValue f;
    const float lobe = u.next1D();
    if (!seen.view.sample(lobe, u.next2D(), b, f) || b.delta || b.pdf <= 0) continue;
    Ray ray;
    ray.origin = r.p;
    ray.direction = seen.frame.toWorld(b.wi);
    if (!arrives(r, ray.direction)) continue;
    float t;
    Vec3 normal;
    if (!intersectAreaLight(shape, ray, t, normal)) continue;  // whatever other light is before it: lights block nothing
    const float pl = sampler_->pdf(light_, r.p, ray.direction, t, 0);
    add(r.dispersed(f, seen.wo, b.wi), sampler_->emitted(light_, ray.direction, 0, 0, 0, normal), double(nLight * pl + nBsdf * b.pdf));
  }
}

/// Lobes under a light at infinity of irradiance 1, uniform over its disk or rectangle. Light and BSDF samples, balance heuristic.
Vec3 UnoccludedLight::distant(const Seen& seen, size_t element, LobePart lobes) const {
  const LightShape& shape = shape_;
  const LitPoint& r = seen.r;
  const Frame& frame = seen.frame;
  const Vec3& wo = seen.wo;
  const DistantLight light(shape);
  const double h = shape.angularSize != 0.0f ? std::tan(0.5 * double(shape.angularSize)) : 0.5 * std::max(shape.skyRectangle.x, shape.skyRectangle.y);
  const bool highlight = !r.lambert() && inHighlight(r, -glm::dot(shape.axis, frame.toWorld(Vec3(-wo.x, -wo.y, wo.z))), h);
  const int samples = highlight ? kHighlightScale * samples_ : samples_, nLight = r.lambert() ? samples : (samples + 1) / 2, nBsdf = samples - nLight;
  const uint64_t seed = hash64(hash64(seed_, 0x676c6fu), element);
  DVec3 sum(0.0);
  for (int k = 0; k < samples; ++k) {
    SobolSampler u(seed, uint32_t(k));
    double pl;
    float density;
    BsdfValue f;
    if (k < nLight) {
      const Vec3 wi = light.sample(u.next2D(), pl);
      if (!(pl > 0) || !arrives(r, wi)) continue;
      f = seen.value(frame.toLocal(wi), density);
    } else {
      BsdfSample b;
      const float lobe = u.next1D();
      if (!seen.view.sample(lobe, u.next2D(), b, f) || b.delta || b.pdf <= 0) continue;
      const Vec3 wi = frame.toWorld(b.wi);
      pl = light.pdf(wi);
      if (!(pl > 0) || !arrives(r, wi)) continue;
      f = r.dispersed(f, wo, b.wi);
      density = b.pdf;
    }
    sum += DVec3(partOf(f, lobes)) / (nLight * pl + nBsdf * double(density));
  }
  return Vec3(sum / light.irradiance());
}

}  // namespace terms
}  // namespace gobo
