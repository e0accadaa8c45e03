// SPDX-License-Identifier: Apache-2.0
// Shapes of shadows, curves and formulas of layers in requests: where their nodes are planned, what they do to a picture, what is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "request/style_sheet.h"
#include "support/engines.h"

namespace gobo::testing {
namespace styles_shape_test {

using Labels = std::set<std::string>;

v1::RenderRequest fence(const std::vector<std::string>& edits) {
  v1::RenderRequest r = smallRequest("fence", 96, 64, 1);
  for (const char* a : {"outputs=visibility:sun", "integrator.max_bounces=0", "view_samples=1", "encoding.format=RAW_FLOAT"}) set(r, a);
  for (const std::string& e : edits) set(r, e);
  return r;
}
/// Nodes of styles for `light`, by what stands before the colon.
Labels styleNodes(const RenderResult& r, const std::string& light) {
  Labels out;
  for (const auto& n : r.reply.plan())
    if (n.state() != v1::NodeReport::PRUNED && n.node().starts_with("style_") && n.node().ends_with(":" + light))
      out.insert(n.node().substr(0, n.node().size() - light.size() - 1));
  return out;
}
std::vector<float> visibility(const RenderResult& r) {
  const auto p = r.images[0].pixels();
  return {p.begin(), p.end()};
}
double mean(const std::vector<float>& v) {
  double sum = 0;
  for (const float x : v) sum += double(x);
  return sum / double(v.size());
}

TEST(StyleShapes, ArePlannedWhereTheyAreAskedFor) {
  const auto engine = makeEngine();
  const Labels plain{"style_distance", "style_transfer"};
  const std::string s = "shadows.style.";
  const auto one = mustRender(*engine, fence({s + "softness=0.1"}));
  EXPECT_EQ(styleNodes(one, "sun"), plain);
  for (const std::vector<std::string>& neutral :
       std::vector<std::vector<std::string>>{{s + "elongation=0"},
                                             {s + "target=0", s + "angularity=1"},
                                             {s + "keep=0.5"},
                                             {s + "keep=0.5", s + "layers[0].softness=0.1", s + "layers[0].weight=0"}}) {
    std::vector<std::string> edits{s + "softness=0.1"};
    edits.insert(edits.end(), neutral.begin(), neutral.end());
    const auto other = mustRender(*engine, fence(edits));
    EXPECT_EQ(styleNodes(other, "sun"), plain) << neutral[0];
    EXPECT_EQ(visibility(one), visibility(other)) << neutral[0];
  }
  const auto all = mustRender(*engine, fence({s + "elongation=0.2", s + "target=0.5", s + "keep=0.5", s + "inflation=-0.05", s + "abstraction=0.02"}));
  EXPECT_EQ(styleNodes(all, "sun"),
            (Labels{"style_distance", "style_elongation", "style_target", "style_abstraction", "style_half_width", "style_keep", "style_transfer"}));
}

TEST(StyleShapes, DoWhatTheySay) {
  const auto engine = makeEngine();
  const std::string s = "shadows.style.";
  const auto of = [&](const std::vector<std::string>& edits) { return visibility(mustRender(*engine, fence(edits))); };
  const auto hard = of({s + "softness=0"}), longer = of({s + "elongation=0.4"}), longest = of({s + "elongation=0.8"});
  for (size_t k = 0; k < hard.size(); ++k) {
    ASSERT_LE(longer[k], hard[k]) << "what is in shadow stays so";
    ASSERT_LE(longest[k], longer[k]);
  }
  EXPECT_LT(mean(longer), mean(hard) - 0.002);
  EXPECT_LT(mean(longest), mean(longer));
  const auto deflated = of({s + "inflation=-0.2"}), keeping = of({s + "inflation=-0.2", s + "keep=0.5"});
  EXPECT_GT(mean(deflated), mean(keeping) + 0.005);
  EXPECT_GT(mean(keeping), mean(hard));
  for (size_t k = 0; k < hard.size(); ++k) ASSERT_LE(keeping[k], deflated[k]);
  const auto target = of({s + "target=1"});
  EXPECT_NE(target, hard);
  const auto curve = of({s + "softness=0.2", s + "transition=CURVE", s + "curve=0,1,0,1"}), smooth = of({s + "softness=0.2"});
  EXPECT_NE(curve, smooth);
}

TEST(StyleShapes, KeepIsOfInflationByFormulasAndOfLayers) {
  const auto engine = makeEngine();
  const std::string s = "shadows.style.";
  const auto constant = mustRender(*engine, fence({s + "inflation=-0.2", s + "keep=0.5"}));
  const auto formula = mustRender(*engine, fence({s + "keep=0.5", "expressions.shadows.style.inflation.formula=-0.2 + 0*depth"}));
  EXPECT_EQ(styleNodes(formula, "sun"), (Labels{"style_distance", "style_half_width", "style_keep", "style_parameters", "style_transfer"}));
  const auto a = visibility(constant), b = visibility(formula);
  for (size_t k = 0; k < a.size(); ++k) ASSERT_NEAR(a[k], b[k], 1e-6) << k;
  // A layer like the style itself changes nothing; one that is inflated has no share of its own.
  const auto layered = mustRender(*engine, fence({s + "inflation=-0.2", s + "keep=0.5", s + "layers[0].inflation=-0.2"}));
  const auto c = visibility(layered);
  for (size_t k = 0; k < a.size(); ++k) ASSERT_NEAR(a[k], c[k], 1e-6) << k;
  const auto out = mustRender(*engine, fence({s + "inflation=-0.2", s + "keep=0.5", s + "layers[0].inflation=0.1"}));
  EXPECT_EQ(styleNodes(out, "sun"), (Labels{"style_distance", "style_half_width", "style_keep", "style_transfer"}));
  // An edit of the deflation looks for no half widths again.
  v1::RenderRequest r = fence({s + "inflation=-0.3", s + "keep=0.5"});
  Labels ran;
  const RenderResult again = mustRender(*engine, r);
  for (const auto& n : again.reply.plan())
    if (n.state() == v1::NodeReport::RUN) ran.insert(n.node());
  EXPECT_TRUE(ran.count("style_keep:sun"));
  EXPECT_FALSE(ran.count("style_half_width:sun"));
}

TEST(StyleShapes, AreOfLightsThatStandForTheEnvironment) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 18, 1);
  for (const char* a :
       {"lights.light.enabled=false", "environment.sky.turbidity=3", "environment.extract_lights=4", "lights.environment.shadow.style.elongation=0.2",
        "lights.environment.shadow.style.target=0.3", "lights.environment.shadow.style.keep=0.5", "lights.environment.shadow.style.inflation=-0.1",
        "lights.environment.shadow.style.layers[0].softness=0.1", "expressions.lights.environment.shadow.style.layers[0].brightness.formula=0.3 + 0*depth"})
    set(r, a);
  const auto result = mustRender(*engine, r);
  size_t drawnOut = 0, layers = 0;
  for (const auto& n : result.reply.plan()) {
    drawnOut += n.node().starts_with("style_elongation:environment/");
    layers += n.node().starts_with("style_parameters of layer 0:environment/");
  }
  EXPECT_GT(drawnOut, 0u);
  EXPECT_GT(layers, 0u) << "what reads nothing of a light is one for all";
}

