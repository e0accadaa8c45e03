// SPDX-License-Identifier: Apache-2.0
// Filter: G-buffer positions + exponential map -> visibility.
#include <algorithm>

#include "filters/exponential_shadow_map/exponential_shadow_map_kernels.h"
#include "filters/exponential_shadow_map/device_kernels.h"

namespace gobo {
namespace {

class LookupNode : public Node {
 public:
  LookupNode(const ExponentialShadowLookup& lookup, size_t viewSamples, std::shared_ptr<ComputeDevice> device)
      : lookup_(lookup), viewSamples_(viewSamples), device_(std::move(device)) {
    GOBO_CHECK(lookup.c >= 1.0f && lookup.c <= 80.0f && lookup.bias >= 0.0f);
  }
  std::string type() const override { return "exponential_shadow_lookup"; }
  std::string numericClass() const override { return device_ ? device_->numericClass() : Node::numericClass(); }
  std::string device() const override { return device_ ? std::string(device_->kind()) + ": " + device_->name() : "cpu"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    lookup_.frame.hash(h);
    h.add(lookup_.c).add(lookup_.bias);
  }
  size_t outputBytes() const override { return viewSamples_ * 4; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const Term& map = *ctx.inputs.at(1);
    const std::span<const float> P = gbuffer.floats("P"), E = map.floats("E");
    const std::span<const uint32_t> instance = gbuffer.plane<uint32_t>("instance");
    auto term = std::make_shared<Term>("visibility", gbuffer.domain(), gbuffer.extent());
    const std::span<float> V = term->addPlane<float>("V");
    GOBO_CHECK(P.size() == 3 * V.size() && instance.size() == V.size());
    const int width = map.extent().width, height = map.extent().height;
    if (E.empty()) {   // no map: nothing is known to block the light
      std::fill(V.begin(), V.end(), 1.0f);
    } else if (device_) {
      GOBO_TRY(deviceLookup(*device_, lookupParameters(lookup_, width, height, 0), E, P, instance, V, ctx.stop));
    } else {
      const ExponentialLookupParameters p = lookupParameters(lookup_, width, height, 0);
      const bool done = ctx.arena->parallelFor(V.size(), 16384, [&](size_t begin, size_t end) {
        lookupExponential(p, E.data(), &P[3 * begin], &instance[begin], &V[begin], end - begin);
      }, ctx.stop);
      if (!done) return Status(Code::Cancelled, "exponential_shadow_lookup stopped");
    }
    return TermPtr(term);
  }

 private:
  ExponentialShadowLookup lookup_;
  size_t viewSamples_;
  std::shared_ptr<ComputeDevice> device_;
};

}  // namespace

NodePtr makeExponentialShadowLookupNode(const ExponentialShadowLookup& lookup, size_t viewSamples, std::shared_ptr<ComputeDevice> device) {
  return std::make_shared<LookupNode>(lookup, viewSamples, std::move(device));
}

}  // namespace gobo
