// SPDX-License-Identifier: Apache-2.0
#include "terms/motion.h"

#include "trace/accel.h"

namespace gobo {

namespace {

constexpr Facet kFacets = Facet::Topology | Facet::Pose;

struct Pose {
  std::vector<MeshView<kFacets>> meshes;
  const std::vector<Instance>* instances;
  explicit Pose(const SceneView& view) : instances(&view.instances()) {
    for (size_t m = 0; m < view.meshCount(); ++m) meshes.push_back(view.mesh<kFacets>(int(m)));
  }
  DVec3 at(int instance, uint32_t primitive, double u, double v) const {
    const Instance& i = (*instances)[instance];
    const auto& m = meshes[size_t(i.mesh)];
    const uint32_t* t = m.indices.data() + 3 * size_t(primitive);
    const DVec3 p = (1.0 - u - v) * DVec3(m.positions[t[0]]) + u * DVec3(m.positions[t[1]]) + v * DVec3(m.positions[t[2]]);
    return DVec3(glm::dmat4(i.toWorld) * glm::dvec4(p, 1.0));
  }
  size_t triangles(int instance) const { return meshes[size_t((*instances)[instance].mesh)].triangles(); }
};

class MotionNode final : public Node {
 public:
  explicit MotionNode(const MotionSettings& s) : s_(s) {}
  std::string type() const override { return "motion"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.view.camera);
    hashCamera(h, s_.earlierCamera);
    h.add(s_.view.width).add(s_.view.height).add(s_.view.viewSamples);
    s_.view.place.hash(h);
    h.add(s_.earlierScene->facetHash(kFacets, {}));
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, s_.view.extent()).reads<uint32_t>(0, "instance").reads<uint32_t>(0, "primitive").reads<float>(0, "bary", {2});
    return w.gives({"pixels", Domain::Pixel, {s_.view.width, s_.view.height, 1}, {plane<float>("motion", 2)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs[0];
    const auto instance = g.plane<uint32_t>("instance"), primitive = g.plane<uint32_t>("primitive");
    const auto bary = g.floats("bary");
    const int w = s_.view.width, h = s_.view.height, W = s_.view.filmWidth(), H = s_.view.filmHeight();
    const std::vector<int> none;
    const Pose now(*ctx.scene), before(SceneView(*s_.earlierScene, kFacets, none));
    // Where each instance was: the same index as a rule, else by name; -1: it was not there.
    std::vector<int> earlier(now.instances->size(), -1);
    for (size_t i = 0; i < earlier.size(); ++i) {
      const std::string& name = (*now.instances)[i].name;
      int at = int(i);
      if (i >= before.instances->size() || (*before.instances)[i].name != name) at = s_.earlierScene->findInstance(name);
      if (at >= 0 && before.triangles(at) == now.triangles(int(i))) earlier[i] = at;
    }
    const Vec2 offset = viewSamplePosition(0, s_.view.viewSamples);
    const auto& out = ctx.result;
    const auto motion = out->writable<float>("motion");
    const bool complete = ctx.arena->parallelFor(
        size_t(h), 8,
        [&](size_t begin, size_t end) {
          for (size_t y = begin; y < end; ++y)
            for (int x = 0; x < w; ++x) {
              const size_t p = y * w + x;
              glm::dvec4 here, there;
              if (instance[p] == kNoHit) {
                here = there = glm::dvec4(
                    DVec3(cameraRay(s_.view.camera, W, H, float(s_.view.place.x + x) + offset.x, float(s_.view.place.y + int(y)) + offset.y).direction), 0.0);
              } else {
                const int i = int(instance[p]);
                here = there = glm::dvec4(now.at(i, primitive[p], bary[2 * p], bary[2 * p + 1]), 1.0);
                if (earlier[i] >= 0) there = glm::dvec4(before.at(earlier[i], primitive[p], bary[2 * p], bary[2 * p + 1]), 1.0);
              }
              glm::dvec2 to, from;
              if (!filmPosition(s_.view.camera, W, H, here, to) || !filmPosition(s_.earlierCamera, W, H, there, from)) continue;
              double across = to.x - from.x;
              if (s_.view.camera.optics.panorama && std::fabs(across) > 0.5 * W) across -= std::copysign(double(W), across);  // over the seam: the shorter way
              const float dx = float(across), dy = float(to.y - from.y);
              if (!std::isfinite(dx) || !std::isfinite(dy)) continue;
              motion[2 * p] = dx;
              motion[2 * p + 1] = dy;
            }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  MotionSettings s_;
};

}  // namespace

NodePtr makeMotionNode(const MotionSettings& settings) { return std::make_shared<MotionNode>(settings); }

}  // namespace gobo
