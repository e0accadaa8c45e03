// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/styled_samples.h"

#include <algorithm>
#include <cmath>

#include "filters/shadow_technique.h"
#include "techniques/direct_visibility/visibility.h"
#include "techniques/subtractive/distant_arrival.h"

namespace gobo::subtractive {

namespace {

constexpr uint64_t kKeptStyledBytes = uint64_t(256) << 20;

class StyledSamplesNode final : public FoldNode {
 public:
  explicit StyledSamplesNode(const SamplesSettings& s) : s_(s) {}
  std::string type() const override { return "styled_samples"; }
  int version() const override { return 2; }  // 2: what the specular lobe reflects without its table's padding
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = s_.resampling.reach();
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_.view);
    s_.view.place.hash(h);
    s_.resampling.hash(h);
    for (const DistantLightSample& l : s_.lights) h.addPod(l.direction).addPod(l.irradiance);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2 + s_.lights.size());
    Receivers::reads(w, s_.view);
    for (size_t i = 0; i < s_.lights.size(); ++i) w.over(2 + i, s_.view.extent()).reads<float>(2 + i, "V");
    return w.gives({"subtractive_samples", Domain::ViewSample, s_.view.extent(), SamplePlanes::shapes()});
  }
  size_t workingBytes() const override { return size_t(s_.view.extent().elements()) * (sizeof(SampleSums) + sizeof(size_t)); }
  Cost cost(const TermShape& result, uint32_t) const override {
    const double elements = double(result.extent.elements());
    return {0.0, 300.0 * kReceiving * elements / (double(s_.resampling.resolution) * s_.resampling.resolution) * double(s_.lights.size()) + 100.0 * elements};
  }
  int fixedInputs() const override { return 2; }
  int stride() const override { return 1; }

  struct Sums final : State {
    TermPtr g, surface;
    std::vector<size_t> traced;  // view samples
    std::vector<SampleSums> of;  // theirs
  };
  std::unique_ptr<State> begin(const RunContext& ctx, const std::vector<TermPtr>& fixed) const override {
    auto sums = std::make_unique<Sums>();
    sums->g = fixed[0], sums->surface = fixed[1];
    const Receivers in(*sums->g, *sums->surface, s_.view);
    std::vector<char> traced(in.instance.size(), 0);
    // Stopped: a step or the end will say so.
    ctx.arena->parallelFor(
        traced.size(), 256,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) traced[e] = in.lit(e) && speaksForItself(s_.resampling, in, e);
        },
        ctx.stop);
    sums->traced.reserve(size_t(std::count(traced.begin(), traced.end(), 1)));
    for (size_t e = 0; e < traced.size(); ++e)
      if (traced[e]) sums->traced.push_back(e);
    sums->of.resize(sums->traced.size());
    return sums;
  }
  Status step(const RunContext& ctx, State& state, int index, const std::vector<TermPtr>& inputs) const override {
    Sums& sums = static_cast<Sums&>(state);
    const Receivers in(*sums.g, *sums.surface, s_.view);
    const DistantLightSample& light = s_.lights[size_t(index)];
    const auto visible = inputs[0]->floats("V");
    const bool complete = ctx.arena->parallelFor(
        sums.traced.size(), 1 << 10,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const size_t e = sums.traced[i];
            const TracedSample sample = sampleAt(in, e);
            Arrivals::Light arrived;
            if (arrives(light, sample, SampleFrame(sample.point), arrived)) addLight(sums.of[i], arrived.lobe, double(clamp01(visible[e])));
          }
        },
        ctx.stop);
    return complete ? Status() : stopped();
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const override {
    const Sums& sums = static_cast<const Sums&>(*state);
    if (ctx.stop.stopRequested()) return stopped();
    const SamplePlanes out(*ctx.result);
    for (size_t i = 0; i < sums.traced.size(); ++i) writeSums(sums.of[i], out, sums.traced[i]);
    return TermPtr(ctx.result);
  }

 private:
  static Status stopped() { return Status(Code::Cancelled, "styled_samples: stopped"); }
  SamplesSettings s_;
};

}  // namespace

NodePtr makeStyledSamplesNode(const SamplesSettings& settings) { return std::make_shared<StyledSamplesNode>(settings); }

Result<NodeId> planStyledSamples(PlanContext& c, const SamplesSettings& settings, v1::ShadowTechnique technique) {
  auto extended = std::make_shared<Scene>(*c.scene());
  const int first = int(extended->lights.size());
  for (size_t i = 0; i < settings.lights.size(); ++i) {
    Light light;
    light.name = "environment/few" + std::to_string(i);
    light.shape.kind = LightKind::Directional;
    light.shape.axis = -settings.lights[i].direction;
    light.power = settings.lights[i].irradiance;
    extended->lights.push_back(light);
  }
  GOBO_TRY(extended->seal());
  if (!settings.lights.empty()) technique = shadowTechniqueOf(c, first, extended, "environment");
  if (!findShadowTechnique(technique.technique_case())) technique.mutable_ray_traced()->set_samples(1);
  std::vector<NodeId> inputs{c.gbuffer(), c.surface()};  // made, and kept, before any node that is marked transient below
  const uint64_t all =
      uint64_t(settings.lights.size()) * uint64_t(settings.view.extent().elements()) * 40;  // a style holds its distance and what it makes of it
  const bool keep = all <= kKeptStyledBytes;
  if (c.bounding()) c.reserve(std::min(all, kKeptStyledBytes));  // fewer lights than asked for may be kept where all of them would not
  for (size_t i = 0; i < settings.lights.size(); ++i) {
    if (c.stop().stopRequested()) return Status(Code::Cancelled, "stopped");
    const int before = c.graph().size();
    GOBO_ASSIGN(const NodeId v, planVisibility(c, first + int(i), extended, technique, "environment"));
    if (!keep) c.graph().markTransient(before, v);
    inputs.push_back(v);
  }
  return c.filter(makeStyledSamplesNode(settings), std::move(inputs), "subtractive:samples");
}

}  // namespace gobo::subtractive
