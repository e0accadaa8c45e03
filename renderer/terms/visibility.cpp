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
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Topology | Facet::Pose | Facet::Coverage | Facet::LightShape;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.samples).add(s_.seed);
    if (s_.angularSize != Vec2(0.0f)) h.add(s_.angularSize.x).add(s_.angularSize.y);
  }
  size_t outputBytes() const override { return s_.extent.elements() * sizeof(float); }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_CHECK_EQ(ctx.inputs.size(), size_t(1));
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0), s_.angularSize);
    const SurfaceSamples surface(*ctx.inputs[0]);
    auto term = std::make_shared<Term>("visibility", Domain::ViewSample, ctx.inputs[0]->extent());
    const auto V = term->addPlane<float>("V");
    const uint32_t samples = light.pointLike() ? 1 : s_.samples;
    const size_t grain = std::clamp<size_t>(8192 / samples, 1, 1024);   // a few milliseconds between looks at `stop`
    const bool complete = ctx.arena->parallelFor(surface.size(), grain, [&](size_t from, size_t to) {
      uint64_t rays = 0;
      for (size_t e = from; e < to; ++e) {
        V[e] = 1.0f;
        if (!surface.hit(e)) continue;
        const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e);
        const uint64_t seed = viewSampleSeed(s_.seed, e);
        double seen = 0, sum = 0;
        for (uint32_t i = 0; i < samples; ++i) {
          LightPoint point;
          const Vec2 u = light.pointLike() ? Vec2(0.5f) : SobolSampler(seed, i).next2D();
          if (!light.sample(p, N, Ng, u, point)) continue;
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
  VisibilitySettings s_;
};

}  // namespace

NodePtr makeVisibilityNode(const VisibilitySettings& settings) { return std::make_shared<VisibilityNode>(settings); }

}  // namespace gobo
