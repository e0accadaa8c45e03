// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/elongation.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/surface_links.h"
#include "terms/gbuffer.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr float kLeastSlant = 1e-3f;  // sine between light and normal below which its direction along the surface is rounding
constexpr float kLineTurn = 0.25f;    // widths of a pixel that a surface leaves the line by before it is laid anew
constexpr int kSamplesBetweenStops = 64;

/// The picture of points of a layer, in samples: (x, y) is where sample (x, y) looks.
class SampleFilm {
 public:
  SampleFilm(const StyleElongationSettings& s, int layer) : camera_(s.camera) {
    const Vec2 offset = viewSamplePosition(layer, s.extent.layers);
    shift_ = glm::dvec2(double(s.place.x) + double(offset.x), double(s.place.y) + double(offset.y));
    width_ = s.place.whole() ? s.extent.width : s.place.filmWidth;
    height_ = s.place.whole() ? s.extent.height : s.place.filmHeight;
    const Camera& c = camera_;
    const double tall = double(height_), wide = tall / double(c.optics.pixelAspect), window = c.windowHeight64();
    const DVec3 right(c.toWorld[0]), up(c.toWorld[1]), forward = -DVec3(c.toWorld[2]);
    const double left = 0.5 * width_ - double(c.centre.x) * wide - shift_.x, top = 0.5 * height_ + double(c.centre.y) * tall - shift_.y;
    origin_ = DVec3(c.toWorld[3]);
    X_ = right * (wide / window), Y_ = up * (-tall / window);
    if (c.perspective) X_ += forward * left, Y_ += forward * top, Z_ = forward;
    else X0_ = left, Y0_ = top, Z0_ = 1.0;
  }
  bool panorama() const { return camera_.optics.panorama; }
  /// Of a point before and a direction: (X, Y, Z) of it, whose place in the picture is (X, Y) / Z. Not of panoramas.
  DVec3 point(const DVec3& P) const {
    const DVec3 d = P - origin_;
    return direction(d) + DVec3(X0_, Y0_, Z0_);
  }
  DVec3 direction(const DVec3& d) const { return DVec3(glm::dot(d, X_), glm::dot(d, Y_), glm::dot(d, Z_)); }
  /// Of panoramas.
  bool around(const DVec3& P, glm::dvec2& film) const {
    if (!filmPosition(camera_, width_, height_, glm::dvec4(P, 1.0), film)) return false;
    film -= shift_;
    return true;
  }
  /// Way along any direction in which a panorama moves by a pixel at most.
  double panoramaStep(const DVec3& P) const {
    const DVec3 d = P - origin_;
    const double up = glm::dot(d, DVec3(camera_.toWorld[1])), far2 = glm::dot(d, d);
    const double level = std::sqrt(std::max(far2 - up * up, 1e-4 * far2));
    return std::min(std::sqrt(far2) * M_PI / height_, level * 2.0 * M_PI / width_);
  }
  double filmWidth() const { return width_; }

 private:
  const Camera& camera_;
  glm::dvec2 shift_{0.0};
  int width_ = 0, height_ = 0;
  DVec3 origin_{0.0}, X_{0.0}, Y_{0.0}, Z_{0.0};
  double X0_ = 0, Y0_ = 0, Z0_ = 0;
};

/// A line through a surface point, and its picture.
struct TangentLine {
  DVec3 P{0.0};
  Vec3 N{0.0f}, t{0.0f};
  DVec3 from{0.0}, slope{0.0};  ///< of the film, not of panoramas
};

/// What the picture shows at a place of it.
struct ShownSample {
  Vec3 P{0.0f}, N{0.0f};
  float D = 0, footprint = 0;
};

struct ElongationLayer {
  const StyleElongationSettings& s;
  const ContourInput& in;
  const SurfaceLinks& links;
  const SampleFilm& film;
  std::span<const float> D;
  float cosine;

  bool lay(const Vec3& P, const Vec3& N, TangentLine& line) const {
    if (!s.light.along(P, N, line.t)) return false;
    line.P = DVec3(P), line.N = N;
    if (!film.panorama()) line.from = film.point(line.P), line.slope = film.direction(DVec3(line.t));
    return true;
  }
  /// Place in the picture of the line's point s behind its own; false: not seen.
  bool placed(const TangentLine& line, double at, glm::dvec2& g) const {
    if (film.panorama()) return film.around(line.P - at * DVec3(line.t), g);
    const DVec3 q = line.from - at * line.slope;
    if (!(q.z > 0.0)) return false;
    g = glm::dvec2(q.x / q.z, q.y / q.z);
    return true;
  }
  /// Way from there on in which the picture moves by a pixel.
  double step(const TangentLine& line, double at) const {
    if (film.panorama()) return film.panoramaStep(line.P - at * DVec3(line.t));
    const DVec3 q = line.from - at * line.slope;
    // (X, Y) / Z at `at` and at `at + d` are d |c| / (Z (Z + d Z')) apart.
    const double change = std::hypot(line.slope.x * q.z - line.slope.z * q.x, line.slope.y * q.z - line.slope.z * q.y);
    const double left = change + line.slope.z * q.z;
    return left > 0.0 ? q.z * q.z / left : HUGE_VAL;  // else it never moves so far: a vanishing point is nearer
  }

