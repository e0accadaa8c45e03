// SPDX-License-Identifier: Apache-2.0
// environment.transfer over materials that the surface term does not hold: white furnaces against path tracing, and what points reflect.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <vector>

#include "plan/engine.h"
#include "support/engines.h"
#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"

namespace gobo::transfer::extended_materials_test {
namespace {

using tests::SceneMaker;

struct Kind {
  const char* name;
  std::function<void(Bsdf&)> change;
};
const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all{
      {"diffuse transmission", [](Bsdf& b) { b.diffuseTransmission = 0.5f; }},
      {"clearcoat", [](Bsdf& b) { b.clearcoat = 1.0f; }},
      {"rough clearcoat", [](Bsdf& b) { b.clearcoat = 1.0f, b.clearcoatRoughness = 0.5f; }},
      {"sheen", [](Bsdf& b) { b.sheenColor = Vec3(1.0f), b.sheenRoughness = 0.5f; }},
      {"specular colour", [](Bsdf& b) { b.specular = 1.0f, b.specularColor = Vec3(0.5f), b.roughness = 0.5f; }},
  };
  return all;
}

double meanOf(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  const auto result = engine.render(request, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  double sum = 0, n = 0;
  if (result.ok())
    for (const float v : result->images[0].image().data) sum += double(v), ++n;
  return sum / std::max(n, 1.0);
}

// A white sheet and a white ball under radiance 1 from everywhere: what lies on the diffuse lobe, or passes it, is in the picture once.
TEST(TransferOfExtendedMaterials, AFurnaceIsThePathTracers) {
  const auto engine = testing::makeEngine();
  for (const Kind& kind : kinds())
    for (const bool ball : {false, true}) {
      SceneMaker m;
      const int white = m.material(Vec3(1.0f), [&](Material& x) { kind.change(x.bsdf); });
      m.instance(m.mesh(ball ? tests::sphere(Vec3(0.0f), 1.0f, 32, true) : tests::ground(2.0f), white));
      m.environment(constantEnvironment(Vec3(1.0f)));
      m.scene.lights.back().cameraVisible = false;
      m.camera(ball ? Vec3(0, 0, 4) : Vec3(0, 1.2f, 1.6f), Vec3(0.0f), ball ? 0.25f : 0.5f);  // nothing else in view
      const ScenePtr scene = m.finish();
      v1::RenderRequest r = testing::smallRequest("furnace", 20, 15, 256);
      r.mutable_integrator()->set_max_bounces(3);
      const double truth = meanOf(*engine, scene, r);
      for (const char* e : {"environment.transfer.samples=256", "environment.transfer.points=1500"}) testing::set(r, e);
      const double fast = meanOf(*engine, scene, r);
      std::printf("  %s, %s: %.4f, path traced %.4f\n", kind.name, ball ? "ball" : "sheet", fast, truth);
      EXPECT_GT(truth, 0.5) << kind.name << ball;
      EXPECT_NEAR(fast / truth, 1.0, 0.025) << kind.name << (ball ? " ball" : " sheet");
      EXPECT_LT(fast, 1.02) << kind.name << (ball ? " ball" : " sheet");
    }
}

// What passes is not reflected: a point's albedo has the rest.
TEST(TransferOfExtendedMaterials, PointsReflectWhatDoesNotPass) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.8f, 0.4f, 0.2f), [](Material& x) { x.bsdf.diffuseTransmission = 0.25f; })));
  const ScenePtr scene = m.finish();
  const std::vector<int> none;
  TransferSettings s;
  s.points = 100;
  s.bands = 2;
  s.size = uint32_t(receiverMesh(SceneView(*scene, ReceiverMesh::kFacets, none), s.points)->size());
  const TaskArena arena(2);
  tests::NodeRunner run(*scene, arena);
  const TermPtr points = run(makeTransferPointsNode(s), {}), albedo = run(makePointAlbedoNode(s), {points});
  const auto rgb = albedo->floats("rgb");
  ASSERT_GT(rgb.size(), 0u);
  for (size_t i = 0; i < rgb.size(); i += 3) {
    EXPECT_NEAR(rgb[i], 0.6f, 1e-6f);
    EXPECT_NEAR(rgb[i + 1], 0.3f, 1e-6f);
    EXPECT_NEAR(rgb[i + 2], 0.15f, 1e-6f);
  }
}

// Bounces that pass surfaces are the path tracer's, and the plan says so.
TEST(TransferOfExtendedMaterials, WhatBouncesThroughSurfacesIsPathTraced) {
  const auto engine = testing::makeEngine();
  for (const bool passes : {false, true}) {
    SceneMaker m;
    m.instance(m.mesh(tests::ground(2.0f), m.material(Vec3(0.5f))));
    m.instance(m.mesh(tests::ground(0.5f, 0.5f), m.material(Vec3(0.5f), [&](Material& x) { x.bsdf.diffuseTransmission = passes ? 0.5f : 0.0f; })));
    m.environment(constantEnvironment(Vec3(1.0f)));
    m.camera(Vec3(0, 2.0f, 2.0f), Vec3(0.0f), 0.7f);
    RenderControl control;
    control.scene = m.finish();
    v1::RenderRequest r = testing::smallRequest("leaf", 16, 12, 4);
    testing::set(r, "environment.transfer.points=300");
    const auto result = engine->render(r, control);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    const auto ran = testing::nodesBy(*result, v1::NodeReport::RUN);
    EXPECT_TRUE(ran.count("environment:direct"));
    EXPECT_EQ(ran.count("environment:bounced"), passes ? 0u : 1u);
    bool said = false;
    for (const auto& row : result->reply.plan()) said = said || (row.node() == "transfer:bounces" && row.reason().find("path traced") != std::string::npos);
    EXPECT_EQ(said, passes);
  }
}

}  // namespace
}  // namespace gobo::transfer::extended_materials_test
