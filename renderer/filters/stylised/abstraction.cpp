// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/abstraction_kernels.h"
#include "filters/stylised/averaged_distance.h"
#include "filters/stylised/contour.h"

namespace gobo {

namespace {

constexpr float kReach = 3.0f, kPerSigma = 3.0f;
constexpr float kLeastArea = 1e-30f, kMostArea = 1e4f;  // in units of sigma^2: sums of areas times distances stay in float
constexpr int kRun = 128;                               // most pixels of a run

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
  int version() const override { return 2; }  // 2: a round window, sums of differences
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    if (!s_.varies) h.add(s_.sigma);
    h.add(s_.angle);
    if (s_.varies) h.add("varies");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, s_.varies ? 3 : 2);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent);
    w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    if (s_.varies) w.over(2, s_.extent).reads<float>(2, "abstraction");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height) * kPlanes * sizeof(float); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs.at(1);
    const auto from = ctx.inputs.at(0)->floats("D");
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    const auto varying = s_.varies ? ctx.inputs.at(2)->floats("abstraction") : std::span<const float>();
    const float unit = s_.varies ? *std::max_element(varying.begin(), varying.end()) : s_.sigma;  // of the planes
    if (!(unit > 0.0f)) {
      std::copy(from.begin(), from.end(), D.begin());
      return TermPtr(ctx.result);
    }
    std::vector<float> planes(kPlanes * count);
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      const ContourInput in = surfaceInput(g, layer);
      const Widths widths{unit, s_.varies ? varying.subspan(layer * count, count) : varying};
      const auto d = from.subspan(layer * count, count);
      const auto out = D.subspan(layer * count, count);
      const auto rows = [&](const auto& body) {
        return ctx.arena->parallelFor(
            size_t(in.height), 1,
            [&](size_t begin, size_t end) {
              for (size_t y = begin; y < end; ++y) body(int(y));
            },
            ctx.stop);
      };
      if (!rows([&](int y) { separate(in, d, y, cosine, widths, planes); }) || !rows([&](int y) { smoothRow(in, d, planes, y, cosine, widths, out); }))
        return Status(Code::Cancelled, "style_abstraction: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  static constexpr size_t kPlanes = 9;

  /// Standard deviations: places are in units of the largest.
  struct Widths {
    float unit;
    std::span<const float> varying;
    float at(size_t e) const { return varying.empty() ? unit : varying[e]; }
  };

  /// Row y of the planes. Samples without a distance have no area.
  void separate(const ContourInput& in, std::span<const float> d, int y, float cosine, const Widths& widths, std::vector<float>& planes) const {
    const size_t count = in.instance.size();
    const float scale = 1.0f / widths.unit;
    for (int x = 0; x < in.width; ++x) {
      const size_t e = size_t(y) * size_t(in.width) + size_t(x);
      const bool counts = in.valid(e) && std::abs(d[e]) < kStyleFar;
      const Vec3 P = counts ? in.at(in.P, e) * scale : Vec3(0.0f), N = in.at(in.N, e);
      const float area = counts ? std::clamp(areaOf(in, x, y, cosine) * scale * scale, kLeastArea, kMostArea) : 0.0f;
      const float value[kPlanes] = {
          P.x, P.y, P.z, N.x, N.y, N.z, area, counts ? d[e] : 0.0f, std::min((widths.unit / widths.at(e)) * (widths.unit / widths.at(e)), 1e30f)};
      for (size_t k = 0; k < kPlanes; ++k) planes[k * count + e] = value[k];
    }
  }

  static float pixelsOfSigma(const ContourInput& in, const Widths& widths, size_t e) {
    return in.footprint[e] > 0.0f ? std::min(widths.at(e) / in.footprint[e], 1e6f) : 0.0f;
  }

  /// Runs of pixels that take every same sample, with the window of the one that sees most: what is beyond 3 sigma of a pixel does not count anyway.
  void smoothRow(const ContourInput& in, std::span<const float> d, const std::vector<float>& planes, int y, float cosine, const Widths& widths,
                 std::span<float> out) const {
    const size_t count = in.instance.size(), row = size_t(y) * size_t(in.width);
    const float* first = planes.data();
    const AbstractionPlanes p{first,
                              first + count,
                              first + 2 * count,
                              first + 3 * count,
                              first + 4 * count,
                              first + 5 * count,
                              first + 6 * count,
                              first + 7 * count,
                              widths.varying.empty() ? nullptr : first + 8 * count};
    float sums[kRun], weights[kRun];
    for (int begin = 0, end = 0; begin < in.width; begin = end) {
      int stride = 0;
      float most = 0;  // pixels of sigma
      for (end = begin; end < std::min(begin + kRun, in.width); ++end) {
        const size_t e = row + size_t(end);
        if (p.area[e] == 0.0f || !(widths.at(e) > 0.0f)) continue;
        const float pixels = pixelsOfSigma(in, widths, e);
        const int step = std::max(int(pixels / kPerSigma), 1);
        if (stride != 0 && step != stride) break;
        stride = step;
        most = std::max(most, pixels);
      }
      for (int x = begin; x < end; ++x) sums[x - begin] = 0, weights[x - begin] = p.area[row + size_t(x)];
      if (stride != 0) {
        const float reach = kReach * most / float(stride);
        const int taps = int(reach);
        for (int v = -std::min(taps, y / stride); v <= std::min(taps, (in.height - 1 - y) / stride); ++v) {
          const int across = int(std::sqrt(std::max(reach * reach - float(v * v), 0.0f)) + 0.5f);
          for (int u = -across; u <= across; ++u) {
            if (u == 0 && v == 0) continue;
            const int64_t shift = int64_t(u) * stride, from = std::max<int64_t>(begin, -shift), to = std::min<int64_t>(end, in.width - shift);
            if (from >= to) continue;
            addOffset(p, row + size_t(from), ptrdiff_t(v) * stride * in.width + ptrdiff_t(shift), size_t(to - from), kReach * kReach, cosine,
                      sums + (from - begin), weights + (from - begin));
          }
        }
      }
      for (int x = begin; x < end; ++x) {
        const size_t e = row + size_t(x);
        out[e] = p.area[e] > 0.0f ? d[e] + sums[x - begin] / weights[x - begin] : d[e];
      }
    }
  }

  StyleAbstractionSettings s_;
};

}  // namespace

NodePtr makeStyleAbstractionNode(const StyleAbstractionSettings& settings) { return std::make_shared<StyleAbstractionNode>(settings); }

}  // namespace gobo
