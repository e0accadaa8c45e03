// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/surface_distance.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/averaged_distance.h"
#include "filters/stylised/surface_march.h"
#include "filters/stylised/unfolded_links.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kLayersAtOnce = 4;  // bounds what is held
constexpr double kMarchNs = 3000.0;

class SurfaceDistanceNode final : public Node {
 public:
  explicit SurfaceDistanceNode(const StyleDistanceSettings& s) : s_(s) { GOBO_CHECK(s.level >= 0 && s.level < s.levels); }
  std::string type() const override { return "style_surface_distance"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.angle);
    if (s_.levels > 1) h.add("level").add(s_.level).add(s_.levels);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    readsContour(w, s_);
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override {  // links twice while they are made
    const size_t layers = std::min(size_t(s_.extent.layers), kLayersAtOnce);
    return layers * size_t(s_.extent.width) * size_t(s_.extent.height) * (2 * 2 * (sizeof(ContourSegment) + sizeof(uint32_t)) + kMarchBytes + 2);
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * kMarchNs * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &visibility = *ctx.inputs.at(0), &g = *ctx.inputs.at(1);
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height), layers = size_t(s_.extent.layers);
    for (size_t first = 0; first < layers; first += kLayersAtOnce) {
      std::array<Status, kLayersAtOnce> status;
      const bool complete = ctx.arena->parallelFor(
          std::min(kLayersAtOnce, layers - first), 1,
          [&](size_t begin, size_t end) {
            for (size_t k = begin; k < end; ++k)
              status[k] = runLayer(ctx, contourInput(visibility, g, first + k, s_.level, s_.levels), D.subspan((first + k) * count, count));
          },
          ctx.stop);
      for (const Status& s : status) GOBO_TRY(s);
      if (!complete) return Status(Code::Cancelled, "style_surface_distance: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  Status runLayer(const RunContext& ctx, const ContourInput& in, std::span<float> D) const {
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    std::vector<uint32_t> squares;
    GOBO_ASSIGN(const std::vector<ContourSegment> contour, extractContour(in, cosine, *ctx.arena, ctx.stop, &squares));
    GOBO_ASSIGN(const std::vector<uint8_t> links, surfaceLinks(in, cosine, *ctx.arena, ctx.stop));
    GOBO_ASSIGN(const std::vector<double> distance, marchSurface(in, links, contour, squares, cosine, ctx.stop));
    for (size_t e = 0; e < D.size(); ++e) {
      if (!in.valid(e)) {
        D[e] = kStyleFar;
        continue;
      }
      const float magnitude = std::clamp(float(std::min(distance[e], double(kStyleFar))), kLeastStyleDistance, kStyleFar);
      D[e] = in.lit(e) ? magnitude : -magnitude;
    }
    return {};
  }

  StyleDistanceSettings s_;
};

}  // namespace

NodePtr makeSurfaceDistanceNode(const StyleDistanceSettings& settings) { return std::make_shared<SurfaceDistanceNode>(settings); }

}  // namespace filters
}  // namespace gobo