TEST(StyleShapes, EveryKindOfLightDrawsOut) {
  const auto engine = makeEngine();
  for (const char* kind : {"POINT", "SPOT", "RECT", "DISK", "SPHERE", "DIRECTIONAL"}) {
    v1::RenderRequest r = smallRequest("cornell", 32, 24, 1);
    for (const std::string& a :
         {std::string("lights.lamp.kind=") + kind, std::string("lights.lamp.direction=0.5,-1,-0.2"), std::string("outputs=visibility:lamp"),
          std::string("lights.light.enabled=false"), std::string("shadows.style.elongation=0.3")})
      set(r, a);
    if (std::string(kind) != "DIRECTIONAL") set(r, "lights.lamp.position=0.2,1.6,0.4");
    EXPECT_TRUE(styleNodes(mustRender(*engine, r), "lamp").count("style_elongation")) << kind;
  }
  v1::RenderRequest mesh = smallRequest("cornell", 32, 24, 1);  // its lamp is a lit object or a panel, whatever the scene has
  set(mesh, "shadows.style.elongation=0.3");
  EXPECT_TRUE(styleNodes(mustRender(*engine, mesh), "light").count("style_elongation"));
}

TEST(StyleShapes, BadValuesAreRefusedByName) {
  const auto engine = makeEngine();
  std::string many = "shadows.style.curve=0";
  for (int k = 0; k < 256; ++k) many += ",1";
  const std::string s = "shadows.style.", field = "request.shadows.style.";
  for (const auto& [edits, where] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{s + "transition=CURVE"}, field + "curve"},
           {{s + "transition=CURVE", s + "curve=0.5"}, field + "curve"},
           {{s + "transition=CURVE", many}, field + "curve"},
           {{many}, field + "curve"},
           {{s + "transition=CURVE", s + "curve=0,1.5,1"}, field + "curve[1]"},
           {{s + "transition=CURVE", s + "curve=0,1,-0.1"}, field + "curve[2]"},
           {{s + "curve=nan,1"}, field + "curve[0]"},
           {{s + "elongation=-0.1"}, field + "elongation"},
           {{s + "elongation=inf"}, field + "elongation"},
           {{s + "target=1.5"}, field + "target"},
           {{s + "angularity=-1"}, field + "angularity"},
           {{s + "keep=2"}, field + "keep"},
           {{"lights.sun.shadow.style.transition=CURVE"}, "request.lights.sun.shadow.style.curve"},
       }) {
    const auto resolved = engine->resolve(fence(edits));
    ASSERT_FALSE(resolved.ok()) << where;
    EXPECT_EQ(resolved.status().code(), Code::InvalidArgument);
    EXPECT_EQ(resolved.status().location(), where) << resolved.status().toString();
  }
  EXPECT_TRUE(engine->resolve(fence({s + "curve=0,1"})).ok()) << "as `steps`, it waits for its transition";
}

