// SPDX-License-Identifier: Apache-2.0
// What the nodes of subtractive shadows see of a view sample, and which traced samples speak for it.
#pragma once

#include <algorithm>
#include <cmath>

#include "terms/gbuffer.h"
#include "terms/surface.h"
#include "terms/unoccluded_light.h"

namespace gobo::subtractive {

/// How shadows are resampled; all lengths on the surface are in pixels of the shadows' resolution.
struct Resampling {
  int resolution = 1;          ///< r: samples of every r-th pixel of every r-th row of the film are traced; 1: all, and nothing is resampled
  float width = 0.7f;          ///< standard deviation of the Gaussian over world distance
  float cosine = 0.8660254f;   ///< least one between normals
  float planeDistance = 0.5f;  ///< farthest off the tangent plane
  /// Pixels that are looked at to each side: two standard deviations.
  int reach() const { return resolution == 1 ? 0 : resolution * std::max(1, int(std::ceil(2.0f * width))); }
  void hash(Hasher& h) const { h.add(resolution).add(width).add(cosine).add(planeDistance); }
};

/// Least sum of weights that counts: 4 standard deviations from everything that was traced.
inline constexpr float kLeastWeight = 1e-4f;
/// Albedo below which materials are evaluated for this one, so that what was traced at a black texel speaks for the others.
inline constexpr float kLeastAlbedo = 0.02f;

/// Views of a G-buffer and its surface term, which must outlive it.
struct Receivers {
  Receivers(const Term& g, const Term& s, const GBufferSettings& v)
      : view(v),
        eye(v.camera.toWorld[3]),
        back(v.camera.toWorld[2]),
        P(g.floats("P")),
        Ng(g.floats("Ng")),
        footprint(g.floats("footprint")),
        N(s.floats("N")),
        albedo(s.floats("albedo")),
        material(s.floats("material")),
        instance(g.plane<uint32_t>("instance")),
        flags(s.plane<uint8_t>("flags")) {}
  static void reads(Wiring& w, const GBufferSettings& view) {
    w.over(0, view.extent()).reads<float>(0, "P", {3}).reads<float>(0, "Ng", {3}).reads<float>(0, "footprint").reads<uint32_t>(0, "instance");
    w.over(1, view.extent()).reads<float>(1, "N", {3}).reads<float>(1, "albedo", {3}).reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
  }
  static Vec3 at(std::span<const float> v, size_t e) { return Vec3(v[3 * e], v[3 * e + 1], v[3 * e + 2]); }

  /// Something that reflects light other than as a mirror.
  bool lit(size_t e) const { return instance[e] != ~0u && !(flags[e] & (kSurfaceUnlit | kSurfaceExtended)) && !bsdfIsDelta(bsdf(e)); }
  Vec3 out(size_t e) const { return view.camera.perspective ? glm::normalize(eye - at(P, e)) : back; }
  BsdfParams bsdf(size_t e) const {
    BsdfParams b;
    b.albedo = at(albedo, e);
    b.metallic = material[5 * e];
    b.roughness = material[5 * e + 1];
    b.specular = material[5 * e + 2];
    b.ior = material[5 * e + 3];
    b.transmission = material[5 * e + 4];
    b.entering = (flags[e] & kSurfaceEntering) != 0;
    return b;
  }
  /// For light that arrives, with this material.
  LitPoint point(size_t e, const BsdfParams& b) const {
    LitPoint out;
    out.p = at(P, e);
    out.n = at(N, e);
    out.ng = at(Ng, e);
    out.wo = this->out(e);
    out.bsdf = b;
    if (!out.lambert() && out.n != out.ng) out.bsdf.facing = out.frame().toLocal(out.ng);
    return out;
  }
  /// What the lobes reflect of light from everywhere, but for glass.
  LobeAlbedos albedos(size_t e, const BsdfParams& b) const { return bsdfLobeAlbedos(b, std::clamp(glm::dot(at(N, e), out(e)), 1e-3f, 1.0f)); }
  /// What light is divided by before it is resampled, and multiplied with after: these, and of glass the gloss of the same material if it let nothing through.
  /// Where both are of one place they cancel, so any number does that is as smooth as the lobe.
  LobeAlbedos divisors(size_t e, BsdfParams b) const {
    LobeAlbedos out = albedos(e, b);
    if (!(b.transmission > 0.0f)) return out;
    b.transmission = 0.0f;
    out.specular = albedos(e, b).specular;
    return out;
  }

  const GBufferSettings& view;
  Vec3 eye, back;
  std::span<const float> P, Ng, footprint, N, albedo, material;
  std::span<const uint32_t> instance;
  std::span<const uint8_t> flags;
};

/// Whether the samples of this pixel of the film are traced whatever they see: the middle of its block.
inline bool onGrid(const Resampling& r, const GBufferSettings& view, int x, int y) {
  const int middle = r.resolution / 2;
  return (x + view.place.x) % r.resolution == middle && (y + view.place.y) % r.resolution == middle;
}

/// Calls f(q, weight) for each traced sample on the grid that speaks for sample e at (x, y): those of its own place within the pixel. q's shadows count by
/// a Gaussian of the distance in the world times the cosine between the normals, both 0 beyond their bounds. Joint bilateral: Kopf et al. 2007.
template <class F>
void forNeighbours(const Resampling& r, const Receivers& in, int x, int y, size_t e, F&& f) {
  const int width = in.view.width, height = in.view.height, step = r.resolution, middle = step / 2, reach = r.reach();
  const Vec3 p = Receivers::at(in.P, e), n = Receivers::at(in.N, e), ng = Receivers::at(in.Ng, e);
  // A pixel of a tilted surface is longer than it is wide.
  const float texel = in.footprint[e] * float(step) / std::max(glm::dot(ng, in.out(e)), 0.2f);
  if (!(texel > 0.0f)) return;
  const float scale = 1.0f / (r.width * texel), farthest = r.planeDistance * texel;
  // The first of the grid's rows and columns at or after the window's.
  const auto first = [&](int from, int placed) {
    const int at = (from + placed - middle) % step;
    return at <= 0 ? from - at : from + step - at;
  };
  const size_t layer = e / (size_t(width) * size_t(height)) * size_t(width) * size_t(height);
  for (int v = first(std::max(y - reach, 0), in.view.place.y); v <= std::min(y + reach, height - 1); v += step)
    for (int u = first(std::max(x - reach, 0), in.view.place.x); u <= std::min(x + reach, width - 1); u += step) {
      const size_t q = layer + size_t(v) * size_t(width) + size_t(u);
      if (in.instance[q] == ~0u) continue;
      const float turned = glm::dot(n, Receivers::at(in.N, q));
      if (turned < r.cosine) continue;
      const Vec3 d = Receivers::at(in.P, q) - p;
      if (std::abs(glm::dot(d, ng)) > farthest) continue;
      const Vec3 scaled = d * scale;
      const float exponent = 0.5f * glm::dot(scaled, scaled);
      if (exponent < 20.0f && in.lit(q)) f(q, std::exp(-exponent) * turned);
    }
}

}  // namespace gobo::subtractive
