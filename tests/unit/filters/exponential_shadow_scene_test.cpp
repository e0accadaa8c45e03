// SPDX-License-Identifier: Apache-2.0
// The whole technique on a card above a floor, planned as the engine plans it and run node by node, against shadow rays.
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/shadow_map/techniques.h"
#include "terms/gbuffer.h"
#include "trace/accel.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

MeshPtr quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d) {
  auto mesh = std::make_shared<Mesh>();
  mesh->positions = {a, b, c, d};
  mesh->indices = {0, 1, 2, 0, 2, 3};
  sealMesh(*mesh);
  return mesh;
}

/// A closed body: the sides of a box, outwards.
MeshPtr closedBody(const Vec3& lo, const Vec3& hi) {
  auto mesh = std::make_shared<Mesh>();
  for (int axis = 0; axis < 3; ++axis)
    for (const bool upper : {false, true}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      Vec3 a = lo;
      if (upper) a[axis] = hi[axis];
      Vec3 b = a, c = a, d = a;
      b[u] = c[u] = hi[u];
      c[v] = d[v] = hi[v];
      if (!upper) std::swap(b, d);
      const auto first = uint32_t(mesh->positions.size());
      for (const Vec3& p : {a, b, c, d}) mesh->positions.push_back(p);
      for (const uint32_t k : {0u, 1u, 2u, 0u, 2u, 3u}) mesh->indices.push_back(first + k);
    }
  sealMesh(*mesh);
  return mesh;
}

/// Floor y = 0 of 4 x 4 m; if `card`, a 1 x 1 m card at y = 1 over its middle; one light of `kind` at (0, 3, 0) or so.
ScenePtr cardScene(LightKind kind, bool card = true) {
  auto scene = std::make_shared<Scene>();
  scene->name = "card";
  scene->meshes.push_back(quad({-2, 0, -2}, {-2, 0, 2}, {2, 0, 2}, {2, 0, -2}));
  scene->instances.push_back({.name = "floor", .mesh = 0});
  if (card) {
    scene->meshes.push_back(quad({-0.5f, 1, -0.5f}, {-0.5f, 1, 0.5f}, {0.5f, 1, 0.5f}, {0.5f, 1, -0.5f}));
    scene->instances.push_back({.name = "card", .mesh = 1});
  }
  scene->materials.emplace_back();
  Light light;
  light.name = "lamp";
  light.shape.kind = kind;
  light.shape.position = Vec3(0.1f, 3, -0.2f);
  light.shape.axis = glm::normalize(kind == LightKind::Directional ? Vec3(0.3f, -1, 0.2f) : Vec3(0, -1, 0));
  light.shape.cosInner = std::cos(0.5f);
  light.shape.cosOuter = std::cos(0.6f);
  scene->lights.push_back(light);
  Camera camera;
  camera.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0.9578263f, -0.2873479f, 0), Vec4(0, 0.2873479f, 0.9578263f, 0), Vec4(0, 0.9f, 3.0f, 1));
  scene->cameras.push_back(camera);
  const Status sealed = scene->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return scene;
}

struct Planned {
  Graph graph;
  NodeId gbuffer = -1, visibility = -1;
};

Result<NodeId> plan(Planned& p, const ScenePtr& scene, const v1::ShadowTechnique& technique) {
  GraphNode g;
  g.node = makeGBufferNode({scene->cameras[0], 64, 48, 1});
  g.scene = scene;
  p.gbuffer = p.graph.add(std::move(g));
  ShadowInput input;
  input.scene = scene;
  input.gbuffer = p.gbuffer;
  input.camera = scene->cameras[0];
  input.width = 64;
  input.height = 48;
  auto id = planExponentialShadow(p.graph, input, technique);
  if (id.ok()) p.visibility = *id;
  return id;
}

