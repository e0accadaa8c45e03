// SPDX-License-Identifier: Apache-2.0
// What shadow techniques say of the lights that they do, and what shadows.auto has to choose from.
#include <gtest/gtest.h>

#include "filters/automatic/candidates.h"
#include "filters/shadow_map/techniques.h"
#include "scene/load.h"
#include "support/lit_scene.h"
#include "terms/gbuffer.h"

namespace {

using namespace gobo;

struct Seen {
  Graph graph;
  ShadowInput input;
};
Seen seen(const char* builtin, const LightShape& lamp) {
  auto scene = std::make_shared<Scene>(**makeBuiltinScene(builtin));
  Light light;
  light.name = "lamp";
  light.shape = lamp;
  scene->lights = {light};
  EXPECT_TRUE(scene->seal().ok());
  Seen s;
  s.input.scene = scene;
  s.input.camera = scene->cameras.at(0);
  s.input.width = 120;
  s.input.height = 80;
  s.input.gbuffer = s.graph.add({makeGBufferNode({s.input.camera, 120, 80, 1}), {}, {}, "gbuffer", 0, scene, false});
  return s;
}

LightShape lamp(LightKind kind, bool twoSided = false) {
  LightShape s = test::rectLight(Vec3(0, 2, 0), Vec3(0.4f, 0, 0), Vec3(0, 0, 0.3f), twoSided);
  s.kind = kind;
  return s;
}

// A map is one view from the light, down its axis: what is behind such a lamp would have no shadow.
TEST(ShadowChoice, LampsThatShineToBothSidesHaveNoMap) {
  for (const LightKind kind : {LightKind::Rect, LightKind::Disk, LightKind::Sphere}) {
    const bool flat = kind != LightKind::Sphere;
    for (const ShadowTechniqueEntry& t : shadowTechniques()) {
      EXPECT_TRUE(t.does(lamp(kind))) << t.name << " " << int(kind);
      EXPECT_EQ(t.does(lamp(kind, true)), !(t.usesMap && flat)) << t.name << " " << int(kind);
    }
    for (const bool twoSided : {false, true}) {
      Seen s = seen("fence", lamp(kind, twoSided));
      v1::ShadowTechnique t;
      t.mutable_map()->set_resolution(64);
      EXPECT_EQ(planVarianceShadow(s.graph, s.input, t).ok(), !(twoSided && flat));
      const auto candidates = shadowCandidates(s.input, t);
      ASSERT_TRUE(candidates.ok()) << candidates.status().toString();
      int maps = 0, others = 0;
      for (const AutomaticCandidate& c : candidates->list) (c.text.find("percentage_closer") == std::string::npos ? others : maps)++;
      EXPECT_EQ(maps > 0, !(twoSided && flat)) << int(kind);
      EXPECT_GT(others, 4);
    }
  }
}

Hash128 parametersOf(const NodePtr& node) {
  Hasher h(node->type());
  node->hashParameters(h);
  return h.digest();
}

// shadows.auto judges a hard map by rays through its texels before it is there: they must be the texels that it will have.
TEST(ShadowChoice, MapsAreJudgedAsTheyWouldBeMade) {
  LightShape sun, spot = lamp(LightKind::Spot), point = lamp(LightKind::Point);
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(0.3f, -1, 0.2f));
  for (const LightShape& light : {sun, spot, point}) {
    Hash128 of[2];
    for (const auto fit : {v1::ShadowMapSettings::SCENE, v1::ShadowMapSettings::CAMERA})
      for (const ViewPlace& place : {ViewPlace{}, ViewPlace{20, 30, 240, 160}, ViewPlace{-10, -10, 100, 60}}) {
        Seen s = seen("fence", light);
        s.input.camera.yfov = 0.2f;
        s.input.place = place;
        v1::ShadowTechnique t;
        t.mutable_map()->set_fit(fit);
        const auto candidates = shadowCandidates(s.input, t);
        ASSERT_TRUE(candidates.ok()) << candidates.status().toString();
        int maps = 0;
        for (size_t k = 0; k < candidates->list.size(); ++k) {
          const std::optional<ProbeMap>& judged = candidates->costs[k].virtualMap;
          if (!judged) continue;
          const auto id = planPercentageCloser(s.graph, s.input, candidates->list[k].technique);
          ASSERT_TRUE(id.ok()) << id.status().toString();
          const NodePtr made = s.graph.at(s.graph.at(*id).inputs.at(1)).node;
          ASSERT_EQ(made->type(), "light_depth_map");
          EXPECT_EQ(parametersOf(made).hex(), parametersOf(makeLightDepthMapNode(judged->frames, judged->resolution)).hex())
              << int(light.kind) << " fit " << int(fit) << ", " << judged->resolution << " texels";
          ++maps;
          of[fit == v1::ShadowMapSettings::CAMERA] = parametersOf(made);
        }
        EXPECT_EQ(maps, 5);
      }
    EXPECT_NE(of[0].hex(), of[1].hex()) << int(light.kind) << ": this camera sees all of the scene";
  }
}

}  // namespace