TEST(StyleLayers, HaveFormulas) {
  const auto engine = makeEngine();
  const std::string l = "shadows.style.layers[0].", x = "expressions." + l;
  const auto of = [&](const std::vector<std::string>& edits) {
    std::vector<std::string> all{"shadows.style.softness=0.05", l + "weight=0.7"};
    all.insert(all.end(), edits.begin(), edits.end());
    return fence(all);
  };
  // A constant of the place is the number; over time alone it is typed in.
  const auto number = mustRender(*engine, of({l + "softness=0.25", l + "inflation=0.125", l + "brightness=0.5"}));
  const auto formula = mustRender(
      *engine, of({x + "softness.formula=0.25 + 0*depth", x + "inflation.formula=0.125 + 0*depth", x + "brightness.formula=0.5 + 0*depth", l + "softness=3"}));
  EXPECT_EQ(visibility(number), visibility(formula));
  EXPECT_EQ(styleNodes(formula, "sun"), (Labels{"style_distance", "style_parameters of layer 0", "style_transfer"}));
  const auto timed = of({x + "softness.formula=0.125*time", l + "inflation=0.125", l + "brightness=0.5", "time_s=2"});
  EXPECT_EQ(mustRender(*engine, timed).reply.request_hash(),
            mustRender(*engine, of({l + "softness=0.25", l + "inflation=0.125", l + "brightness=0.5", "time_s=2"})).reply.request_hash());
  EXPECT_EQ(visibility(mustRender(*engine, timed)), visibility(number));
  // Each layer has its own, the style has its own, and distances, edges, casters are read as by the style.
  const auto two = mustRender(*engine, of({x + "softness.formula=0.6*distance", "shadows.style.layers[1].inflation=0.1",
                                           "expressions.shadows.style.layers[1].brightness.formula=edge > 0 ? 1 : 0.2 + 0.5*caster(\"posts\")",
                                           "expressions.shadows.style.brightness.formula=0.1*depth"}));
  EXPECT_EQ(styleNodes(two, "sun"),
            (Labels{"style_distance", "style_occluder", "style_parameters", "style_parameters of layer 0", "style_parameters of layer 1", "style_transfer"}));
  EXPECT_NE(visibility(two), visibility(number));
  const auto resolved = engine->resolve(of({x + "softness.formula=0.6*distance"}));
  ASSERT_TRUE(resolved.ok());
  EXPECT_EQ(engine->resolve(*resolved)->SerializeAsString(), resolved->SerializeAsString());
  // A light's own.
  const auto own = mustRender(
      *engine, fence({"lights.sun.shadow.style.layers[0].inflation=0.1", "expressions.lights.sun.shadow.style.layers[0].softness.formula=0.3*distance"}));
  EXPECT_TRUE(styleNodes(own, "sun").count("style_parameters of layer 0"));
}

