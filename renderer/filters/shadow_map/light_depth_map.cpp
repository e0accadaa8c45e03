// SPDX-License-Identifier: Apache-2.0
// Source: linear depth seen from a light, by one Embree ray per texel, in packets of 4x4 texels.
#include <algorithm>

#include "filters/shadow_map/shadow_map.h"
#include "formulas/shadow_map.glsl.h"
#include "trace/accel_impl.h"

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
    const std::span<float> z = term->addPlane<float>("z");
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const size_t rows = size_t(resolution_ + kTile - 1) / kTile, square = size_t(resolution_) * size_t(resolution_);
    const bool done = ctx.arena->parallelFor(rows * size_t(frames_.count), 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r) {
        const size_t face = r / rows;
        tileRow(accel->impl(), frames_.face[face], int(r % rows) * kTile, &z[face * square]);
        if (ctx.counters) ctx.counters->rays += uint64_t(std::min(kTile, resolution_ - int(r % rows) * kTile)) * uint64_t(resolution_);
      }
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, "light_depth_map stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kTile = 4;

  void tileRow(const Accel::Impl& accel, const LightFrame& f, int y0, float* z) const {
    embree::Context context;
    embree::initContext(context);
    const float scale = 1.0f / (f.far - f.near), texel = 1.0f / float(resolution_);
    for (int x0 = 0; x0 < resolution_; x0 += kTile) {
      alignas(64) RTCRayHit16 r;
      alignas(64) int valid[16];
      float start[16], cosine[16];
      for (int i = 0; i < 16; ++i) {
        const int x = x0 + i % kTile, y = y0 + i / kTile;
        valid[i] = x < resolution_ && y < resolution_ ? -1 : 0;
        const Ray ray = f.ray((float(x) + 0.5f) * texel, (float(y) + 0.5f) * texel, start[i], cosine[i]);
        r.ray.org_x[i] = ray.origin.x;
        r.ray.org_y[i] = ray.origin.y;
        r.ray.org_z[i] = ray.origin.z;
        r.ray.dir_x[i] = ray.direction.x;
        r.ray.dir_y[i] = ray.direction.y;
        r.ray.dir_z[i] = ray.direction.z;
        r.ray.tnear[i] = ray.tmin;
        r.ray.tfar[i] = ray.tmax;
        r.ray.time[i] = 0.0f;
        r.ray.mask[i] = ~0u;
        r.ray.id[i] = unsigned(i);
        r.ray.flags[i] = 0;
        r.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        r.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      }
      embree::intersect16(valid, accel.scene, context, r, true);
      for (int i = 0; i < 16; ++i) {
        if (!valid[i]) continue;
        float depth = 1.0f;
        if (r.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID) depth = formulas::shadowDepth((start[i] + r.ray.tfar[i] * cosine[i] - f.near) * scale);
        z[size_t(y0 + i / kTile) * size_t(resolution_) + size_t(x0 + i % kTile)] = depth;
      }
    }
  }

  LightFrames frames_;
  int resolution_;
};

}  // namespace

NodePtr makeLightDepthMapNode(const LightFrames& frames, int resolution) { return std::make_shared<LightDepthMapNode>(frames, resolution); }

}  // namespace gobo
