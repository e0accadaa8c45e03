// SPDX-License-Identifier: Apache-2.0
#include "trace/bsdf_layers.h"

namespace gobo {
inline namespace trace {
namespace {

constexpr float kCoatF0 = 0.04f;      // index 1.5
constexpr float kSheenFloor = 0.07f;  // smaller roughnesses are narrower than the table (and than a texel's worth of cloth)

bool seenFromInside(const BsdfParams& p) { return !p.entering && !p.thin && p.transmission > 0.0f && p.metallic < 1.0f; }
float coatAlpha(const BsdfParams& p) { return sqr(clamp01(p.clearcoatRoughness)); }

/// A coat normal that faces away from the viewer is turned until it just does not.
Vec3 facing(Vec3 n, const Vec3& o) {
  const float l = glm::dot(n, n);
  n = l > 1e-12f && isFinite(n) ? n / std::sqrt(l) : Vec3(0, 0, 1);
  const float c = glm::dot(n, o);
  if (c >= 0.01f) return n;
  n += (0.0101f - c) * o;
  const float m = glm::dot(n, n);
  return m > 1e-6f ? n / std::sqrt(m) : Vec3(0, 0, 1);
}

/// Charlie's lambda (Estevez & Kulla 2017).
float sheenLambda(float c, float alpha) {
  const float t = sqr(1.0f - alpha);
  const float a = 21.5473f + t * 3.7772f, b = 3.82987f - t * 0.50552f, p = 0.19823f - t * 0.03022f, d = -1.97760f + t * 0.70367f, e = -4.32054f - t * 0.53913f;
  const auto l = [&](float x) { return a / (1.0f + b * std::pow(x, p)) + d * x + e; };
  return c < 0.5f ? std::exp(l(c)) : std::exp(2.0f * l(0.5f) - l(1.0f - c));
}

}  // namespace

Layers::Layers(const BsdfParams& p, const Vec3& o) : inside(seenFromInside(p)), coatFrame(facing(p.clearcoatNormal, o)) {
  coat = clamp01(p.clearcoat);
  hasCoat = coat > 0.0f;
  sheenColor = Vec3(clamp01(p.sheenColor.x), clamp01(p.sheenColor.y), clamp01(p.sheenColor.z));
  sheenMost = maxComponent(sheenColor);
  hasSheen = sheenMost > 0.0f;
  coatSmooth = coatAlpha(p) < kDeltaAlpha;
  if (hasCoat && !coatSmooth) {
    g = Ggx(coatAlpha(p));
    table = ReflectionAlbedo(g.x, clamp01(p.clearcoatRoughness));
  }
  sheenRoughness = maxOf(clamp01(p.sheenRoughness), kSheenFloor);
  sheenAlpha = sqr(sheenRoughness);
  oc = coatFrame.toLocal(o);
  if (inside) return;
  if (hasCoat) coatO = 1.0f - coatAlbedo(oc.z);
  if (hasSheen) {
    const float e = sheenAlbedo(o.z, sheenRoughness);
    sheenScaleO = 1.0f / maxOf(e, 1.0f);
    sheenO = 1.0f - sheenMost * minOf(e, 1.0f);
  }
}

bool Layers::evaluable(const BsdfParams& p) {
  return !seenFromInside(p) && (maxComponent(p.sheenColor) > 0.0f || (p.clearcoat > 0.0f && coatAlpha(p) >= kDeltaAlpha));
}

float Layers::coatAlbedo(float mu) const {
  mu = clamp01(mu);
  if (coatSmooth) return coat * (kCoatF0 + (1.0f - kCoatF0) * schlickWeight(mu));
  const ReflectionAlbedo::Value a = table.at(mu);
  return coat * (kCoatF0 * (1.0f - a.deficit) + (1.0f - kCoatF0) * a.schlick);
}

void Layers::choose(float baseEnergy) {
  if (inside) return;
  float c = hasCoat ? maxOf(1.0f - coatO, 1e-6f) : 0.0f;
  float s = hasSheen ? maxOf(luminance(sheenColor) / sheenMost * (1.0f - sheenO) * coatO, 1e-6f) : 0.0f;
  float b = baseEnergy > 0.0f ? maxOf(baseEnergy * sheenO * coatO, 1e-6f) : 0.0f;
  const float floor = 0.1f * (c + s + b);
  if (c > 0.0f) c = maxOf(c, floor);
  if (s > 0.0f) s = maxOf(s, floor);
  if (b > 0.0f) b = maxOf(b, floor);
  const float scale = 1.0f / (c + s + b);
  coatP = c * scale;
  sheenP = s * scale;
  baseP = b * scale;
}

float Layers::passed(const Vec3& i) const {
  float coatI = 1.0f, sheenI = 1.0f;
  if (inside == (i.z < 0.0f)) {  // i is outside
    if (hasCoat) coatI = 1.0f - coatAlbedo(inside ? std::fabs(glm::dot(i, coatFrame.z)) : glm::dot(i, coatFrame.z));
    if (hasSheen) sheenI = 1.0f - sheenMost * minOf(sheenAlbedo(std::fabs(i.z), sheenRoughness), 1.0f);
  }
  return minOf(coatO, coatI) * minOf(sheenO, sheenI);
}

void Layers::evaluate(const Vec3& o, const Vec3& i, BsdfValue& value, float& pdf) const {
  if (inside) return;
  const Vec3 ic = coatFrame.toLocal(i);
  if (hasSheen) {
    const Vec3 m = o + i;
    const float len2 = glm::dot(m, m);
    if (len2 > 0.0f) {
      const float sin2 = clamp01((m.x * m.x + m.y * m.y) / len2), inv = 1.0f / sheenAlpha;
      const float d = (2.0f + inv) * std::pow(sin2, 0.5f * inv) * (0.5f * kInvPi);
      const float v = 0.25f / ((1.0f + sheenLambda(o.z, sheenAlpha) + sheenLambda(i.z, sheenAlpha)) * o.z);  // times i.z
      const float scale = minOf(sheenScaleO, 1.0f / maxOf(sheenAlbedo(i.z, sheenRoughness), 1.0f));
      value.specular += sheenColor * (d * v * scale * minOf(coatO, hasCoat ? 1.0f - coatAlbedo(ic.z) : 1.0f));
    }
    pdf += sheenP * (0.5f * kInvPi);
  }
  if (!hasCoat || coatSmooth || !(ic.z > 0.0f)) return;
  float f, density, c;
  if (!ggxReflection(g, oc, ic, f, density, c)) return;
  value.specular += Vec3(coat * (kCoatF0 + (1.0f - kCoatF0) * schlickWeight(c)) * f);
  pdf += coatP * density;
}

bool Layers::sample(float uLobe, const Vec2& u, BsdfSample& out) const {
  out.specularLobe = true;
  if (uLobe >= coatP) {
    const float phi = 2.0f * kPi * u.x, z = 1.0f - u.y, r = std::sqrt(maxOf(1.0f - z * z, 0.0f));
    out.wi = Vec3(r * std::cos(phi), r * std::sin(phi), z);
    return z > 0.0f;
  }
  const Vec3 h = coatSmooth ? Vec3(0, 0, 1) : g.sample(oc, u);
  const float c = glm::dot(oc, h);
  if (!(c > 0.0f)) return false;
  const Vec3 ic = 2.0f * c * h - oc;
  out.wi = glm::normalize(coatFrame.toWorld(ic));
  if (!(ic.z > 0.0f) || !(out.wi.z > 0.0f)) return false;
  if (coatSmooth) {
    out.delta = true;
    out.weight = Vec3((1.0f - coatO) / coatP);
  }
  return true;
}

}  // namespace trace
}  // namespace gobo
