// SPDX-License-Identifier: Apache-2.0
#include "terms/visibility.h"

#include <algorithm>

#include "base/sobol.h"
#include "terms/light_points.h"
#include "terms/surface_samples.h"
#include "trace/accel.h"

namespace gobo {

uint64_t viewSampleSeed(uint64_t seed, size_t element) { return hash64(hash64(0x5ead0e5ull, seed), element); }

namespace {

class VisibilityNode final : public Node {
 public:
  explicit VisibilityNode(const VisibilitySettings& s) : s_(s) { GOBO_CHECK_GT(s.samples, 0u); }
  std::string type() const override { return "visibility"; }
  int version() const override { return 2; }   // 2: hard shadows in packets
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Topology | Facet::Pose | Facet::Coverage | Facet::LightShape;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.samples).add(s_.seed); }
  size_t outputBytes() const override { return s_.extent.elements() * sizeof(float); }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_CHECK_EQ(ctx.inputs.size(), size_t(1));
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const SurfaceSamples surface(*ctx.inputs[0]);
    auto term = std::make_shared<Term>("visibility", Domain::ViewSample, ctx.inputs[0]->extent());
    const auto V = term->addUnsetPlane<float>("V");
    const uint32_t samples = light.pointLike() ? 1 : s_.samples;
    const size_t grain = std::clamp<size_t>(8192 / samples, 1, 1024);   // a few milliseconds between looks at `stop`
    const bool complete = ctx.arena->parallelFor(surface.size(), grain, [&](size_t from, size_t to) {
      uint64_t rays = 0;
      if (light.pointLike()) {
        hard(*accel, light, surface, from, to, V, rays);
        from = to;
      }
      for (size_t e = from; e < to; ++e) {
        V[e] = 1.0f;
        if (!surface.hit(e)) continue;
        const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e);
        const uint64_t seed = viewSampleSeed(s_.seed, e);
        double seen = 0, sum = 0;
        for (uint32_t i = 0; i < samples; ++i) {
          LightPoint point;
          if (!light.sample(p, N, Ng, SobolSampler(seed, i).next2D(), point)) continue;
          sum += point.weight;
          if (point.belowSurface) continue;
          ++rays;
          if (!accel->occluded(shadowRay(*accel, p, Ng, point))) seen += point.weight;
        }
        if (sum > 0) V[e] = float(seen / sum);
      }
      if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
    }, ctx.stop);
    if (!complete) return Status(Code::Cancelled, "visibility: stopped");
    return TermPtr(term);
  }

 private:
  /// One ray each, 16 neighbours at a time.
  static void hard(const Accel& accel, const LightPoints& light, const SurfaceSamples& surface, size_t from, size_t to, std::span<float> V, uint64_t& rays) {
    Ray packet[16];
    size_t element[16];
    int count = 0;
    const auto flush = [&] {
      const uint32_t blocked = count ? accel.occluded16(packet, count) : 0;
      for (int i = 0; i < count; ++i) V[element[i]] = blocked >> i & 1 ? 0.0f : 1.0f;
      rays += uint64_t(count);
      count = 0;
    };
    for (size_t e = from; e < to; ++e) {
      V[e] = 1.0f;
      if (!surface.hit(e)) continue;
      LightPoint point;
      const Vec3 p = surface.position(e), Ng = surface.geometricNormal(e);
      if (!light.sample(p, surface.normal(e), Ng, Vec2(0.5f), point)) continue;
      if (point.belowSurface) { V[e] = 0.0f; continue; }
      packet[count] = shadowRay(accel, p, Ng, point);
      element[count++] = e;
      if (count == 16) flush();
    }
    flush();
  }

  VisibilitySettings s_;
};

}  // namespace

NodePtr makeVisibilityNode(const VisibilitySettings& settings) { return std::make_shared<VisibilityNode>(settings); }

}  // namespace gobo
