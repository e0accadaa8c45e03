// SPDX-License-Identifier: Apache-2.0
// Source: linear depth seen from a light, by one Embree ray per texel.
#include "filters/exponential_shadow_map/exponential_shadow_map.h"
#include "formulas/math.glsl.h"
#include "trace/accel.h"

namespace gobo {
namespace {

class LightDepthMapNode : public Node {
 public:
  LightDepthMapNode(const LightFrame& frame, int resolution) : frame_(frame), resolution_(resolution) { GOBO_CHECK(resolution >= 1); }
  std::string type() const override { return "light_depth_map"; }
  NodeTraits traits() const override { return {.facets = Facet::Topology | Facet::Pose | Facet::Coverage}; }
  void hashParameters(Hasher& h) const override {
    frame_.hash(h);
    h.add(resolution_);
  }
  size_t outputBytes() const override { return size_t(resolution_) * resolution_ * 4; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    auto term = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{resolution_, resolution_, 1});
    const std::span<float> z = term->addPlane<float>("z");
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    const float scale = 1.0f / (frame_.far - frame_.near), texel = 1.0f / float(resolution_);
    const bool done = ctx.arena->parallelFor(size_t(resolution_), 4, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y)
        for (int x = 0; x < resolution_; ++x) {
          float start = 0.0f, cosine = 1.0f;
          const Ray ray = frame_.ray((float(x) + 0.5f) * texel, (float(y) + 0.5f) * texel, start, cosine);
          Hit hit;
          float depth = 1.0f;
          if (accel->intersect(ray, hit)) depth = formulas::limit(formulas::finiteOr((start + hit.t * cosine - frame_.near) * scale, 1.0f), 0.0f, 1.0f);
          z[y * size_t(resolution_) + size_t(x)] = depth;
        }
      if (ctx.counters) ctx.counters->rays += uint64_t(end - begin) * uint64_t(resolution_);
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, "light_depth_map stopped");
    return TermPtr(term);
  }

 private:
  LightFrame frame_;
  int resolution_;
};

}  // namespace

NodePtr makeLightDepthMapNode(const LightFrame& frame, int resolution) { return std::make_shared<LightDepthMapNode>(frame, resolution); }

}  // namespace gobo
