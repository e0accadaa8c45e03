// SPDX-License-Identifier: Apache-2.0
#include "terms/area_light_list.h"

#include <algorithm>

#include "terms/fit_area_lights.h"

namespace gobo {
inline namespace terms {

namespace {

/// Maps may hold anything that is finite; sums and products of what follows must stay so.
float bounded(double x) { return float(std::clamp(x, -1e30, 1e30)); }

class AreaLightListNode final : public Node {
 public:
  explicit AreaLightListNode(int lights) : lights_(lights) {}
  std::string type() const override { return "area_light_list"; }
  int version() const override { return 2; }  // 2: of the bilinear look-up
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Environment;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(lights_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0)
        .gives({type(),
                Domain::Table,
                {1, 1, 1},
                {plane<uint32_t>("count"), plane<float>("direction", 3 * lights_), plane<float>("right", 3 * lights_), plane<float>("angularSize", 2 * lights_),
                 plane<float>("irradiance", 3 * lights_), plane<float>("remainder", 27)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const AreaLightFit fit = fitAreaLights(*ctx.scene->environment(), lights_, ctx.stop);
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    const auto& out = ctx.result;
    out->writable<uint32_t>("count")[0] = uint32_t(fit.lights.size());
    const auto direction = out->writable<float>("direction"), right = out->writable<float>("right");
    const auto size = out->writable<float>("angularSize"), irradiance = out->writable<float>("irradiance");
    for (size_t i = 0; i < fit.lights.size(); ++i) {
      const AreaLight& l = fit.lights[i];
      for (int k = 0; k < 3; ++k) {
        direction[3 * i + k] = float(l.direction[k]);
        right[3 * i + k] = float(l.right[k]);
        irradiance[3 * i + k] = bounded(l.irradiance[k]);
      }
      size[2 * i] = size[2 * i + 1] = float(l.angularSize);
    }
    const auto remainder = out->writable<float>("remainder");
    for (size_t i = 0; i < 9; ++i)
      for (int k = 0; k < 3; ++k) remainder[3 * i + k] = bounded(fit.remainder[i][k]);
    return TermPtr(out);
  }

 private:
  int lights_;
};

}  // namespace

NodePtr makeAreaLightListNode(int lights) { return std::make_shared<AreaLightListNode>(lights); }

}  // namespace terms
}  // namespace gobo
