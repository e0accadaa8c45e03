// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/sampled_distance.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/stylised/hidden_contours.h"
#include "filters/stylised/sampled_sums.h"
#include "filters/stylised/screen_metric.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr uint32_t kPollPoints = 1 << 16;  // about a millisecond
constexpr double kSampleNs = 20.0;

class SampledDistanceNode final : public Node {
 public:
  explicit SampledDistanceNode(const SampledDistanceSettings& s) : s_(s) {
    GOBO_CHECK(s.distance.power >= 2 && s.distance.power <= 64 && s.samples >= 1);
    GOBO_CHECK(s.distance.level >= 0 && s.distance.level < s.distance.levels);
  }
  std::string type() const override { return "style_sampled_distance"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    s_.distance.hash(h);
    h.add(s_.samples).add(s_.seed);
    s_.place.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2 + 2 * size_t(s_.distance.hidden));
    readsContour(w, s_.distance);
    readsHiddenContours(w, s_.distance.extent, s_.distance.hidden);
    return w.gives({"style_distance", Domain::ViewSample, s_.distance.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override {  // of a layer: two segments a square, their lines, the guide
    const size_t squares = size_t(1 + s_.distance.hidden) * 2 * (2 * sizeof(ContourSegment) + 72);
    return size_t(s_.distance.extent.width) * size_t(s_.distance.extent.height) * (squares + (s_.distance.pixel > 0.0f ? PictureSurface::bytesPerSample() : 0));
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * kSampleNs * s_.samples * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto D = ctx.result->writable<float>("D");
    const FilmElements film(s_.distance.extent, s_.place);
    GOBO_TRY(forEachContourLayer(s_.distance, *ctx.inputs.at(0), *ctx.inputs.at(1),
                                 [&](const ContourInput& in, size_t layer) { return runLayer(ctx, in, layer, film, D); }));
    return TermPtr(ctx.result);
  }

 private:
  Status runLayer(const RunContext& ctx, const ContourInput& in, size_t layer, const FilmElements& film, std::span<float> D) const {
    const float cosine = std::cos(s_.distance.angle) - kRoundedCosine;
    GOBO_ASSIGN(std::vector<ContourSegment> contour, extractContour(in, cosine, *ctx.arena, ctx.stop));
    GOBO_TRY(appendHiddenContours(ctx, in, layer, s_.distance.hidden, cosine, contour));
    const ContourPoints points(contour);
    const size_t w = size_t(in.width), first = layer * w * size_t(in.height);
    const bool complete = ctx.arena->parallelFor(
        size_t(in.height), 1,
        [&](size_t begin, size_t end) {
          uint32_t drawn = 0;
          for (size_t e = begin * w; e < end * w; ++e) {
            D[first + e] = distanceAt(in, e, points, cosine, hash64(s_.seed, film(first + e)));
            if ((drawn += s_.samples) < kPollPoints) continue;
            if (ctx.stop.stopRequested()) return;
            drawn = 0;
          }
        },
        ctx.stop);
    if (!complete || ctx.stop.stopRequested()) return Status(Code::Cancelled, "style_sampled_distance: stopped");
    return {};
  }

  float distanceAt(const ContourInput& in, size_t e, const ContourPoints& points, float cosine, uint64_t seed) const {
    if (!in.valid(e)) return kStyleFar;
    double value = kStyleFar;
    if (points.length() > 0) {
      const StyleDistanceSettings& d = s_.distance;
      const SampledSum s = points.sum(in.at(in.P, e), in.at(in.N, e), d.power, cosine, seed, s_.samples);
      const double perPoint = points.length() / s_.samples;
      if (s.seen > 0) value = s.unit2 > 0 ? averagedDistance(s.sum * perPoint, s.seen * perPoint, s.unit2, d.power, d.norm) : 0.0;
    }
    const float magnitude = std::clamp(float(std::min(value, double(kStyleFar))), kLeastStyleDistance, kStyleFar);
    return in.lit(e) ? magnitude : -magnitude;
  }

  SampledDistanceSettings s_;
};

}  // namespace

NodePtr makeSampledDistanceNode(const SampledDistanceSettings& settings) { return std::make_shared<SampledDistanceNode>(settings); }

}  // namespace filters
}  // namespace gobo
