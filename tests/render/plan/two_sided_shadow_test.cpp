// SPDX-License-Identifier: Apache-2.0
// A lamp that shines to both sides has shadows on both, whatever technique a request names.
#include <gtest/gtest.h>

#include "filters/shadow_technique.h"
#include "scene/builtin/build.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

/// A floor, a ceiling, and between a lamp and the ceiling a board, all seen from below.
ScenePtr room(LightKind kind) {
  builtin::SceneBuilder b("room");
  const int grey = b.material("grey", Vec3(0.5f));
  builtin::MeshBuilder floor, ceiling, board;
  floor.quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4));
  ceiling.quad(Vec3(-2, 4, -2), Vec3(4, 0, 0), Vec3(0, 0, 4));
  board.quad(Vec3(-0.5f, 3, -0.5f), Vec3(1, 0, 0), Vec3(0, 0, 1));
  b.add("floor", floor, grey, false);
  b.add("ceiling", ceiling, grey);
  b.add("board", board, grey);
  b.camera("below", Vec3(0, 0.3f, 1.9f), Vec3(0, 4, -0.5f), 60.0f);
  const ScenePtr made = *b.finish();
  auto scene = std::make_shared<Scene>(*made);
  Light lamp;
  lamp.name = "lamp";
  lamp.shape.kind = kind;
  lamp.shape.position = Vec3(0, 2, 0);
  lamp.shape.axis = Vec3(0, -1, 0);
  lamp.shape.u = Vec3(0.2f, 0, 0);
  lamp.shape.v = Vec3(0, 0, 0.2f);
  lamp.shape.radius = 0.2f;
  lamp.shape.twoSided = true;
  scene->lights = {lamp};
  const Status sealed = scene->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return scene;
}

RenderResult shadowIn(const ScenePtr& scene, const v1::ShadowTechnique& technique) {
  v1::RenderRequest r = smallRequest("room", 32, 24, 1);
  r.add_outputs("visibility:lamp");
  *r.mutable_shadows() = technique;
  RenderControl control;
  control.scene = scene;
  Result<RenderResult> result = makeEngine()->render(r, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  return result.ok() ? std::move(*result) : RenderResult{};
}

TEST(TwoSidedShadow, MapsLeaveItToRays) {
  for (const LightKind kind : {LightKind::Rect, LightKind::Disk}) {
    const ScenePtr scene = room(kind);
    v1::ShadowTechnique rays;
    rays.mutable_ray_traced()->set_samples(16);
    const RenderResult truth = shadowIn(scene, rays);
    ASSERT_EQ(truth.images.size(), 1u);
    float least = 1;
    for (const float v : truth.images[0].image().data) least = std::min(least, v);
    EXPECT_EQ(least, 0.0f) << "the ceiling is behind the lamp";
    for (const ShadowTechniqueEntry& t : shadowTechniques()) {
      if (!t.usesMap) continue;
      v1::ShadowTechnique technique;
      technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
      technique.mutable_map()->set_resolution(64);
      const RenderResult r = shadowIn(scene, technique);
      EXPECT_EQ(firstDifference(r, truth), "") << t.name;
      bool warned = false;
      for (const std::string& w : r.reply.warnings()) warned |= w.find(std::string(t.name) + " does not do") != std::string::npos;
      EXPECT_TRUE(warned) << t.name;
    }
    v1::ShadowTechnique automatic;
    automatic.mutable_auto_()->set_error(0.25);
    const RenderResult chosen = shadowIn(scene, automatic);
    EXPECT_EQ(chosen.images.size(), 1u);
    for (const v1::NodeReport& n : chosen.reply.plan()) EXPECT_EQ(n.node().find("percentage_closer"), std::string::npos) << n.node();
  }
}

}  // namespace
}  // namespace gobo::testing