std::vector<TermPtr> runAll(const Graph& graph, RunCounters& counters) {
  TaskArena arena(2);
  AccelCache accels;
  std::vector<TermPtr> terms;
  for (NodeId id = 0; id < graph.size(); ++id) {
    const GraphNode& n = graph.at(id);
    RunContext ctx;
    ctx.arena = &arena;
    ctx.counters = &counters;
    for (NodeId i : n.inputs) ctx.inputs.push_back(terms[size_t(i)]);
    std::unique_ptr<SceneView> view;
    if (n.node->traits().facets != Facet::None) {
      view = std::make_unique<SceneView>(*n.scene, n.node->traits().facets, n.lights);
      ctx.scene = view.get();
      ctx.accels = &accels;
    }
    auto term = runNode(*n.node, ctx);
    EXPECT_TRUE(term.ok()) << n.label << ": " << term.status().toString();
    if (!term.ok()) return terms;
    EXPECT_LE((*term)->planes()[0].bytes.size(), n.shape.bytes() + 1) << n.label;
    terms.push_back(*term);
  }
  return terms;
}

v1::ShadowTechnique technique(uint32_t resolution, uint32_t blur, v1::ExponentialShadow::Device device = v1::ExponentialShadow::CPU) {
  v1::ShadowTechnique t;
  t.mutable_map()->set_resolution(resolution);
  t.mutable_map()->set_blur(blur);
  t.mutable_exponential()->set_device(device);
  return t;
}

TEST(ExponentialShadowScene, AgreesWithShadowRaysAwayFromEdges) {
  for (LightKind kind : {LightKind::Directional, LightKind::Spot, LightKind::Rect, LightKind::Disk, LightKind::Point}) {
    const ScenePtr scene = cardScene(kind);
    Planned p;
    const auto id = plan(p, scene, technique(512, 1));
    ASSERT_TRUE(id.ok()) << id.status().toString();
    RunCounters counters;
    const auto terms = runAll(p.graph, counters);
    ASSERT_EQ(int(terms.size()), p.graph.size());
    const Term& g = *terms[size_t(p.gbuffer)];
    const auto V = terms[size_t(p.visibility)]->floats("V"), P = g.floats("P");
    const auto instance = g.plane<uint32_t>("instance");
    ASSERT_EQ(terms[size_t(p.visibility)]->extent(), g.extent());
    // Truth from geometry: does the segment to the light cross the card, by what margin?
    const LightShape& light = scene->lights[0].shape;
    int dark = 0, lit = 0, wrong = 0;
    for (size_t i = 0; i < V.size(); ++i) {
      if (instance[i] == ~0u) {
        EXPECT_EQ(V[i], 1.0f);
        continue;
      }
      const Vec3 x(P[3 * i], P[3 * i + 1], P[3 * i + 2]);
      if (x.y > 0.5f) {
        wrong += V[i] < 0.99f;
        continue;
      }  // on the card: faces the light or is seen from below
      const Vec3 to = kind == LightKind::Directional ? -light.axis : light.position - x;
      const Vec3 at = x + to / to.y;
      const float margin = std::max(std::abs(at.x), std::abs(at.z)) - 0.5f;
      if (std::abs(margin) < 0.03f) continue;
      const float angle = std::acos(glm::dot(glm::normalize(-to), light.axis));
      const bool covered = kind != LightKind::Spot || angle < 0.58f;
      if (margin < 0 && covered) {
        ++dark;
        wrong += V[i] > 0.01f;
      } else {
        ++lit;
        wrong += V[i] < 0.99f;
      }
    }
    EXPECT_GT(dark, 40) << int(kind);
    EXPECT_GT(lit, 200) << int(kind);
    EXPECT_EQ(wrong, 0) << int(kind);
  }
}

TEST(ExponentialShadowScene, LightThatSeesNothingLightsEverything) {
  auto away = std::make_shared<Scene>(*cardScene(LightKind::Spot));
  away->lights[0].shape.axis = Vec3(0, 1, 0);
  ASSERT_TRUE(away->seal().ok());
  Planned p;
  ASSERT_TRUE(plan(p, away, technique(64, 2)).ok());
  RunCounters counters;
  const auto terms = runAll(p.graph, counters);
  for (float v : terms.back()->floats("V")) EXPECT_EQ(v, 1.0f);
}

