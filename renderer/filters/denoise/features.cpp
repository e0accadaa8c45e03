// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/features.h"

#include <cmath>

#include "base/vec.h"

namespace gobo::denoise {

namespace {

class FeaturesNode final : public Node {
 public:
  FeaturesNode(int width, int height, int samples) : width_(width), height_(height), samples_(samples) {}
  std::string type() const override { return "denoise_features"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, {width_, height_, samples_}).reads<float>(0, "P", {3}).reads<float>(0, "depth").reads<float>(0, "footprint");
    w.over(1, {width_, height_, samples_}).reads<float>(1, "albedo", {3}).reads<float>(1, "N", {3});
    return w.gives({type(),
                    Domain::Pixel,
                    {width_, height_, 1},
                    {unsetPlane<float>("albedo", 3), unsetPlane<float>("normal", 3), unsetPlane<float>("position", 3), unsetPlane<float>("depth"),
                     unsetPlane<float>("footprint"), unsetPlane<float>("coverage"), unsetPlane<float>("modulation", 3)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &seen = *ctx.inputs[0], &surface = *ctx.inputs[1];
    const auto at = seen.floats("P"), distance = seen.floats("depth"), width = seen.floats("footprint");
    const auto colour = surface.floats("albedo"), facing = surface.floats("N");
    const auto& out = ctx.result;
    const auto albedo = out->writable<float>("albedo"), normal = out->writable<float>("normal"), position = out->writable<float>("position");
    const auto depth = out->writable<float>("depth"), footprint = out->writable<float>("footprint"), coverage = out->writable<float>("coverage");
    const auto modulation = out->writable<float>("modulation");
    const size_t pixels = size_t(width_) * size_t(height_);
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 12,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            DVec3 a(0.0), n(0.0), x(0.0);
            double d = 0, f = 0;
            int hits = 0;
            for (int s = 0; s < samples_; ++s) {
              const size_t i = size_t(s) * pixels + p;
              if (!std::isfinite(distance[i])) continue;
              ++hits;
              for (size_t c = 0; c < 3; ++c) {
                a[c] += colour[3 * i + c];
                n[c] += facing[3 * i + c];
                x[c] += at[3 * i + c];
              }
              d += distance[i];
              f += width[i];
            }
            const double each = 1.0 / samples_, hit = hits ? 1.0 / hits : 0.0;
            for (size_t c = 0; c < 3; ++c) {
              albedo[3 * p + c] = float(a[c] * each);
              normal[3 * p + c] = float(n[c] * each);
              position[3 * p + c] = float(x[c] * hit);
            }
            depth[p] = float(d * hit);
            footprint[p] = float(f * hit);
            coverage[p] = float(hits * each);
            for (size_t c = 0; c < 3; ++c) modulation[3 * p + c] = hits ? albedo[3 * p + c] + 0.04f * coverage[p] : 1.0f;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  int width_, height_, samples_;
};

}  // namespace

NodePtr makeFeaturesNode(int width, int height, int viewSamples) { return std::make_shared<FeaturesNode>(width, height, viewSamples); }

}  // namespace gobo::denoise
