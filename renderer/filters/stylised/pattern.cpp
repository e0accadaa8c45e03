// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/pattern.h"

#include <algorithm>
#include <cmath>

#include "formulas/stylised_shadow.glsl.h"

namespace gobo {
inline namespace filters {

namespace {

/// A dot about (0, 0) of `area` square pixels, at `r` pixels from its centre: a ramp of one pixel about its rim, whose radius makes up for what the ramp adds;
/// of dots that are smaller than the ramp the middle is not full.
float dot(float area, float r) {
  const float square = area / kPi;
  if (square < 1.0f / 3.0f) return std::clamp((1.0f - r) * 3.0f * square, 0.0f, 1.0f);  // a cone of radius 1: volume pi h / 3
  return std::clamp(std::sqrt(square - 1.0f / 12.0f) - r + 0.5f, 0.0f, 1.0f);
}

/// Distance from (u, v) to the nearest point of a square lattice with a point at `shift` of a cell.
float latticeDistance(float u, float v, float spacing, float shift) {
  const auto off = [&](float x) {
    const float t = x / spacing - shift;
    return (t - std::floor(t + 0.5f)) * spacing;
  };
  return std::hypot(off(u), off(v));
}

class StylePatternNode final : public Node {
 public:
  explicit StylePatternNode(const StylePatternSettings& s) : s_(s) { GOBO_CHECK(s.spacing >= 2.0f); }
  std::string type() const override { return "style_pattern"; }
  int version() const override { return 1; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(int(s_.pattern)).add(s_.spacing).add(s_.angle).add(s_.ownShare).add(s_.rest).add(s_.varyingBrightness);
    if (!s_.varyingBrightness) h.add(s_.brightness);
    s_.place.hash(h);
    for (const double share : s_.layerShares) h.add("layer").add(share);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const size_t inputs = (s_.varyingBrightness ? 2 : 1) + s_.layerShares.size();
    Wiring w(type(), in, inputs);
    w.over(0, s_.extent).reads<float>(0, "V", {1, 3});
    for (size_t k = 1; k < inputs; ++k) w.over(k, s_.extent).reads<float>(k, "brightness");
    return w.gives({"visibility", Domain::ViewSample, s_.extent, {unsetPlane<float>("V", w.channels(0, "V"))}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto from = ctx.inputs.at(0)->floats("V");
    const auto brightness = s_.varyingBrightness ? ctx.inputs.at(1)->floats("brightness") : std::span<const float>();
    std::vector<std::span<const float>> layers;
    for (size_t k = 0; k < s_.layerShares.size(); ++k) layers.push_back(ctx.inputs.at(k + (s_.varyingBrightness ? 2 : 1))->floats("brightness"));
    const auto V = ctx.result->writable<float>("V");
    const size_t channels = size_t(ctx.result->channels("V")), w = size_t(s_.extent.width), h = size_t(s_.extent.height);
    const bool complete = ctx.arena->parallelFor(
        V.size() / channels, 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            const float* in = &from[channels * e];
            const float tone = *std::max_element(in, in + channels);
            double keeps = s_.ownShare * double(brightness.empty() ? s_.brightness : brightness[e]) + s_.rest;
            for (size_t k = 0; k < layers.size(); ++k) keeps += s_.layerShares[k] * double(layers[k][e]);
            const float dark = float(keeps);
            const float drawn = tone <= dark || dark >= 1.0f ? tone : drawnTone(e % w, e / w % h, tone, dark);
            for (size_t c = 0; c < channels; ++c) V[channels * e + c] = tone > 0.0f ? std::min(in[c] * (drawn / tone), 1.0f) : drawn;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_pattern: stopped");
    return TermPtr(ctx.result);
  }

 private:
  float drawnTone(size_t x, size_t y, float tone, float dark) const {
    const float coverage = (1.0f - std::min(tone, 1.0f)) / (1.0f - dark);
    const float fx = float(int(x) + s_.place.x) + 0.5f, fy = float(int(y) + s_.place.y) + 0.5f;
    return 1.0f - (1.0f - dark) * patternAt(s_.pattern, s_.spacing, s_.angle, fx, fy, coverage);
  }

  StylePatternSettings s_;
};

}  // namespace

float patternAt(StylePattern pattern, float spacing, float angle, float x, float y, float coverage) {
  const float c = std::clamp(coverage, 0.0f, 1.0f), cosine = std::cos(angle), sine = std::sin(angle);
  const float along = x * cosine - y * sine, across = x * sine + y * cosine;  // rows go down
  switch (pattern) {
    case StylePattern::Hatching: return formulas::hatching01(across, spacing, c * spacing);
    case StylePattern::CrossHatching: {
      const float each = (1.0f - std::sqrt(1.0f - c)) * spacing;  // what neither covers: (1 - each / spacing)^2
      return 1.0f - (1.0f - formulas::hatching01(across, spacing, each)) * (1.0f - formulas::hatching01(along, spacing, each));
    }
    case StylePattern::Stippling: {
      const float cell = spacing * spacing;
      if (c <= 0.5f) return dot(c * cell, latticeDistance(along, across, spacing, 0.0f));
      return 1.0f - dot((1.0f - c) * cell, latticeDistance(along, across, spacing, 0.5f));  // light dots between dark ones that touch
    }
  }
  return 0.0f;
}

NodePtr makeStylePatternNode(const StylePatternSettings& settings) { return std::make_shared<StylePatternNode>(settings); }

}  // namespace filters
}  // namespace gobo