TEST(ExponentialShadowScene, BareFloorHasNoAcne) {
  for (LightKind kind : {LightKind::Directional, LightKind::Spot, LightKind::Rect, LightKind::Point})
    for (uint32_t resolution : {1u, 7u, 256u}) {
      Planned p;
      // A flat scene under a lamp is the worst case: its depth range is a few roundings of the distance. With the bias of 0.001 ranges.
      v1::ShadowTechnique t = technique(resolution, 2);
      t.mutable_map()->set_bias(0.001);
      ASSERT_TRUE(plan(p, cardScene(kind, false), t).ok());
      RunCounters counters;
      const auto terms = runAll(p.graph, counters);
      for (float v : terms.back()->floats("V"))
        if (resolution == 256) {
          ASSERT_GT(v, 0.98f) << int(kind);
        } else {
          ASSERT_TRUE(v >= 0.0f && v <= 1.0f);
        }
    }
}

TEST(ExponentialShadowScene, DevicesAgreeOnTheWholeTechnique) {
  ASSERT_TRUE(VulkanDevice::shared().ok() && EglDevice::shared().ok());
  // A body whose side towards the camera turns away from the lamp: lit, as no light is missing there.
  const auto scene = std::make_shared<Scene>(*cardScene(LightKind::Spot));
  const auto body = uint32_t(scene->instances.size());
  scene->meshes.push_back(closedBody({-0.4f, 0.2f, -0.4f}, {0.4f, 0.8f, 0.4f}));
  scene->instances.push_back({.name = "body", .mesh = int(scene->meshes.size()) - 1});
  ASSERT_TRUE(scene->seal().ok());
  std::vector<TermPtr> results;
  TermPtr gbuffer;
  for (const auto device : {v1::ExponentialShadow::CPU, v1::ExponentialShadow::VULKAN, v1::ExponentialShadow::EGL}) {
    Planned p;
    ASSERT_TRUE(plan(p, scene, technique(256, 3, device)).ok());
    RunCounters counters;
    const auto terms = runAll(p.graph, counters);
    ASSERT_EQ(int(terms.size()), p.graph.size());
    results.push_back(terms.back());
    gbuffer = terms[size_t(p.gbuffer)];
  }
  const auto a = results[0]->floats("V"), b = results[1]->floats("V"), c = results[2]->floats("V");
  for (size_t i = 0; i < a.size(); ++i) {
    ASSERT_NEAR(a[i], b[i], 1e-4);
    ASSERT_NEAR(a[i], c[i], 1e-4);
  }
  const auto P = gbuffer->floats("P"), N = gbuffer->floats("N");
  const auto instance = gbuffer->plane<uint32_t>("instance");
  int away = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    if (instance[i] != body) continue;
    const Vec3 from = Vec3(P[3 * i], P[3 * i + 1], P[3 * i + 2]) - scene->lights[0].shape.position;
    if (!(glm::dot(from, Vec3(N[3 * i], N[3 * i + 1], N[3 * i + 2])) > 0.0f)) continue;
    ++away;
    EXPECT_EQ(a[i], 1.0f);
    EXPECT_EQ(b[i], 1.0f);
  }
  EXPECT_GT(away, 20);
}

TEST(ExponentialShadowScene, MapsBeyondTheDeviceAreRefusedBeforeTheyAreMade) {
  const auto device = EglDevice::shared();
  ASSERT_TRUE(device.ok()) << device.status().toString();
  const bool fits = (*device)->maxBufferBytes() >= uint64_t(8192) * 8192 * 4;  // llvmpipe: 128 MiB, half of it
  Planned p;
  const auto planned = plan(p, cardScene(LightKind::Spot), technique(8192, 2, v1::ExponentialShadow::EGL));
  EXPECT_EQ(planned.ok(), fits);
  if (fits) return;
  EXPECT_EQ(planned.status().code(), Code::ResourceExhausted);
  EXPECT_EQ(planned.status().location(), "shadows.map.resolution");
}