  bool show(const glm::dvec2& g, ShownSample& out) const {
    const double x = std::clamp(g.x, 0.0, double(in.width - 1)), y = std::clamp(g.y, 0.0, double(in.height - 1));
    const int x0 = std::min(int(x), std::max(in.width - 2, 0)), y0 = std::min(int(y), std::max(in.height - 2, 0));
    const float u = float(x - x0), v = float(y - y0);
    const size_t w = size_t(in.width), e = size_t(y0) * w + size_t(x0), near = e + (u >= 0.5f ? 1 : 0) + (v >= 0.5f ? w : 0);
    if (!in.valid(near)) return false;
    out.N = in.at(in.N, near);
    out.footprint = in.footprint[near];
    constexpr uint8_t kCell = 1 << kRight | 1 << kBelowRight | 1 << kBelow;
    out.P = in.at(in.P, near), out.D = D[near];
    if ((links.bits(e) & kCell) != kCell) return true;
    const float a = (1.0f - u) * (1.0f - v), b = u * (1.0f - v), c = (1.0f - u) * v, d = u * v;
    out.P = in.at(in.P, e) * a + in.at(in.P, e + 1) * b + in.at(in.P, e + w) * c + in.at(in.P, e + w + 1) * d;
    const float De = D[e], Df = D[e + 1], Dg = D[e + w], Dh = D[e + w + 1];
    if (std::max({std::abs(De), std::abs(Df), std::abs(Dg), std::abs(Dh)}) < kStyleFar) out.D = De * a + Df * b + Dg * c + Dh * d;
    return true;
  }

  float walk(size_t e) const {
    float least = D[e];
    TangentLine line;
    const Vec3 own = in.at(in.N, e);
    if (!in.valid(e) || !lay(in.at(in.P, e), own, line)) return least;
    double rest = double(s.length), at = 0;  // of the walk behind the line's point, and how far it is from there
    const int most = 2 * (in.width + in.height) + 16;
    for (int k = 0; k < most && at < rest; ++k) {
      at = std::min(rest, at + step(line, at));
      glm::dvec2 g;
      if (!placed(line, at, g)) break;
      if (film.panorama()) g.x -= film.filmWidth() * std::floor((g.x + 0.5) / film.filmWidth());
      if (!(g.x >= -0.5 && g.y >= -0.5 && g.x <= in.width - 0.5 && g.y <= in.height - 0.5)) break;
      ShownSample shown;
      if (!show(g, shown) || glm::dot(shown.N, own) < cosine) continue;
      const DVec3 there = line.P - at * DVec3(line.t);
      const float off = float(std::abs(glm::dot(DVec3(shown.P) - there, DVec3(line.N)))), width = std::max(shown.footprint, in.footprint[e]);
      if (!(off <= width)) continue;
      least = std::min(least, shown.D);
      if (off <= kLineTurn * width) continue;
      rest -= at, at = 0;
      if (!lay(shown.P, shown.N, line)) break;
    }
    return least;
  }
};

class StyleElongationNode final : public Node {
 public:
  explicit StyleElongationNode(const StyleElongationSettings& s) : s_(s) { GOBO_CHECK(s.length >= 0.0f); }
  std::string type() const override { return "style_elongation"; }
  int version() const override { return 1; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.length).add(s_.angle).add(s_.light.atInfinity).add(s_.light.place.x).add(s_.light.place.y).add(s_.light.place.z);
    hashCamera(h, s_.camera);
    s_.place.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent);
    w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 35.0 * 40.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto from = ctx.inputs.at(0)->floats("D");
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height), w = size_t(s_.extent.width);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      const ContourInput in = surfaceInput(*ctx.inputs.at(1), layer);
      GOBO_ASSIGN(const SurfaceLinks links, SurfaceLinks::of(in, cosine, *ctx.arena, ctx.stop));
      const SampleFilm film(s_, int(layer));
      const ElongationLayer walks{s_, in, links, film, from.subspan(layer * count, count), cosine};
      const auto out = D.subspan(layer * count, count);
      const bool complete = ctx.arena->parallelFor(
          size_t(in.height), 1,
          [&](size_t begin, size_t end) {
            for (size_t e = begin * w; e < end * w; ++e) {
              if (e % kSamplesBetweenStops == 0 && ctx.stop.stopRequested()) return;
              const float d = walks.walk(e);
              out[e] = d == 0.0f ? kLeastStyleDistance : d;  // between samples it may be
            }
          },
          ctx.stop);
      if (!complete || ctx.stop.stopRequested()) return Status(Code::Cancelled, "style_elongation: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  StyleElongationSettings s_;
};

}  // namespace

bool StyleLight::along(const Vec3& P, const Vec3& N, Vec3& t) const {
  const DVec3 way = atInfinity ? DVec3(place) : DVec3(P) - DVec3(place), n(N), tangent = way - n * glm::dot(way, n);
  const double length = glm::length(tangent);
  if (!(length > double(kLeastSlant) * glm::length(way))) return false;
  t = Vec3(tangent / length);
  return true;
}

NodePtr makeStyleElongationNode(const StyleElongationSettings& settings) { return std::make_shared<StyleElongationNode>(settings); }

}  // namespace filters
}  // namespace gobo
