// SPDX-License-Identifier: Apache-2.0
#include "filters/tinted_visibility.h"

#include <algorithm>

#include "filters/ray_traced/technique.h"
#include "terms/visibility.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr uint32_t kTintSamples = 16;  // area lights

class TintedVisibilityNode final : public Node {
 public:
  explicit TintedVisibilityNode(const Extent& extent) : extent_(extent) {}
  std::string type() const override { return "tinted_visibility"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = t.tileable = true;
    return t;
  }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, extent_).reads<float>(0, "V").over(1, extent_).reads<float>(1, "V", {3});
    TermShape out{"visibility", Domain::ViewSample, extent_, {unsetPlane<float>("V", 3)}};
    if (w.input(0).find("flags")) w.reads<float>(0, "flags"), out.planes.push_back(unsetPlane<float>("flags"));
    return w.gives(std::move(out));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &solid = *ctx.inputs.at(0), &glass = *ctx.inputs.at(1);
    const auto v = solid.floats("V"), tint = glass.floats("V");
    const auto& term = ctx.result;
    const auto V = term->writable<float>("V");
    const bool complete = ctx.arena->parallelFor(
        v.size(), 1 << 14,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e)
            for (size_t c = 0; c < 3; ++c) V[3 * e + c] = v[e] * tint[3 * e + c];
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "tinted_visibility: stopped");
    if (solid.hasPlane("flags")) {
      const auto from = solid.floats("flags");
      std::copy(from.begin(), from.end(), term->writable<float>("flags").begin());
    }
    return TermPtr(term);
  }

 private:
  Extent extent_;
};

}  // namespace

NodePtr makeTintedVisibilityNode(const Extent& extent) { return std::make_shared<TintedVisibilityNode>(extent); }

NodeId planTint(Graph& graph, const ShadowInput& input, NodeId v) {
  if (!input.clear) return v;
  const Light& light = input.scene->lights[size_t(input.light)];
  VisibilitySettings s;
  const bool hard = isDeltaLight(light.shape);
  s.samples = hard ? 1 : kTintSamples;
  s.seed = hard ? 0 : shadowSeed(input);
  s.extent = {input.width, input.height, input.viewSamples};
  s.glass = Glass::Alone;
  s.place = input.place;
  const NodeId tint = graph.add({makeVisibilityNode(s), {input.gbuffer}, {input.light}, "tint:" + light.name, 0, input.scene, false});
  GraphNode n{makeTintedVisibilityNode(s.extent), {v, tint}, {}, "tinted_visibility:" + light.name};
  if (!hard) n.approximate = "light through clear glass is the map's solid shadow times the mean of rays";
  return graph.add(std::move(n));
}

}  // namespace filters
}  // namespace gobo