TEST(ExponentialShadowScene, OnlyWhatChangedIsANewNode) {
  const ScenePtr scene = cardScene(LightKind::Spot);
  Planned p;
  ASSERT_TRUE(plan(p, scene, technique(64, 2)).ok());
  EXPECT_EQ(p.graph.size(), 4);
  ASSERT_TRUE(plan(p, scene, technique(64, 2)).ok());
  EXPECT_EQ(p.graph.size(), 4);  // structurally equal
  ASSERT_TRUE(plan(p, scene, technique(64, 2, v1::ExponentialShadow::VULKAN)).ok());
  EXPECT_EQ(p.graph.size(), 6);  // the depth map is shared between devices
  ASSERT_TRUE(plan(p, scene, technique(64, 2, v1::ExponentialShadow::EGL)).ok());
  EXPECT_EQ(p.graph.size(), 8);
  auto bright = std::make_shared<Scene>(*scene);
  bright->lights[0].power = Vec3(7.0f);
  ASSERT_TRUE(bright->seal().ok());
  ASSERT_TRUE(plan(p, bright, technique(64, 2)).ok());
  EXPECT_EQ(p.graph.size(), 8);  // power is no part of a shadow
}

TEST(ExponentialShadowScene, RefusalsNameTheField) {
  const ScenePtr scene = cardScene(LightKind::Spot);
  Planned p;
  v1::ShadowTechnique t = technique(64, 2);
  const auto refused = [&](const ScenePtr& s, const v1::ShadowTechnique& technique, Code code, const char* field, const char* value) {
    const auto bad = plan(p, s, technique);
    EXPECT_FALSE(bad.ok()) << field;
    if (bad.ok()) return;
    EXPECT_EQ(bad.status().code(), code) << field;
    EXPECT_EQ(bad.status().location(), field);
    EXPECT_NE(bad.status().toString().find(value), std::string::npos) << bad.status().toString();
  };
  t.mutable_exponential()->set_c(88);
  t.mutable_exponential()->set_filtering(v1::ExponentialShadow::LINEAR);
  refused(scene, t, Code::InvalidArgument, "shadows.exponential.c", "88");
  t.mutable_exponential()->set_c(80);
  EXPECT_TRUE(plan(p, scene, t).ok());
  t.mutable_exponential()->set_c(2001);
  t.mutable_exponential()->set_filtering(v1::ExponentialShadow::AUTO);
  refused(scene, t, Code::InvalidArgument, "shadows.exponential.c", "2001");
  t = technique(64, 2);
  t.mutable_map()->set_lookup(v1::ShadowMapSettings::SUMMED_AREA);
  refused(scene, t, Code::InvalidArgument, "shadows.map.lookup", "SUMMED_AREA");
  // What devices do not do yet: cubes, logarithmic filtering, other lookups, classification.
  refused(cardScene(LightKind::Point), technique(64, 2, v1::ExponentialShadow::EGL), Code::Unimplemented, "shadows.exponential.device", "device");
  t = technique(64, 2, v1::ExponentialShadow::EGL);
  t.mutable_exponential()->set_c(90);
  refused(scene, t, Code::Unimplemented, "shadows.exponential.device", "80");
  t = technique(64, 2, v1::ExponentialShadow::EGL);
  t.mutable_map()->set_lookup(v1::ShadowMapSettings::TRILINEAR);
  refused(scene, t, Code::Unimplemented, "shadows.exponential.device", "BILINEAR");
  t = technique(64, 2, v1::ExponentialShadow::EGL);
  t.mutable_exponential()->set_classification(v1::ExponentialShadow::Z_MAX);
  refused(scene, t, Code::Unimplemented, "shadows.exponential.device", "classification");
  EXPECT_FALSE(shadowMapSupports(LightKind::Environment));
  EXPECT_FALSE(shadowMapSupports(LightKind::Mesh));
  for (LightKind kind : {LightKind::Directional, LightKind::Spot, LightKind::Point, LightKind::Rect, LightKind::Disk, LightKind::Sphere})
    EXPECT_TRUE(shadowMapSupports(kind));
}

}  // namespace
