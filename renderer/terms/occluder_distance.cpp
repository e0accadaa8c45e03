// SPDX-License-Identifier: Apache-2.0
#include "terms/occluder_distance.h"

#include <algorithm>

#include "terms/light_points.h"
#include "terms/surface_samples.h"

namespace gobo {
inline namespace terms {

namespace {

class OccluderDistanceNode final : public Node {
 public:
  explicit OccluderDistanceNode(const Extent& e) : extent_(e) {}
  std::string type() const override { return "occluder_distance"; }
  int version() const override { return 2; }  // 2: as visibility 3
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | Facet::LightShape;
    return t;
  }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    SurfaceSamples::reads(w.over(0, extent_), 0);
    w.over(1, extent_).reads<float>(1, "V", {1, 3});
    return w.gives({type(), Domain::ViewSample, extent_, {unsetPlane<float>("d"), unsetPlane<uint32_t>("instance")}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = 0.03 * double(extent_.elements());  // an edge here and there
    return {rays, 100.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const LightPoints light(*ctx.scene, ctx.scene->lightSubset().at(0));
    const SurfaceSamples surface(*ctx.inputs[0]);
    const auto V = ctx.inputs[1]->floats("V");
    const size_t channels = size_t(ctx.inputs[1]->channels("V"));
    const auto d = ctx.result->writable<float>("d");
    const auto instance = ctx.result->writable<uint32_t>("instance");
    const auto lit = [&](size_t e) { return *std::max_element(&V[channels * e], &V[channels * e] + channels) >= 0.5f; };
    const size_t w = size_t(extent_.width), h = size_t(extent_.height);
    const bool complete = ctx.arena->parallelFor(
        surface.size() / w, 4,
        [&](size_t from, size_t to) {
          uint64_t rays = 0;
          for (size_t row = from; row < to; ++row)
            for (size_t x = 0; x < w; ++x) {
              const size_t e = row * w + x, y = row % h;
              d[e] = -1.0f;
              instance[e] = ~0u;
              if (!surface.hit(e) || lit(e)) continue;
              if (!(x > 0 && lit(e - 1)) && !(x + 1 < w && lit(e + 1)) && !(y > 0 && lit(e - w)) && !(y + 1 < h && lit(e + w))) continue;
              LightPoint point;
              if (!light.sample(surface.position(e), surface.normal(e), surface.geometricNormal(e), Vec2(0.5f), point) || point.belowSurface) continue;
              Hit hit;
              ++rays;
              if (accel->intersect(shadowRay(surface.reach(e, *accel), surface.position(e), surface.geometricNormal(e), point), hit))
                d[e] = hit.t, instance[e] = hit.instance;
            }
          if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "occluder_distance: stopped");
    return TermPtr(ctx.result);
  }

 private:
  Extent extent_;
};

}  // namespace

NodePtr makeOccluderDistanceNode(const Extent& extent) { return std::make_shared<OccluderDistanceNode>(extent); }

}  // namespace terms
}  // namespace gobo
