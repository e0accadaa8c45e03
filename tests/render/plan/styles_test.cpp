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

TEST(Styles, LightsOfTheEnvironmentHaveThemWherePathsAreNotTraced) {
  for (const auto& [as, styled] :
       std::vector<std::pair<const char*, size_t>>{{"environment.extract_lights=4", 4}, {"environment.area_lights=4", 4}, {"integrator.max_bounces=2", 0}}) {
    v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
    for (const char* a : {"shadows.style.softness=0.1", "expressions.shadows.style.inflation.formula=0.1*distance", "lights.light.enabled=false",
                          "environment.sky.turbidity=3"})
      set(r, a);
    set(r, as);
    const auto engine = makeEngine();
    const auto result = engine->render(r);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    size_t transfers = 0;
    for (const std::string& node : all(*result)) transfers += node.starts_with("style_transfer:environment/");
    EXPECT_LE(transfers, styled) << as;
    EXPECT_EQ(transfers > 0, styled > 0) << as;
    bool told = false;
    for (const std::string& w : result->reply.warnings()) told |= w.find("shadows.style") != std::string::npos;
    EXPECT_EQ(told, styled == 0) << as;
  }
  // A neutral style is the hard shadow; formulas of the environment's own are its own.
  v1::RenderRequest plain = smallRequest("cornell", 20, 16, 1), neutral, own;
  for (const char* a : {"lights.light.enabled=false", "environment.sky.turbidity=3", "environment.extract_lights=4", "shadows.ray_traced.samples=1"})
    set(plain, a);
  neutral = own = plain;
  set(neutral, "shadows.style.softness=0");
  set(own, "lights.environment.shadow.style.softness=0");
  set(own, "expressions.lights.environment.shadow.style.brightness.formula=1 + 0*depth");
  const auto engine = makeEngine();
  const auto a = mustRender(*engine, plain), b = mustRender(*engine, neutral), c = mustRender(*engine, own);
  const auto pa = a.images[0].pixels(), pb = b.images[0].pixels(), pc = c.images[0].pixels();
  double brighter = 0;
  for (size_t k = 0; k < pa.size(); ++k) {
    ASSERT_EQ(pa[k], pb[k]);
    brighter += double(pc[k]) - double(pa[k]);
  }
  EXPECT_GT(brighter, 0) << "brightness 1: no shadow at all";
}

// The lights that stand for a map are directional ones: a technique that does none of these gives way, with a warning, and never names a light of ours.
TEST(Styles, AMapsSubtractiveShadowsHaveThemUnderAnyTechnique) {
  const auto engine = makeEngine();
  const google::protobuf::OneofDescriptor* techniques = v1::ShadowTechnique::descriptor()->FindOneofByName("technique");
  ASSERT_NE(techniques, nullptr);
  for (int k = 0; k < techniques->field_count(); ++k) {
    const std::string name = techniques->field(k)->name();
    if (name == "path_traced") continue;  // has no visibility that it could be a style of
    v1::RenderRequest r = smallRequest("tentacles", 24, 18, 4);
    for (const std::string& edit : {std::string("environment.sky.turbidity=4"), std::string("environment.subtractive.lights=8"), "shadows." + name + "=",
                                    std::string("shadows.style.softness=0.2")})
      set(r, edit);
    const auto result = engine->render(r);
    EXPECT_TRUE(result.ok()) << name << ": " << result.status().toString();
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

/// A lamp over the edge of a wall: visibility of the floor, row by row away from the wall.
v1::RenderRequest contact(const std::string& softness) {
  v1::RenderRequest r = smallRequest("fence", 96, 64, 1);
  for (const char* a : {"outputs=visibility:sun", "integrator.max_bounces=0", "view_samples=1", "encoding.format=RAW_FLOAT"}) set(r, a);
  set(r, "expressions.shadows.style.softness.formula=" + softness);
  return r;
}

TEST(Styles, AFormulaThatIsANumberIsTheNumber) {
  const auto engine = makeEngine();
  v1::RenderRequest number = contact("0.25"), formula = contact("0.25 + 0*depth"), typed = contact("0.25");
  typed.clear_expressions();
  set(typed, "shadows.style.softness=0.25");
  const auto a = mustRender(*engine, number), b = mustRender(*engine, formula), c = mustRender(*engine, typed);
  EXPECT_EQ(a.reply.request_hash(), c.reply.request_hash()) << "over nothing but time it is typed in";
  const auto pa = a.images[0].pixels(), pb = b.images[0].pixels();
  ASSERT_EQ(pa.size(), pb.size());
  for (size_t k = 0; k < pa.size(); ++k) ASSERT_EQ(pa[k], pb[k]);
  const auto resolved = engine->resolve(formula);
  ASSERT_TRUE(resolved.ok());
  EXPECT_EQ(engine->resolve(*resolved)->SerializeAsString(), resolved->SerializeAsString());
}

TEST(Styles, FormulasThatFailAreTheRequestsFault) {
  const auto engine = makeEngine();
  for (const auto& [formula, words] : std::vector<std::pair<std::string, std::string>>{{"1 / (depth > 0 ? 0 : 1)", "is no finite number at pixel"},
                                                                                       {"object(\"flor\")", "did you mean 'floor'?"},
                                                                                       {"edge +", ""},
                                                                                       {"softness", "names: time, distance"}}) {
    const auto r = engine->render(contact(formula));
    ASSERT_FALSE(r.ok()) << formula;
    EXPECT_EQ(r.status().code(), Code::InvalidArgument) << r.status().toString();
    EXPECT_EQ(r.status().location(), "request.expressions.shadows.style.softness.formula") << r.status().toString();
    EXPECT_NE(r.status().message().find(words), std::string::npos) << r.status().toString();
  }
  v1::RenderRequest both = contact("0.1");
  v1::Curve& curve = (*both.mutable_curves())["shadows.style.softness"];
  curve.add_time_s(0);
  curve.add_value(1);
  EXPECT_EQ(engine->resolve(both).status().location(), "request.expressions.shadows.style.softness");
}

TEST(Styles, SoftnessByDistanceIsHardAtContactAndSoftAway) {
  const auto engine = makeEngine();
  // Where a board stands on the floor its shadow's edge is hard; where its tip throws it, soft.
  const auto grey = [&](const std::string& softness) {
    const auto picture = mustRender(*engine, contact(softness)).images[0];
    size_t between = 0;
    for (const float v : picture.pixels()) between += v > 0.02f && v < 0.98f;
    return between;
  };
  const size_t none = grey("0"), near = grey("distance < 0.3 ? 0.2 : 0"), far = grey("distance < 0.3 ? 0 : 0.2"), both = grey("0.2 + 0*distance");
  EXPECT_EQ(none, 0u);
  EXPECT_GT(near, 0u);
  EXPECT_GT(far, near);
  EXPECT_GE(both, std::max(near, far));
  EXPECT_LE(std::abs(double(near + far) - double(both)), 0.1 * double(both)) << "each edge is one or the other";
  const size_t boards = grey("caster(\"posts\") > 0.5 ? 0 : 0.2"), post = grey("caster(\"posts\") > 0.5 ? 0.2 : 0");
  EXPECT_GT(boards, 0u);
  EXPECT_GT(post, 0u) << "what one object casts has a style of its own";
  EXPECT_LT(post, boards);
}

}  // namespace styles_test
}  // namespace gobo::testing
