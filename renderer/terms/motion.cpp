// SPDX-License-Identifier: Apache-2.0
#include "terms/motion.h"

#include "trace/accel.h"

namespace gobo {
inline namespace terms {

namespace {

constexpr Facet kFacets = Facet::Topology | Facet::Pose;

struct Pose {
  std::vector<MeshView<kFacets>> meshes;
  const std::vector<Instance>* instances;
  explicit Pose(const SceneView& view) : instances(&view.instances()) {
    for (size_t m = 0; m < view.meshCount(); ++m) meshes.push_back(view.mesh<kFacets>(int(m)));
  }
  /// In the world of `placed` (another pose's, or this one), a place on a triangle of this one's.
  DVec3 at(int instance, uint32_t primitive, double u, double v, const Instance& placed) const {
    const auto& m = meshes[size_t((*instances)[instance].mesh)];
    const uint32_t* t = m.indices.data() + 3 * size_t(primitive);
    const DVec3 p = (1.0 - u - v) * DVec3(m.positions[t[0]]) + u * DVec3(m.positions[t[1]]) + v * DVec3(m.positions[t[2]]);
    return DVec3(glm::dmat4(placed.toWorld) * glm::dvec4(p, 1.0));
  }
  const Instance& instance(int i) const { return (*instances)[size_t(i)]; }
  const Array<uint32_t>& indices(int i) const { return meshes[size_t(instance(i).mesh)].indices; }
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
    // Where each instance was: the same index as a rule, else by name; -1: it was not there. A mesh that clustering made of another pose has other
    // triangles (scene/mesh_filters): what is known of it is how its object moved.
    std::vector<int> earlier(now.instances->size(), -1);
    std::vector<char> sameTriangles(earlier.size(), 0);
    for (size_t i = 0; i < earlier.size(); ++i) {
      const std::string& name = (*now.instances)[i].name;
      int at = int(i);
      if (i >= before.instances->size() || (*before.instances)[i].name != name) at = s_.earlierScene->findInstance(name);
      earlier[i] = at;
      if (at < 0) continue;
      const Array<uint32_t>&a = before.indices(at), &b = now.indices(int(i));
      sameTriangles[i] = a.size() == b.size() && (a.data() == b.data() || a == b);
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
                const float u = bary[2 * p], v = bary[2 * p + 1];
                here = there = glm::dvec4(now.at(i, primitive[p], u, v, now.instance(i)), 1.0);
                if (earlier[i] >= 0) {
                  const Instance& placed = before.instance(earlier[i]);
                  there = glm::dvec4(sameTriangles[i] ? before.at(earlier[i], primitive[p], u, v, placed) : now.at(i, primitive[p], u, v, placed), 1.0);
                }
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

}  // namespace terms
}  // namespace gobo
