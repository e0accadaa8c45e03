// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/view_sample_edges.h"

#include <cmath>

#include "filters/denoise/features.h"
#include "filters/denoise/similar.h"

namespace gobo::denoise {

namespace {

class ViewSampleEdgesNode final : public Node {
 public:
  ViewSampleEdgesNode(int width, int height, int samples, LobePart lobe) : width_(width), height_(height), samples_(samples), lobe_(lobe) {}
  std::string type() const override { return "denoised_edges"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = kEdgeRadius;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_).add(lobe_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1}, samples{width_, height_, samples_};
    Wiring w(type(), in, 4);
    readFeatures(w, 0, all);
    w.reads<float>(0, "even");
    w.over(1, all).reads<float>(1, "rgb", {3});
    w.over(2, samples).reads<float>(2, "P", {3}).reads<float>(2, "depth");
    w.over(3, samples).reads<float>(3, "albedo", {3}).reads<float>(3, "material", {5}).reads<float>(3, "N", {3});
    return w.gives({type(), Domain::Pixel, all, {unsetPlane<float>("rgb", 3)}});
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, 60.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Seen seen{featuresOf(*ctx.inputs[0]), ctx.inputs[1]->floats("rgb"), ctx.inputs[0]->floats("even"), ctx.inputs[2]->floats("P"),
                    ctx.inputs[3]->floats("N")};
    const auto depth = ctx.inputs[2]->floats("depth"), albedo = ctx.inputs[3]->floats("albedo"), material = ctx.inputs[3]->floats("material");
    const auto& out = ctx.result;
    const auto rgb = out->writable<float>("rgb");
    const size_t pixels = size_t(width_) * size_t(height_);
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 11,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            for (size_t c = 0; c < 3; ++c) rgb[3 * p + c] = seen.light[3 * p + c];
            if (seen.even[p] > 0.0f || !(seen.features.coverage[p] > 0.0f)) continue;
            DVec3 sum(0.0), weights(0.0), like(0.0);
            bool haveLike = false;
            for (int s = 0; s < samples_; ++s) {
              const size_t i = size_t(s) * pixels + p;
              if (!std::isfinite(depth[i])) continue;
              const DVec3 m(modulationOf(lobe_, Vec3(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]), &material[5 * i]));
              DVec3 light;
              if (!fromEven(seen, p, i, light)) {
                if (!haveLike) like = fromAlike(seen, p);
                haveLike = true;
                light = like;
              }
              sum += m * light;
              weights += m;
            }
            for (size_t c = 0; c < 3; ++c)
              if (weights[int(c)] > 0.0) rgb[3 * p + c] = float(sum[int(c)] / weights[int(c)]);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  struct Seen {
    Features features;
    std::span<const float> light, even, place, facing;
  };
  template <class Do>
  void around(size_t p, Do&& look) const {
    const int x = int(p % size_t(width_)), y = int(p / size_t(width_));
    for (int v = std::max(y - kEdgeRadius, 0); v <= std::min(y + kEdgeRadius, height_ - 1); ++v)
      for (int u = std::max(x - kEdgeRadius, 0); u <= std::min(x + kEdgeRadius, width_ - 1); ++u)
        look(size_t(v) * size_t(width_) + size_t(u), std::exp(-0.5 * double((u - x) * (u - x) + (v - y) * (v - y))));
  }
  static DVec3 lightAt(const Seen& s, size_t q) { return DVec3(s.light[3 * q], s.light[3 * q + 1], s.light[3 * q + 2]); }

  /// Light of the even pixels around p on the surface of view sample i. False: there are none.
  bool fromEven(const Seen& s, size_t p, size_t i, DVec3& light) const {
    const float *n = &s.facing[3 * i], *x = &s.place[3 * i];
    DVec3 sum(0.0);
    double weights = 0;
    around(p, [&](size_t q, double near) {
      if (!(s.even[q] > 0.0f)) return;
      const float *m = &s.features.normal[3 * q], *y = &s.features.position[3 * q];
      double dot = 0, length = 0, off = 0;
      for (int c = 0; c < 3; ++c) {
        dot += double(n[c]) * m[c];
        length += double(m[c]) * m[c];
        off += double(n[c]) * (double(y[c]) - x[c]);
      }
      if (!(dot >= 0.9396926 * std::sqrt(length)) || !(std::abs(off) <= 2.0 * s.features.footprint[q])) return;
      sum += near * lightAt(s, q);
      weights += near;
    });
    if (!(weights > 0)) return false;
    light = sum / weights;
    return true;
  }
  DVec3 fromAlike(const Seen& s, size_t p) const {
    DVec3 sum(0.0);
    double weights = 0;
    around(p, [&](size_t q, double near) {
      const double w = near * double(similarity(s.features, p, q, kLoosely));
      sum += w * lightAt(s, q);
      weights += w;
    });
    return weights > 0 ? sum / weights : lightAt(s, p);
  }

  int width_, height_, samples_;
  LobePart lobe_;
};

}  // namespace

NodePtr makeViewSampleEdgesNode(int width, int height, int viewSamples, LobePart lobe) {
  return std::make_shared<ViewSampleEdgesNode>(width, height, viewSamples, lobe);
}

}  // namespace gobo::denoise
