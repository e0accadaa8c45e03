// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/target.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/pieces.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr int kTargetSquare = 16;  // samples, each way, that seek their targets together

/// A square's samples: a ball around them and a cone around their normals.
struct SampleBall {
  DVec3 centre{0.0};
  double radius = 0;
  DVec3 axis{0.0};
  double spread = 0;  ///< radians
  bool any = false;
};

struct TargetLayer {
  const ContourInput& in;
  const ShadowPieces& all;
  std::span<const float> from;
  float target, cosine;
  double angle;

  template <class Body>
  void over(int x0, int y0, const Body& body) const {
    for (int y = y0; y < std::min(y0 + kTargetSquare, in.height); ++y)
      for (int x = x0; x < std::min(x0 + kTargetSquare, in.width); ++x) body(size_t(y) * size_t(in.width) + size_t(x));
  }

  SampleBall ball(int x0, int y0) const {
    SampleBall b;
    DVec3 low(HUGE_VAL), high(-HUGE_VAL), normals(0.0);
    over(x0, y0, [&](size_t e) {
      if (!in.valid(e)) return;
      b.any = true;
      low = glm::min(low, DVec3(in.at(in.P, e)));
      high = glm::max(high, DVec3(in.at(in.P, e)));
      normals += DVec3(in.at(in.N, e));
    });
    if (!b.any) return b;
    b.centre = 0.5 * (low + high);
    const double n = glm::length(normals);
    b.axis = n > 0 ? normals / n : DVec3(0.0);
    double least = n > 0 ? 1 : -1;
    over(x0, y0, [&](size_t e) {
      if (!in.valid(e)) return;
      b.radius = std::max(b.radius, glm::length(DVec3(in.at(in.P, e)) - b.centre));
      least = std::min(least, glm::dot(b.axis, DVec3(in.at(in.N, e))));
    });
    b.spread = std::acos(std::clamp(least, -1.0, 1.0));
    return b;
  }

  /// Pieces that may have the nearest target of some sample in the ball.
  void candidates(const SampleBall& b, std::vector<uint32_t>& out) const {
    out.clear();
    double surely = HUGE_VAL;  // farthest that the nearest one is from any of them
    for (const ShadowPiece& p : all.pieces)
      if (p.whole && std::acos(std::clamp(glm::dot(b.axis, DVec3(p.normal)), -1.0, 1.0)) + b.spread < angle)
        surely = std::min(surely, glm::length(p.centre - b.centre) + b.radius);
    for (size_t k = 0; k < all.pieces.size(); ++k)
      if (const ShadowPiece& p = all.pieces[k]; p.whole && glm::length(p.centre - b.centre) - b.radius - p.reach() <= surely) out.push_back(uint32_t(k));
  }

  float at(size_t e, const std::vector<uint32_t>& near) const {
    if (!in.valid(e) || !(std::abs(from[e]) < kStyleFar)) return from[e];
    const DVec3 x(in.at(in.P, e));
    const Vec3 n = in.at(in.N, e);
    double T = HUGE_VAL;
    const uint32_t own = all.label[e];
    if (own != ShadowPieces::kNone && all.pieces[own].whole) T = distanceToTarget(all.pieces[own], x);
    for (const uint32_t k : near) {
      const ShadowPiece& p = all.pieces[k];
      if (k == own || glm::dot(p.normal, n) < cosine || glm::length(x - p.centre) - p.reach() >= T) continue;
      T = std::min(T, distanceToTarget(p, x));
    }
    if (!(T < HUGE_VAL)) return from[e];
    const float D = float((1.0 - double(target)) * double(from[e]) + double(target) * T);
    return D == 0.0f ? kLeastStyleDistance : D;
  }

  void square(int x0, int y0, std::vector<uint32_t>& near, std::span<float> D) const {
    const SampleBall b = ball(x0, y0);
    if (b.any) candidates(b, near);
    over(x0, y0, [&](size_t e) { D[e] = at(e, near); });
  }
};

class StyleTargetNode final : public Node {
 public:
  explicit StyleTargetNode(const StyleTargetSettings& s) : s_(s) {
    GOBO_CHECK(s.target >= 0.0f && s.target <= 1.0f && s.angularity >= 0.0f && s.angularity <= 1.0f);
  }
  std::string type() const override { return "style_target"; }
  int version() const override { return 1; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(s_.target).add(s_.angularity).add(s_.angle); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent);
    w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height) * 200; }  // pieces of one pixel each
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 500.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto from = ctx.inputs.at(0)->floats("D");
    const auto D = ctx.result->writable<float>("D");
    if (s_.target == 0.0f) {
      std::copy(from.begin(), from.end(), D.begin());
      return TermPtr(ctx.result);
    }
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      const ContourInput in = surfaceInput(*ctx.inputs.at(1), layer);
      const auto d = from.subspan(layer * count, count);
      const auto out = D.subspan(layer * count, count);
      GOBO_ASSIGN(const SurfaceLinks links, SurfaceLinks::of(in, cosine, *ctx.arena, ctx.stop));
      GOBO_ASSIGN(const ShadowPieces pieces, shadowPieces(in, links, d, double(s_.angularity), ctx.stop));
      const TargetLayer layerOf{in, pieces, d, s_.target, cosine, double(s_.angle)};
      const size_t across = size_t(in.width + kTargetSquare - 1) / kTargetSquare, down = size_t(in.height + kTargetSquare - 1) / kTargetSquare;
      const bool complete = ctx.arena->parallelFor(
          across * down, 1,
          [&](size_t begin, size_t end) {
            std::vector<uint32_t> near;
            for (size_t k = begin; k < end; ++k) layerOf.square(int(k % across) * kTargetSquare, int(k / across) * kTargetSquare, near, out);
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "style_target: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  StyleTargetSettings s_;
};

}  // namespace

NodePtr makeStyleTargetNode(const StyleTargetSettings& settings) { return std::make_shared<StyleTargetNode>(settings); }

}  // namespace filters
}  // namespace gobo
