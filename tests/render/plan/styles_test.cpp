// SPDX-License-Identifier: Apache-2.0
// shadows.style in requests: what has one, what has none, and what is refused by name.
#include <gtest/gtest.h>

#include <set>

#include "support/engines.h"

namespace gobo::testing {
namespace styles_test {

using Labels = std::set<std::string>;

Labels all(const RenderResult& r) {
  Labels out;
  for (const auto& n : r.reply.plan())
    if (n.state() != v1::NodeReport::PRUNED) out.insert(n.node());
  return out;
}

// What stands for the environment is one light together: none of its parts has a shadow that could be drawn otherwise.
TEST(Styles, LightsOfTheEnvironmentHaveNone) {
  for (const char* as : {"environment.extract_lights=4", "environment.area_lights=4", "integrator.max_bounces=2"}) {
    v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
    for (const char* a : {"shadows.style.softness=0.1", "lights.light.enabled=false", "environment.sky.turbidity=3"}) set(r, a);
    set(r, as);
    const auto engine = makeEngine();
    const auto result = engine->render(r);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    for (const std::string& node : all(*result)) EXPECT_EQ(node.find("style_"), std::string::npos) << as << ": " << node;
    bool told = false;
    for (const std::string& w : result->reply.warnings()) told |= w.find("shadows.style") != std::string::npos;
    EXPECT_TRUE(told) << as;
  }
}

TEST(Styles, MapsOfATechniqueAreOfTheTechnique) {
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
  for (const char* a : {"lights.lamp.kind=SPOT", "lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3",
                        "shadows.exponential.classification=THRESHOLD", "shadows.style.softness=0.1", "outputs=shadow_flags:lamp,visibility:lamp"})
    set(r, a);
  const auto result = makeEngine()->render(r);
  ASSERT_TRUE(result.ok()) << result.status().toString();
}

TEST(Styles, StandForShadowRaysWhereNoTechniqueIsNamed) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
  set(r, "shadows.style.softness=0.2");
  const auto resolved = engine->resolve(r);
  ASSERT_TRUE(resolved.ok()) << resolved.status().toString();
  EXPECT_TRUE(resolved->shadows().has_ray_traced());
  EXPECT_EQ(resolved->shadows().style().power(), 8u);
  EXPECT_EQ(engine->resolve(*resolved)->SerializeAsString(), resolved->SerializeAsString());
}

TEST(Styles, OfALightHaveTheTechniqueOfAll) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
  set(r, "lights.lamp.kind=SPOT");
  set(r, "shadows.moment.moment_bias=0.0001");
  set(r, "shadows.style.brightness=0.5");
  set(r, "lights.lamp.shadow.style.softness=0.2");
  const auto moment = engine->resolve(r);
  ASSERT_TRUE(moment.ok()) << moment.status().toString();
  const v1::ShadowTechnique& lamp = moment->lights().at("lamp").shadow();
  EXPECT_EQ(lamp.moment().moment_bias(), 0.0001);
  EXPECT_EQ(lamp.style().brightness(), 0) << "a light's style is its own";
  r.clear_shadows();
  EXPECT_TRUE(engine->resolve(r)->lights().at("lamp").shadow().has_ray_traced());
}

TEST(Styles, BadValuesAreRefusedByName) {
  const auto engine = makeEngine();
  for (const auto& [edits, field] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"shadows.style.softness=-1"}, "request.shadows.style.softness"},
           {{"shadows.style.brightness=1.5"}, "request.shadows.style.brightness"},
           {{"shadows.style.power=1"}, "request.shadows.style.power"},
           {{"shadows.style.abstraction=-0.1"}, "request.shadows.style.abstraction"},
           {{"shadows.style.angle_deg=200"}, "request.shadows.style.angle_deg"},
           {{"shadows.style.samples=65537"}, "request.shadows.style.samples"},
           {{"shadows.style.levels=65"}, "request.shadows.style.levels"},
           {{"shadows.style.levels=0"}, "request.shadows.style.levels"},
           {{"shadows.style.guard_px=1025"}, "request.shadows.style.guard_px"},
           {{"shadows.path_traced={}", "shadows.style.softness=1"}, "request.shadows.style"},
       }) {
    v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
    for (const std::string& e : edits)
      if (e.ends_with("={}")) r.mutable_shadows()->mutable_path_traced();
      else set(r, e);
    const auto resolved = engine->resolve(r);
    ASSERT_FALSE(resolved.ok()) << field;
    EXPECT_EQ(resolved.status().code(), Code::InvalidArgument);
    EXPECT_EQ(resolved.status().location(), field);
  }
}

TEST(Styles, ALightThatFallsBackToPathTracingHasNone) {  // the environment is in "direct"
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
  for (const char* a : {"environment.constant=0.2,0.2,0.3", "shadows.style.softness=0.2"}) set(r, a);
  const Labels labels = all(mustRender(*engine, r));
  Labels styles;
  for (const std::string& l : labels)
    if (l.starts_with("style_")) styles.insert(l);
  EXPECT_EQ(styles, (Labels{"style_distance:light", "style_transfer:light"}));
  EXPECT_TRUE(labels.count("direct"));
}

}  // namespace styles_test
}  // namespace gobo::testing
