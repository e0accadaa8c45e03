// SPDX-License-Identifier: Apache-2.0
// Soft shadow maps on built-in scenes against ray-traced visibility: how far each technique is from the truth, and from dense comparison on the
// same map, which is the floor of all of them.
#include <gtest/gtest.h>

#include "filters/shadow_technique.h"
#include "scene/load.h"
#include "terms/gbuffer.h"
#include "trace/accel.h"

namespace gobo {
namespace {

struct Stage {
  ScenePtr scene;
  int light = 0, width = 96, height = 72;
  std::string camera;
  Graph graph;
  std::vector<TermPtr> terms;
  AccelCache accels;
  NodeId gbuffer = -1;

  ShadowInput input() {
    ShadowInput i;
    i.scene = scene;
    i.light = light;
    for (const Camera& c : scene->cameras)
      if (c.name == camera) i.camera = c;
    i.width = width;
    i.height = height;
    if (gbuffer < 0) gbuffer = graph.add({makeGBufferNode({i.camera, width, height, 1}), {}, {}, "gbuffer", 0, scene, false});
    i.gbuffer = gbuffer;
    return i;
  }
  TermPtr visibility(const v1::ShadowTechnique& t) {
    const auto id = findShadowTechnique(t.technique_case())->plan(graph, input(), t);
    EXPECT_TRUE(id.ok()) << (id.ok() ? "" : id.status().toString());
    const TaskArena arena(2);
    for (NodeId n = NodeId(terms.size()); n < graph.size(); ++n) {
      const GraphNode& node = graph.at(n);
      RunContext ctx;
      std::optional<SceneView> view;
      if (node.scene) view.emplace(*node.scene, node.node->traits().facets, node.lights);
      ctx.scene = view ? &*view : nullptr;
      for (NodeId k : node.inputs) ctx.inputs.push_back(terms[size_t(k)]);
      ctx.arena = &arena;
      ctx.accels = &accels;
      RunCounters counters;
      ctx.counters = &counters;
      auto r = runNode(*node.node, ctx);
      GOBO_CHECK(r.ok());
      EXPECT_LE((*r)->bytes(), node.shape.bytes() + (*r)->extent().elements() * 64) << node.label;
      terms.push_back(*r);
    }
    return terms[size_t(*id)];
  }
};

struct Named {
  const char* name;
  v1::ShadowTechnique technique;
};
std::vector<Named> techniques(uint32_t resolution) {
  std::vector<Named> list;
  const auto add = [&](const char* name) -> v1::ShadowTechnique& {
    list.push_back({name, {}});
    list.back().technique.mutable_map()->set_resolution(resolution);
    return list.back().technique;
  };
  add("dense").mutable_percentage_closer_soft()->set_dense(true);
  add("taps 32/64").mutable_percentage_closer_soft();
  {
    auto* m = add("taps 16/16").mutable_percentage_closer_soft();
    m->set_search_taps(16);
    m->set_filter_taps(16);
  }
  add("convolution 4, shifted").mutable_convolution_soft();
  for (uint32_t order : {4, 8, 16}) {
    auto* m = add(order == 4 ? "convolution 4, offset" : order == 8 ? "convolution 8, offset" : "convolution 16, offset").mutable_convolution_soft();
    m->set_order(order);
    m->set_correction(v1::ConvolutionShadow::OFFSET);
  }
  auto& chain = add("convolution 8, chain");
  chain.mutable_convolution_soft()->set_order(8);
  chain.mutable_map()->set_lookup(v1::ShadowMapSettings::TRILINEAR);
  auto* near = add("convolution 8, near plane").mutable_convolution_soft();
  near->set_order(8);
  near->set_search(v1::ConvolutionSoftShadow::NEAR_PLANE);
  auto* iterated = add("convolution 8, iterated").mutable_convolution_soft();
  iterated->set_order(8);
  iterated->set_search(v1::ConvolutionSoftShadow::ITERATED);
  add("variance").mutable_variance_soft();
  add("variance, whole").mutable_variance_soft()->set_subdivide(false);
  add("exponential variance").mutable_exponential_variance_soft();
  return list;
}

struct Errors {
  double all = 0, penumbra = 0;
};
Errors errors(const TermPtr& V, const TermPtr& truth, const Term& g) {
  const auto v = V->floats("V"), t = truth->floats("V");
  const auto instance = g.plane<uint32_t>("instance");
  double sum = 0, n = 0, soft = 0, m = 0;
  for (size_t i = 0; i < v.size(); ++i) {
    if (instance[i] == ~0u) continue;
    const double e = sqr(double(v[i]) - double(t[i]));
    sum += e;
    ++n;
    if (t[i] > 0.01f && t[i] < 0.99f) {
      soft += e;
      ++m;
    }
  }
  return {std::sqrt(sum / std::max(n, 1.0)), std::sqrt(soft / std::max(m, 1.0))};
}

/// Loose bounds: largest error of the dense oracle, and how much more than it others may have.
void compare(Stage& s, const char* name, double floorBound, double others, uint32_t resolution = 512) {
  v1::ShadowTechnique rays;
  rays.mutable_ray_traced()->set_samples(512);
  const TermPtr truth = s.visibility(rays);
  double floor = 0;
  for (const Named& t : techniques(resolution)) {
    const TermPtr V = s.visibility(t.technique);
    for (float x : V->floats("V")) ASSERT_TRUE(x >= 0 && x <= 1) << t.name;
    const Errors e = errors(V, truth, *s.terms[size_t(s.gbuffer)]);
    std::printf("%s, %s: rmse %.4f, in the penumbra %.4f\n", name, t.name, e.all, e.penumbra);
    if (std::string_view(t.name) == "dense") {
      floor = e.all;
      EXPECT_LT(e.all, floorBound) << name;
    }
    const std::string_view n = t.name;
    const bool near = n == "dense" || n.starts_with("taps");
    EXPECT_LT(e.all, near ? 1.5 * floor + 0.01 : others * floor + 0.02) << name << ", " << t.name;
  }
}

ScenePtr withLight(const char* scene, const LightShape& shape) {
  auto s = std::make_shared<Scene>(**makeBuiltinScene(scene));
  Light light;
  light.name = "lamp";
  light.shape = shape;
  s->lights = {light};
  const Status sealed = s->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return s;
}

int lightNamed(const Scene& scene, const std::string& name) {
  for (size_t i = 0; i < scene.lights.size(); ++i)
    if (scene.lights[i].name == name) return int(i);
  return 0;
}

TEST(SoftShadowScenes, FenceUnderALowRectangle) {
  Stage s;
  s.scene = *makeBuiltinScene("fence");
  s.light = lightNamed(*s.scene, "key");
  s.camera = "front";
  compare(s, "fence", 0.1, 3);
}

TEST(SoftShadowScenes, TreesUnderADisk) {
  Stage s;
  LightShape disk;
  disk.kind = LightKind::Disk;
  disk.axis = -glm::normalize(Vec3(0.45f, 0.75f, 0.5f));
  disk.position = Vec3(-0.5f, 1, -3) - 30.0f * disk.axis;
  disk.radius = 1.5f;
  s.scene = withLight("trees", disk);
  s.camera = "front";
  compare(s, "trees", 0.3, 3);
}

TEST(SoftShadowScenes, TreesUnderASunOfSomeSize) {
  Stage s;
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = -glm::normalize(Vec3(0.45f, 0.75f, 0.5f));
  sun.angularSize = 0.1f;
  s.scene = withLight("trees", sun);
  s.camera = "front";
  compare(s, "trees, sun", 0.3, 3);
}

TEST(SoftShadowScenes, SphereInTheMiddleOfSpheres) {
  Stage s;
  LightShape sphere;
  sphere.kind = LightKind::Sphere;
  s.scene = withLight("spheres", sphere);
  Vec3 lo, hi;
  s.scene->bounds(lo, hi);
  sphere.position = Vec3(0.5f * (lo.x + hi.x), hi.y + 1.0f, 0.5f * (lo.z + hi.z));
  sphere.radius = 0.6f;
  s.scene = withLight("spheres", sphere);
  s.camera = s.scene->cameras[0].name;
  compare(s, "spheres", 0.15, 4.6, 256);  // six faces
}

}  // namespace
}  // namespace gobo
