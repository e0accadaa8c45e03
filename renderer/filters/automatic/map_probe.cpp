// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "filters/automatic/probe_pixels.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/shadow_map/depth_compare.h"
#include "formulas/soft_shadow.glsl.h"
#include "trace/solid_scene.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr size_t kMapGrain = 8;          // pixels a task
constexpr int kSearch = 6, kFilter = 8;  // taps a side of the soft kernels
constexpr int kMostTaps = 9;             // of a bilinear comparison: its box may touch a third texel by rounding

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
  /// z[i] of texels (x[i], y[i]).
  void depths(int face, const int* x, const int* y, int count, float* z) {
    for (int i = 0; i < count; ++i) ask(face, x[i], y[i], z + i);
    flush();
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
  int version() const override { return 2; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    if (s_.clear) t.facets = t.facets | Facet::Bsdf;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    s_.map.frames.hash(h);
    h.add(s_.map.resolution).add(s_.bias).add(s_.slopeBias).add(s_.size.x).add(s_.size.y).add(s_.viewSamples);
    if (s_.clear) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    Receivers::reads(w, 0, kNeeds);
    w.reads<float>(0, "a").reads<float>(0, "b").reads<float>(0, "lit").reads<double>(0, "weight").reads<uint32_t>(0, "stratum").reads<double>(0, "share");
    return w.gives({type(), Domain::Table, {1, 1, 1}, {plane<double>("mse"), plane<double>("variance"), plane<double>("penumbra")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& probe = *ctx.inputs.at(0);
    GOBO_ASSIGN(AccelPtr accel, ctx.accel());
    const SolidScene scene(*ctx.scene, std::move(accel), s_.clear);
    const auto a = probe.floats("a"), b = probe.floats("b"), lit = probe.floats("lit");
    const auto weight = probe.plane<double>("weight");
    const auto stratum = probe.plane<uint32_t>("stratum");
    const double share = probe.plane<double>("share")[0];
    const Receivers receivers(probe, s_.map.frames, s_.map.resolution, ShadowView{}, kNeeds);
    const size_t S = size_t(s_.viewSamples), pixels = lit.size() / S, tasks = (pixels + kMapGrain - 1) / kMapGrain;
    std::vector<double> error(pixels, 0.0), penumbra(pixels, 0.0);
    const bool done = ctx.arena->parallelFor(
        tasks, 1,
        [&](size_t from, size_t to) {
          VirtualMap depths(scene, s_.map);
          for (size_t first = from * kMapGrain; first < std::min(to * kMapGrain, pixels); first += kMapGrain) {
            const size_t end = std::min(first + kMapGrain, pixels);
            std::vector<Lookup> found((end - first) * S);
            if (s_.size == Vec2(0.0f)) hard(depths, receivers, lit, first * S, found);
            else soft(depths, receivers, lit, first * S, found);
            for (size_t p = first; p < end; ++p) {
              double v = 0, among = 0, partly = 0;
              for (size_t e = p * S; e < (p + 1) * S; ++e) {
                if (lit[e] == 0.0f) continue;
                v += found[e - first * S].V;
                partly += found[e - first * S].partial();
                ++among;
              }
              if (!(among > 0)) continue;
              error[p] = (v / among - a[p * S]) * (v / among - b[p * S]);
              penumbra[p] = partly / among;
            }
          }
          if (ctx.counters) ctx.counters->rays += depths.rays();
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "map_probe stopped");
    StratifiedSum errors, partly;
    for (size_t p = 0; p < pixels; ++p) {
      const ProbePixel pixel{{}, stratum[p * S], weight[p * S]};
      errors.add(pixel, error[p]);
      partly.add(pixel, penumbra[p]);
    }
    const auto& term = ctx.result;
    term->writable<double>("mse")[0] = share > 0 ? errors.sum() / share : 0.0;
    term->writable<double>("variance")[0] = share > 0 ? errors.variance() / (share * share) : 0.0;
    term->writable<double>("penumbra")[0] = share > 0 ? std::clamp(partly.sum() / share, 0.0, 1.0) : 0.0;
    return TermPtr(term);
  }

 private:
  struct Lookup {
    float V = 1.0f;
    bool partial() const { return V > 0.0f && V < 1.0f; }
  };

  /// Elements first ..., those that are lit.
  void hard(VirtualMap& map, const Receivers& receivers, std::span<const float> lit, size_t first, std::vector<Lookup>& found) const {
    std::vector<std::array<float, kMostTaps>> z(found.size());
    const auto each = [&](auto&& what) {
      for (size_t i = 0; i < found.size(); ++i) {
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
      found[i] = {std::min(sum, 1.0f)};
    });
  }

  void soft(VirtualMap& map, const Receivers& receivers, std::span<const float> lit, size_t first, std::vector<Lookup>& found) const {
    for (size_t i = 0; i < found.size(); ++i) {
      if (lit[first + i] == 0.0f) continue;
      ReceiverBlock b;
      receivers.fill(first + i, 1, b);
      if (b.covered[0]) found[i] = filtered(map, receivers, b);
    }
  }

  /// taps x taps texels spread over the box of width (wx, wy) texels around the receiver.
  static int grid(const ReceiverPlane& r, float wx, float wy, int taps, int* x, int* y) {
    for (int i = 0; i < taps * taps; ++i) {
      x[i] = int(std::floor(r.x + wx * ((float(i % taps) + 0.5f) / float(taps) - 0.5f) + 0.5f));
      y[i] = int(std::floor(r.y + wy * ((float(i / taps) + 0.5f) / float(taps) - 0.5f) + 0.5f));
    }
    return taps * taps;
  }

  Lookup filtered(VirtualMap& depths, const Receivers& receivers, const ReceiverBlock& b) const {
    const ProbeMap& map = s_.map;
    const LightFrame& f = map.frames.face[size_t(b.face[0])];
    const ReceiverPlane r = receiverPlane(b, 0, s_.bias, s_.slopeBias);
    const float d = receivers.metric(b.face[0], b.d[0]), texelsX = float(map.resolution) / (f.hi.x - f.lo.x),
                texelsY = float(map.resolution) / (f.hi.y - f.lo.y);
    const auto width = [&](float z, float size, float texels) {
      // limit: a window without width has infinitely many texels a metre, and no width times that is no number.
      return formulas::limit(formulas::softWidth(d, z, size, f.perspective) * texels, 1.0f, float(map.resolution));
    };
    int x[64], y[64];
    float z[64];
    float plane = std::max(f.near, 1e-3f * d);
    double blocked = 0, share = 0;
    for (int pass = 0; pass < 2; ++pass) {  // the search kernel is measured on the near plane, then on the nearest blocker found
      const int n = grid(r, width(plane, s_.size.x, texelsX), width(plane, s_.size.y, texelsY), kSearch, x, y);
      depths.depths(b.face[0], x, y, n, z);
      blocked = share = 0;
      float nearest = 1.0f;
      for (int i = 0; i < n; ++i)
        if (z[i] < r.at(x[i], y[i])) {
          blocked += receivers.metric(b.face[0], z[i]);
          share += 1;
          nearest = std::min(nearest, z[i]);
        }
      if (share == 0) return {};
      plane = std::max(plane, receivers.metric(b.face[0], nearest));
    }
    const float blocker = float(blocked / share);
    const int n = grid(r, width(blocker, s_.size.x, texelsX), width(blocker, s_.size.y, texelsY), kFilter, x, y);
    depths.depths(b.face[0], x, y, n, z);
    int lit = 0;
    for (int i = 0; i < n; ++i) lit += r.at(x[i], y[i]) <= z[i];
    return {float(lit) / float(n)};
  }

  MapProbeSettings s_;
};

}  // namespace

NodePtr makeMapProbeNode(const MapProbeSettings& settings) { return std::make_shared<MapProbeNode>(settings); }

}  // namespace filters
}  // namespace gobo
