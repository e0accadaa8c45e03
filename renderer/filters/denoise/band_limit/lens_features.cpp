// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/band_limit/lens_features.h"

#include <array>

#include "filters/denoise/band_limit/blurred_means.h"
#include "filters/denoise/plane_set.h"
#include "filters/denoise/similar.h"

namespace gobo::denoise {

namespace {

struct Averaged {
  const char* plane;
  int channels;
  bool ofHits;  ///< the mean over view samples that hit: weighs as many of them as there are
};
constexpr std::array<Averaged, 8> kAveraged{{{"albedo", 3, false},
                                             {"normal", 3, false},
                                             {"position", 3, true},
                                             {"depth", 1, true},
                                             {"footprint", 1, true},
                                             {"coverage", 1, false},
                                             {"modulation", 3, false},
                                             {"alpha", 1, true}}};

class LensFeaturesNode final : public Node {
 public:
  LensFeaturesNode(int width, int height, LobePart lobe) : width_(width), height_(height), lobe_(lobe) {}
  std::string type() const override { return "lens_features"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = bandRadius(kFeatureShare);
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(lobe_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1};
    Wiring w(type(), in, 2);
    readFeatures(w, 0, all);
    w.reads<float>(0, "even").reads<float>(0, "modulation", {3});
    if (lobe_ == LobePart::Specular) w.reads<float>(0, "alpha");
    w.over(1, all).reads<float>(1, "blur");
    TermShape out{type(), Domain::Pixel, all, {}};
    for (const Averaged& a : averaged()) out.planes.push_back(unsetPlane<float>(a.plane, a.channels));
    out.planes.push_back(unsetPlane<float>("even"));
    out.planes.push_back(unsetPlane<float>("blur"));
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return (2 * kPlanes + 1) * sizeof(float) * size_t(width_) * size_t(height_); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, 3000.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& features = *ctx.inputs[0];
    const auto blur = ctx.inputs[1]->floats("blur"), coverage = features.floats("coverage"), even = features.floats("even");
    const size_t pixels = blur.size();
    int channels = 0;
    for (const Averaged& a : averaged()) channels += a.channels;
    const PlaneSet from(channels, pixels), to(channels, pixels);
    // Each channel in its place, in both directions; sums over hits as products with their share.
    const auto each = [&](const auto& body) {
      return ctx.arena->parallelFor(
          pixels, 1 << 12,
          [&](size_t begin, size_t end) {
            for (size_t p = begin; p < end; ++p) body(p);
          },
          ctx.stop);
    };
    size_t at = 0, ofCoverage = 0;
    bool complete = true;
    for (const Averaged& a : averaged()) {
      const auto in = features.floats(a.plane);
      const size_t n = size_t(a.channels);
      if (std::string_view(a.plane) == "coverage") ofCoverage = at;
      complete = complete && each([&](size_t p) {
                   for (size_t c = 0; c < n; ++c) from[at + c][p] = in[n * p + c] * (a.ofHits ? coverage[p] : 1.0f);
                 });
      at += n;
    }
    complete = complete && bandLimitedMeans(blur, kFeatureShare, width_, height_, from.in(), to.out(), *ctx.arena, ctx.stop);
    at = 0;
    for (const Averaged& a : averaged()) {
      const auto out = ctx.result->writable<float>(a.plane);
      const size_t n = size_t(a.channels);
      const float* hits = to[ofCoverage];
      complete = complete && each([&](size_t p) {
                   const float scale = !a.ofHits ? 1.0f : hits[p] > 0.0f ? 1.0f / hits[p] : 0.0f;
                   for (size_t c = 0; c < n; ++c) out[n * p + c] = to[at + c][p] * scale;
                 });
      at += n;
    }
    const auto evenOut = ctx.result->writable<float>("even"), blurOut = ctx.result->writable<float>("blur");
    complete = complete && each([&](size_t p) {
                 evenOut[p] = even[p];
                 blurOut[p] = blur[p];
               });
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  static constexpr size_t kPlanes = 16;
  std::span<const Averaged> averaged() const { return std::span(kAveraged).first(lobe_ == LobePart::Specular ? kAveraged.size() : kAveraged.size() - 1); }

  int width_, height_;
  LobePart lobe_;
};

}  // namespace

NodePtr makeLensFeaturesNode(int width, int height, LobePart lobe) { return std::make_shared<LensFeaturesNode>(width, height, lobe); }

}  // namespace gobo::denoise
