// SPDX-License-Identifier: Apache-2.0
// Source: linear depth seen from a light, by one Embree ray per texel, in packets of 4x4 texels.
#include <algorithm>

#include "filters/shadow_map/shadow_map.h"
#include "formulas/shadow_map.glsl.h"
#include "trace/accel.h"

namespace gobo {
namespace {

class LightDepthMapNode : public ShadowMapNode {
 public:
  LightDepthMapNode(const LightFrames& frames, int resolution) : frames_(frames), resolution_(resolution) { GOBO_CHECK(resolution >= 1); }
  std::string type() const override { return "light_depth_map"; }
  int version() const override { return 2; }
  NodeTraits traits() const override { return {.facets = Facet::Topology | Facet::Pose | Facet::Coverage}; }
  void hashParameters(Hasher& h) const override {
    frames_.hash(h);
    h.add(resolution_);
  }
  size_t outputBytes() const override { return size_t(resolution_) * size_t(resolution_) * size_t(frames_.count) * 4; }

  ShadowMapShape shape() const override { return {resolution_, 1, frames_.count}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    auto term = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{resolution_, resolution_, frames_.count});
    const std::span<float> z = term->addUnsetPlane<float>("z");
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const size_t rows = size_t(resolution_ + kTile - 1) / kTile, square = size_t(resolution_) * size_t(resolution_);
    const bool done = ctx.arena->parallelFor(rows * size_t(frames_.count), 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r) {
        const size_t face = r / rows;
        tileRow(*accel, frames_.face[face], int(r % rows) * kTile, &z[face * square]);
        if (ctx.counters) ctx.counters->rays += uint64_t(std::min(kTile, resolution_ - int(r % rows) * kTile)) * uint64_t(resolution_);
      }
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, "light_depth_map stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kTile = 4;

  void tileRow(const Accel& accel, const LightFrame& f, int y0, float* z) const {
    const float scale = 1.0f / (f.far - f.near), texel = 1.0f / float(resolution_);
    const int tall = std::min(kTile, resolution_ - y0);
    for (int x0 = 0; x0 < resolution_; x0 += kTile) {
      const int wide = std::min(kTile, resolution_ - x0), count = wide * tall;
      Ray ray[kTile * kTile];
      Hit hit[kTile * kTile];
      float start[kTile * kTile], cosine[kTile * kTile];
      for (int i = 0; i < count; ++i) ray[i] = f.ray((float(x0 + i % wide) + 0.5f) * texel, (float(y0 + i / wide) + 0.5f) * texel, start[i], cosine[i]);
      accel.intersect16(ray, count, hit);
      for (int i = 0; i < count; ++i)
        z[size_t(y0 + i / wide) * size_t(resolution_) + size_t(x0 + i % wide)] =
            hit[i].valid() ? formulas::shadowDepth((start[i] + hit[i].t * cosine[i] - f.near) * scale) : 1.0f;
    }
  }

  LightFrames frames_;
  int resolution_;
};

}  // namespace

NodePtr makeLightDepthMapNode(const LightFrames& frames, int resolution) { return std::make_shared<LightDepthMapNode>(frames, resolution); }

}  // namespace gobo
