// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/averaged_distance.h"
#include "formulas/math.glsl.h"

namespace gobo {

namespace {

constexpr float kReach = 3.0f, kPerSigma = 3.0f;

/// Area that sample e stands for: of the parallelogram to its neighbours on the surface.
float areaOf(const ContourInput& in, int x, int y, float cosine) {
  const size_t w = size_t(in.width), e = size_t(y) * w + size_t(x);
  const Vec3 P = in.at(in.P, e);
  const auto step = [&](bool after, size_t next, bool before, size_t last) {
    if (after && onOneSurface(in, e, next, cosine)) return in.at(in.P, next) - P;
    if (before && onOneSurface(in, e, last, cosine)) return P - in.at(in.P, last);
    return Vec3(0.0f);
  };
  const float area = glm::length(glm::cross(step(x + 1 < in.width, e + 1, x > 0, e - 1), step(y + 1 < in.height, e + w, y > 0, e - w)));
  return area > 0.0f ? area : in.footprint[e] * in.footprint[e];
}

class StyleAbstractionNode final : public Node {
 public:
  explicit StyleAbstractionNode(const StyleAbstractionSettings& s) : s_(s) { GOBO_CHECK(s.sigma >= 0.0f); }
  std::string type() const override { return "style_abstraction"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.sigma);
    h.add(s_.angle);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent);
    w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height) * sizeof(float); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 1000.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs.at(1);
    const auto from = ctx.inputs.at(0)->floats("D");
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle);
    std::vector<float> area(count);
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      ContourInput in;
      in.width = s_.extent.width;
      in.height = s_.extent.height;
      in.P = g.floats("P").subspan(layer * count * 3, count * 3);
      in.N = g.floats("N").subspan(layer * count * 3, count * 3);
      in.Ng = g.floats("Ng").subspan(layer * count * 3, count * 3);
      in.footprint = g.floats("footprint").subspan(layer * count, count);
      in.instance = g.plane<uint32_t>("instance").subspan(layer * count, count);
      const auto d = from.subspan(layer * count, count);
      const auto out = D.subspan(layer * count, count);
      const auto rows = [&](const auto& body) {
        return ctx.arena->parallelFor(
            size_t(in.height), 1,
            [&](size_t begin, size_t end) {
              for (size_t y = begin; y < end; ++y)
                for (int x = 0; x < in.width; ++x) body(x, int(y), y * size_t(in.width) + size_t(x));
            },
            ctx.stop);
      };
      const bool complete = rows([&](int x, int y, size_t e) { area[e] = in.valid(e) ? areaOf(in, x, y, cosine) : 0.0f; }) &&
                            rows([&](int x, int y, size_t e) { out[e] = in.valid(e) ? smoothed(in, d, area, x, y, cosine) : d[e]; });
      if (!complete) return Status(Code::Cancelled, "style_abstraction: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  float smoothed(const ContourInput& in, std::span<const float> d, const std::vector<float>& area, int x, int y, float cosine) const {
    const size_t e = size_t(y) * size_t(in.width) + size_t(x);
    const float width = in.footprint[e];
    if (s_.sigma == 0.0f || std::abs(d[e]) >= kStyleFar || !(width > 0.0f)) return d[e];
    const float pixels = std::min(s_.sigma / width, 1e6f);  // of sigma
    const int stride = std::max(int(pixels / kPerSigma), 1), taps = int(kReach * pixels / float(stride));
    const int left = std::min(taps, x / stride), right = std::min(taps, (in.width - 1 - x) / stride);
    const int up = std::min(taps, y / stride), down = std::min(taps, (in.height - 1 - y) / stride);
    const Vec3 P = in.at(in.P, e), N = in.at(in.N, e);
    const float reach2 = kReach * kReach, scale = 1.0f / s_.sigma;
    double sum = 0, weights = 0;
    for (int v = -up; v <= down; ++v)
      for (int u = -left; u <= right; ++u) {
        const size_t f = size_t(y + v * stride) * size_t(in.width) + size_t(x + u * stride);
        const Vec3 step = (in.at(in.P, f) - P) * scale;
        const float r2 = glm::dot(step, step);
        if (!(area[f] > 0.0f) || !(r2 <= reach2) || std::abs(d[f]) >= kStyleFar || (f != e && glm::dot(N, in.at(in.N, f)) < cosine)) continue;
        const double w = double(formulas::fastExp(-0.5f * r2)) * double(area[f]);
        sum += w * double(d[f]);
        weights += w;
      }
    return weights > 0 ? float(sum / weights) : d[e];
  }

  StyleAbstractionSettings s_;
};

}  // namespace

NodePtr makeStyleAbstractionNode(const StyleAbstractionSettings& settings) { return std::make_shared<StyleAbstractionNode>(settings); }

}  // namespace gobo
