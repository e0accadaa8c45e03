// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/maps.h"

#include <algorithm>
#include <cmath>

#include "filters/axis_aligned/filter.h"
#include "formulas/axis_aligned.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

class ShadowFilterMaps final : public Node {
 public:
  ShadowFilterMaps(float k, bool filters) : k_(k), filters_(filters) {}
  std::string type() const override { return "shadow_filter_maps"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(k_).add(filters_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    const Extent& view = w.input(0).extent;
    w.reads<uint32_t>(0, "n").over(1, view).reads<float>(1, "Omega").over(2, view).reads<float>(2, "footprint").reads<uint32_t>(2, "instance");
    return w.gives({type(), Domain::ViewSample, view, {plane<float>("rays"), plane<float>("width")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto n = ctx.inputs.at(0)->plane<uint32_t>("n"), instance = ctx.inputs.at(2)->plane<uint32_t>("instance");
    const auto omega = ctx.inputs.at(1)->floats("Omega"), footprint = ctx.inputs[2]->floats("footprint");
    const auto rays = ctx.result->writable<float>("rays"), width = ctx.result->writable<float>("width");
    const bool complete = ctx.arena->parallelFor(
        n.size(), 1 << 13,
        [&](size_t from, size_t to) {
          for (size_t p = from; p < to; ++p) {
            if (instance[p] == ~0u) continue;
            rays[p] = float(n[p]);
            if (!filters_ || !(omega[p] > 0.0f)) continue;
            const float w = formulas::aaBeta(omega[p], k_) / footprint[p];
            width[p] = std::isfinite(w) ? w : 0.0f;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_filter_maps: stopped");
    return TermPtr(ctx.result);
  }

 private:
  float k_;
  bool filters_;
};

}  // namespace

Result<NodeId> planShadowFilterMaps(Graph& graph, NodeId visibility) {
  // Behind the filter stand at most nodes whose first input it is.
  NodeId at = visibility;
  while (graph.at(at).node->type() != "axis_aligned_filter") {
    if (graph.at(at).inputs.empty()) return invalidArgument("shadows.axis_aligned is not what makes this light's shadow");
    at = graph.at(at).inputs[0];
  }
  const GraphNode& filter = graph.at(at);
  const AxisAlignedFilterSettings& settings = settingsOfAxisAlignedFilter(*filter.node);
  const NodeId gbuffer = filter.inputs.at(1), width = filter.inputs.at(2), count = graph.at(filter.inputs.at(0)).inputs.at(2);
  return graph.add(
      {std::make_shared<ShadowFilterMaps>(settings.k, settings.radiusPx > 0), {count, width, gbuffer}, {}, filter.label + " maps", 0, nullptr, false});
}

}  // namespace filters
}  // namespace gobo
