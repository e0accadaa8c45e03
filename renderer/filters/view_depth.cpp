// SPDX-License-Identifier: Apache-2.0
#include "filters/view_depth.h"

namespace gobo {
inline namespace filters {

namespace {

class ViewDepthNode final : public Node {
 public:
  ViewDepthNode(const Camera& camera, int width, int height, int samples)
      : position_(camera.toWorld[3]), forward_(-Vec3(camera.toWorld[2])), alongRay_(camera.optics.panorama), extent_{width, height, samples} {}
  std::string type() const override { return "view_depth"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.addPod(position_).addPod(forward_).add(alongRay_).add(extent_.width).add(extent_.height).add(extent_.layers);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, extent_).reads<uint32_t>(0, "instance").reads<float>(0, "P", {3}).reads<float>(0, "depth");
    return w.gives({"pixels", Domain::Pixel, {extent_.width, extent_.height, 1}, {unsetPlane<float>("z_depth")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance");
    const auto P = ctx.inputs[0]->floats("P"), depth = ctx.inputs[0]->floats("depth");
    const auto& out = ctx.result;
    const auto z = out->writable<float>("z_depth");
    const size_t pixels = size_t(extent_.width) * size_t(extent_.height);
    const DVec3 eye(position_), axis(forward_);
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 13,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p) {
            double sum = 0.0;
            int hits = 0;
            for (int s = 0; s < extent_.layers; ++s) {
              const size_t at = size_t(s) * pixels + p;
              if (instance[at] == ~0u) continue;
              ++hits;
              sum += alongRay_ ? double(depth[at]) : glm::dot(DVec3(P[3 * at], P[3 * at + 1], P[3 * at + 2]) - eye, axis);
            }
            z[p] = hits ? float(sum / hits) : 0.0f;
          }
        },
        ctx.stop);
    return complete ? Result<TermPtr>(TermPtr(out)) : Status(Code::Cancelled, "stopped");
  }

 private:
  Vec3 position_, forward_;
  bool alongRay_;
  Extent extent_;
};

}  // namespace

NodePtr makeViewDepthNode(const Camera& camera, int width, int height, int viewSamples) {
  return std::make_shared<ViewDepthNode>(camera, width, height, viewSamples);
}

}  // namespace filters
}  // namespace gobo
