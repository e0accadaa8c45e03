// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/light.h"

#include "terms/dropped_samples.h"

namespace gobo::subtractive {

namespace {

/// Share of the light that is seen; -1: there is none.
float seenShare(float visible, float unshadowed) { return unshadowed > 0.0f ? clamp01(visible / unshadowed) : -1.0f; }

float fallback(const FewLights& few, const FewLights& other) {
  for (const FewLights* f : {&few, &other})
    if (const float share = seenShare(luminance(f->visible), luminance(f->unshadowed)); share >= 0.0f) return share;
  return 1.0f;
}

/// Weight of the unshadowed light's own error.
float regression(const FewLights& few, int lights) {
  const double n = lights, u = double(luminance(few.unshadowed)) / n, v = double(luminance(few.visible)) / n;
  const double variance = double(few.squares) / n - u * u, covariance = double(few.seen) / n - u * v;
  if (!(variance > 1e-5 * u * u)) return u > 0 ? float(std::clamp(v / u, 0.0, 1.0)) : 1.0f;
  return float(std::clamp(covariance / variance, 0.0, 1.0));
}

class LightNode final : public Node {
 public:
  explicit LightNode(const LightSettings& s) : s_(s) {}
  std::string type() const override { return "subtractive_light"; }
  int version() const override { return 4; }  // 2: negative light by channel; 3: gloss of glass; 4: what the specular lobe reflects without its table's padding
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = s_.resampling.reach();
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_.view);
    s_.view.place.hash(h);
    s_.resampling.hash(h);
    h.add(s_.form);
    if (s_.form == Form::Beta) h.add(s_.lights);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 4);
    Receivers::reads(w, s_.view);
    const Extent view = s_.view.extent();
    w.over(2, view).reads<float>(2, "unshadowed", {6}).reads<float>(2, "visible", {6}).reads<float>(2, "moments", {4}).reads<uint8_t>(2, "traced");
    w.over(3, view).reads<float>(3, "diffuse", {3}).reads<float>(3, "specular", {3});
    return w.gives({"direct_light",
                    Domain::Pixel,
                    {view.width, view.height, 1},
                    {plane<float>("diffuse", 3), plane<float>("specular", 3), plane<float>("negative", 3), mayDrop()}});
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    const double side = 2.0 * s_.resampling.reach() / s_.resampling.resolution + 1.0;
    return {0.0, kReceiving * double(result.extent.elements()) * s_.view.viewSamples * (60.0 + 10.0 * side * side)};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], s_.view);
    const Term &samples = *ctx.inputs[2], &map = *ctx.inputs[3];
    const auto unshadowed = samples.floats("unshadowed"), visible = samples.floats("visible"), moments = samples.floats("moments");
    const auto traced = samples.plane<uint8_t>("traced");
    const std::span<const float> full[2] = {map.floats("diffuse"), map.floats("specular")};
    const std::span<float> out[2] = {ctx.result->writable<float>("diffuse"), ctx.result->writable<float>("specular")};
    const auto negative = ctx.result->writable<float>("negative");
    DroppedSamples dropped(*ctx.result);
    const size_t width = size_t(s_.view.width), pixels = width * size_t(s_.view.height);
    const float share = 1.0f / float(s_.view.viewSamples);
    const auto one = [&](size_t p, size_t e) {
      if (!in.lit(e)) return;
      FewLights few[2];
      const auto add = [&](size_t q, float weight) {
        for (size_t k = 0; k < 2; ++k) {
          few[k].unshadowed += weight * Vec3(unshadowed[6 * q + 3 * k], unshadowed[6 * q + 3 * k + 1], unshadowed[6 * q + 3 * k + 2]);
          few[k].visible += weight * Vec3(visible[6 * q + 3 * k], visible[6 * q + 3 * k + 1], visible[6 * q + 3 * k + 2]);
          few[k].squares += weight * moments[4 * q + 2 * k];
          few[k].seen += weight * moments[4 * q + 2 * k + 1];
        }
      };
      const int x = int(p % width), y = int(p / width);
      float sum = 0;
      if (s_.resampling.resolution > 1 && (!traced[e] || onGrid(s_.resampling, s_.view, x, y)))
        forNeighbours(s_.resampling, in, x, y, e, [&](size_t q, float weight) { add(q, weight), sum += weight; });
      else add(e, 1.0f), sum = 1.0f;
      if (!(sum > 0.0f)) {  // no footprint, or none that is a number: nobody speaks for it, itself included
        if (!traced[e]) {
          dropped.add(p, 1);
          return;
        }
        few[0] = few[1] = {};
        add(e, 1.0f), sum = 1.0f;
      }
      const LobeAlbedos by = in.divisors(e, in.bsdf(e));
      for (FewLights& f : few) f.unshadowed /= sum, f.visible /= sum, f.squares /= sum, f.seen /= sum;
      const Vec3 of[2] = {by.diffuse, by.specular};
      for (size_t k = 0; k < 2; ++k) {
        const Vec3 c(full[k][3 * e], full[k][3 * e + 1], full[k][3 * e + 2]);
        Vec3 light = subtract(s_.form, c, of[k], few[k], few[1 - k], s_.lights);
        if (!isFinite(light)) {
          dropped.add(p, 1);
          continue;
        }
        for (int i = 0; i < 3; ++i) {
          negative[3 * p + size_t(i)] += maxOf(-light[i], 0.0f) * share;
          out[k][3 * p + size_t(i)] += maxOf(light[i], 0.0f) * share;
        }
      }
    };
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 9,
        [&](size_t begin, size_t end) {
          for (size_t s = 0; s < size_t(s_.view.viewSamples); ++s)
            for (size_t p = begin; p < end; ++p) one(p, s * pixels + p);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "subtractive_light: stopped");
    passOnDropped(map, *ctx.result);
    return TermPtr(ctx.result);
  }

 private:
  LightSettings s_;
};

}  // namespace

Vec3 subtract(Form form, const Vec3& c, const Vec3& albedo, const FewLights& few, const FewLights& other, int lights) {
  if (form == Form::Ratio) {
    Vec3 out(0.0f);
    for (int i = 0; i < 3; ++i) {
      float share = seenShare(few.visible[i], few.unshadowed[i]);
      if (share < 0.0f) share = fallback(few, other);
      out[i] = c[i] * share;
    }
    return out;
  }
  const Vec3 difference = c - albedo * (few.unshadowed - few.visible);
  return form == Form::Difference ? difference : difference - (1.0f - regression(few, lights)) * (c - albedo * few.unshadowed);
}

NodePtr makeLightNode(const LightSettings& settings) { return std::make_shared<LightNode>(settings); }

}  // namespace gobo::subtractive
