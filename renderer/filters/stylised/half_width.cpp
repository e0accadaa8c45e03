// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/half_width.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "filters/stylised/averaged_distance.h"
#include "filters/stylised/skeleton.h"

namespace gobo {
inline namespace filters {

namespace {

void readsLinkedSurface(Wiring& w, size_t input, const Extent& extent) {
  w.over(input, extent).reads<float>(input, "P", {3}).reads<float>(input, "N", {3}).reads<float>(input, "Ng", {3});
  w.reads<float>(input, "footprint").reads<uint32_t>(input, "instance");
}

/// Layers side by side: each is a sequence of its own.
template <class Body>
Status overLayers(const RunContext& ctx, const Extent& extent, const Body& body) {
  std::vector<Status> status{size_t(extent.layers)};
  const bool complete = ctx.arena->parallelFor(
      size_t(extent.layers), 1,
      [&](size_t begin, size_t end) {
        for (size_t layer = begin; layer < end; ++layer) status[layer] = body(layer);
      },
      ctx.stop);
  for (const Status& s : status) GOBO_TRY(s);
  return complete ? Status() : Status(Code::Cancelled, "stopped");
}

class StyleHalfWidthNode final : public Node {
 public:
  explicit StyleHalfWidthNode(const StyleHalfWidthSettings& s) : s_(s) {}
  std::string type() const override { return "style_half_width"; }
  int version() const override { return 1; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(s_.angle); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, s_.extent).reads<float>(0, "D");
    readsLinkedSurface(w, 1, s_.extent);
    return w.gives({type(), Domain::ViewSample, s_.extent, {unsetPlane<float>("half_width")}});
  }
  size_t workingBytes() const override { return 40 * s_.extent.elements(); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 100.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto D = ctx.inputs.at(0)->floats("D");
    const auto out = ctx.result->writable<float>("half_width");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    GOBO_TRY(overLayers(ctx, s_.extent, [&](size_t layer) -> Status {
      const ContourInput in = surfaceInput(*ctx.inputs.at(1), layer);
      GOBO_ASSIGN(const SurfaceLinks links, SurfaceLinks::of(in, cosine, *ctx.arena, ctx.stop));
      return shadowSkeleton(in, links, D.subspan(layer * count, count), out.subspan(layer * count, count), ctx.stop);
    }));
    return TermPtr(ctx.result);
  }

 private:
  StyleHalfWidthSettings s_;
};

class StyleKeepNode final : public Node {
 public:
  explicit StyleKeepNode(const StyleKeepSettings& s) : s_(s) { GOBO_CHECK(s.keep >= 0.0f && s.keep <= 1.0f); }
  std::string type() const override { return "style_keep"; }
  int version() const override { return 1; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.angle).add(s_.keep).add(s_.varies);
    if (!s_.varies) h.add(s_.inflation);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, s_.varies ? 4 : 3);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent).reads<float>(1, "half_width");
    readsLinkedSurface(w, 2, s_.extent);
    if (s_.varies) w.over(3, s_.extent).reads<float>(3, "inflation");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return 10 * s_.extent.elements(); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 80.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto from = ctx.inputs.at(0)->floats("D"), r = ctx.inputs.at(1)->floats("half_width");
    const auto D = ctx.result->writable<float>("D");
    const auto varying = s_.varies ? ctx.inputs.at(3)->floats("inflation") : std::span<const float>();
    std::copy(from.begin(), from.end(), D.begin());
    if (s_.keep == 0.0f || (!s_.varies && s_.inflation >= 0.0f)) return TermPtr(ctx.result);
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    GOBO_TRY(overLayers(ctx, s_.extent, [&](size_t layer) -> Status {
      const auto part = [&](std::span<const float> all) { return all.empty() ? all : all.subspan(layer * count, count); };
      return keepLayer(ctx, surfaceInput(*ctx.inputs.at(2), layer), part(from), part(r), part(varying), D.subspan(layer * count, count));
    }));
    return TermPtr(ctx.result);
  }

 private:
  Status keepLayer(const RunContext& ctx, const ContourInput& in, std::span<const float> from, std::span<const float> r, std::span<const float> varying,
                   std::span<float> D) const {
    const auto inflation = [&](size_t e) { return varying.empty() ? s_.inflation : varying[e]; };
    std::vector<uint32_t> nearest(from.size(), kNone);
    std::vector<float> least(from.size(), std::numeric_limits<float>::infinity());  // distance to the disc that is kept about it
    bool any = false;
    for (size_t y = 0; y < from.size(); ++y) {
      if (!(r[y] > 0.0f && from[y] < 0.0f && from[y] > -kStyleFar)) continue;
      if (!(-from[y] * (1.0f - s_.keep) < -inflation(y))) continue;
      nearest[y] = uint32_t(y), least[y] = -s_.keep * r[y], any = true;
    }
    if (!any) return {};
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    GOBO_ASSIGN(const SurfaceLinks links, SurfaceLinks::of(in, cosine, *ctx.arena, ctx.stop));
    const auto take = [&](size_t e, size_t f) {
      const uint32_t y = nearest[f];
      if (y == kNone || y == nearest[e]) return false;
      const float d = glm::length(in.at(in.P, e) - in.at(in.P, y)) - s_.keep * r[y];
      if (!(d < least[e])) return false;
      nearest[e] = y, least[e] = d;
      return true;
    };
    if (!sweepLinks(links, ctx.stop, take)) return Status(Code::Cancelled, "style_keep: stopped");
    for (size_t e = 0; e < from.size(); ++e) {
      const float i = inflation(e);
      const uint32_t y = nearest[e];
      if (i < 0.0f && y != kNone) D[e] = std::min(from[e], i - from[y] / r[y] * least[e]);
    }
    return {};
  }

  static constexpr uint32_t kNone = ~0u;
  StyleKeepSettings s_;
};

}  // namespace

NodePtr makeStyleHalfWidthNode(const StyleHalfWidthSettings& settings) { return std::make_shared<StyleHalfWidthNode>(settings); }
NodePtr makeStyleKeepNode(const StyleKeepSettings& settings) { return std::make_shared<StyleKeepNode>(settings); }

}  // namespace filters
}  // namespace gobo
