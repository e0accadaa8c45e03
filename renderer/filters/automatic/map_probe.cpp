// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "filters/automatic/shadow_probe.h"
#include "filters/shadow_map/depth_compare.h"
#include "formulas/shadow_map.glsl.h"
#include "trace/solid_scene.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr size_t kMapGrain = 16;  // receivers a task
constexpr int kMostTaps = 9;      // of a bilinear comparison: its box may touch a third texel by rounding

/// Depths of a map that is not there, by a ray per texel asked for. Rays wait for others until a packet is full.
class VirtualMap {
 public:
  VirtualMap(const SolidScene& scene, const ProbeMap& map) : scene_(scene), map_(map) {}
  int side() const { return map_.resolution; }
  uint64_t rays() const { return rays_; }
  /// *z: depth of texel (x, y), which repeats the rim outside; known after flush().
  void ask(int face, int x, int y, float* z) {
    const LightFrame& f = map_.frames.face[size_t(face)];
    const float texel = 1.0f / float(side());
    const int tx = std::clamp(x, 0, side() - 1), ty = std::clamp(y, 0, side() - 1);
    ray_[waiting_] = f.ray((float(tx) + 0.5f) * texel, (float(ty) + 0.5f) * texel, start_[waiting_], cosine_[waiting_]);
    frame_[waiting_] = &f;
    z_[waiting_] = z;
    if (++waiting_ == 16) flush();
  }
  void flush() {
    if (waiting_ == 0) return;
    Hit hit[16];
    scene_.intersect16(ray_, waiting_, hit);
    for (int i = 0; i < waiting_; ++i) {
      const LightFrame& f = *frame_[i];
      *z_[i] = hit[i].valid() ? formulas::shadowDepth((start_[i] + hit[i].t * cosine_[i] - f.near) * (1.0f / (f.far - f.near))) : 1.0f;
    }
    rays_ += uint64_t(waiting_);
    waiting_ = 0;
  }

 private:
  const SolidScene& scene_;
  const ProbeMap& map_;
  Ray ray_[16];
  float start_[16], cosine_[16];
  const LightFrame* frame_[16];
  float* z_[16];
  int waiting_ = 0;
  uint64_t rays_ = 0;
};

constexpr ReceiverNeeds kNeeds{.slopes = true, .facing = false};

class MapProbeNode final : public Node {
 public:
  explicit MapProbeNode(const MapProbeSettings& s) : s_(s) {}
  std::string type() const override { return "map_probe"; }
  int version() const override { return 4; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    if (s_.clear) t.facets = t.facets | Facet::Bsdf;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    s_.map.frames.hash(h);
    h.add(s_.map.resolution).add(s_.bias).add(s_.slopeBias);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    Receivers::reads(w, 0, kNeeds);
    w.reads<float>(0, "lit");
    return w.gives(visibilityOver(w.input(0)));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& probe = *ctx.inputs.at(0);
    GOBO_ASSIGN(AccelPtr accel, ctx.accel());
    const SolidScene scene(*ctx.scene, std::move(accel), s_.clear);
    const auto lit = probe.floats("lit");
    const Receivers receivers(probe, s_.map.frames, s_.map.resolution, ShadowView{}, kNeeds);
    const auto V = ctx.result->writable<float>("V");
    const bool done = ctx.arena->parallelFor(
        V.size(), kMapGrain,
        [&](size_t from, size_t to) {
          VirtualMap depths(scene, s_.map);
          lookups(depths, receivers, lit, from, V.subspan(from, to - from));
          if (ctx.counters) ctx.counters->rays += depths.rays();
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "map_probe stopped");
    return TermPtr(ctx.result);
  }

 private:
  /// Elements first ..., those that are lit; the others: 1.
  void lookups(VirtualMap& map, const Receivers& receivers, std::span<const float> lit, size_t first, std::span<float> V) const {
    std::vector<std::array<float, kMostTaps>> z(V.size());
    std::fill(V.begin(), V.end(), 1.0f);
    const auto each = [&](auto&& what) {
      for (size_t i = 0; i < V.size(); ++i) {
        if (lit[first + i] == 0.0f) continue;
        ReceiverBlock b;
        receivers.fill(first + i, 1, b);
        if (!b.covered[0]) continue;
        const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
        AxisKernel kx, ky;
        boxKernel(r.x, 1.0f, kx);
        boxKernel(r.y, 1.0f, ky);
        what(i, b.face[0], r, kx, ky);
      }
    };
    each([&](size_t i, int face, const ReceiverPlane&, const AxisKernel& kx, const AxisKernel& ky) {
      for (int k = 0; k < kx.count * ky.count; ++k) map.ask(face, kx.first + k % kx.count, ky.first + k / kx.count, &z[i][size_t(k)]);
    });
    map.flush();
    each([&](size_t i, int, const ReceiverPlane& r, const AxisKernel& kx, const AxisKernel& ky) {
      float sum = 0;
      for (int k = 0; k < kx.count * ky.count; ++k)
        if (!(z[i][size_t(k)] < r.at(kx.first + k % kx.count, ky.first + k / kx.count))) sum += kx.weight[k % kx.count] * ky.weight[k / kx.count];
      V[i] = std::min(sum, 1.0f);
    });
  }

  MapProbeSettings s_;
};

}  // namespace

NodePtr makeMapProbeNode(const MapProbeSettings& settings) { return std::make_shared<MapProbeNode>(settings); }

}  // namespace filters
}  // namespace gobo