TEST(StyleLayers, FormulasThatCannotBeAreRefusedByName) {
  const auto engine = makeEngine();
  const std::string l = "shadows.style.layers[0].", x = "expressions.shadows.style.layers", e = "request.expressions.shadows.style.layers";
  for (const auto& [edit, where, words] : std::vector<std::array<std::string, 3>>{
           {x + "[0].softness.formula=0.1*distanc", e + "[0].softness.formula", "did you mean 'distance'?"},
           {x + "[0].softness.formula=1 / (depth > 0 ? 0 : 1)", e + "[0].softness.formula", "is no finite number at pixel"},
           {x + "[0].abstraction.formula=0.1*depth", e + "[0].abstraction.formula", "is one number for all of them"},
           {x + "[0].weight.formula=depth", e + "[0].weight.formula", "is one number for all of them"},
           {x + "[1].softness.formula=0.1*depth", e + "[1].softness", "has no element [1]"},
           {x + "[00].softness.formula=0.1*depth", e + "[00].softness.formula", "is one number for all of them"},
           {x + "[0].brightness.formula=1 + time", e + "[0].brightness.formula at time 1.000000", "must be at most 1"},
           {x + "[0].brightness.formula=object(\"flor\")", e + "[0].brightness.formula", "did you mean 'floor'?"},
       }) {
    const auto r = engine->render(fence({l + "inflation=0.1", edit, "time_s=1"}));
    ASSERT_FALSE(r.ok()) << edit;
    EXPECT_EQ(r.status().code(), Code::InvalidArgument) << r.status().toString();
    EXPECT_EQ(r.status().location(), where) << r.status().toString();
    EXPECT_NE(r.status().message().find(words), std::string::npos) << r.status().toString();
  }
}

TEST(StyleSheets, HaveShapesAndFormulasOfLayers) {
  v1::RenderRequest r = fence({});
  const Status s =
      applyStyleSheet(r, R"({"shadows": {"style": {"transition": "CURVE", "curve": [0, 0.5, 1], "elongation": 0.2, "target": 0.5, "angularity": 1, "keep": 0.3,
      "layers": [{"inflation": 0.1}]}}, "expressions": {"shadows.style.layers[0].softness": {"formula": "0.3*distance"}}})",
                      "shapes.json");
  ASSERT_TRUE(s.ok()) << s.toString();
  EXPECT_EQ(r.shadows().style().curve_size(), 3);
  EXPECT_EQ(r.expressions().size(), 1u);
  EXPECT_TRUE(makeEngine()->render(r).ok());
}

}  // namespace styles_shape_test
}  // namespace gobo::testing
