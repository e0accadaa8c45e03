// SPDX-License-Identifier: Apache-2.0
// Styles whose lengths go along surfaces, and styles with contours of hidden surfaces, in requests.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "request/style_sheet.h"
#include "support/planned_nodes.h"

namespace gobo::testing {
namespace styles_metric_test {

using Labels = std::set<std::string>;

v1::RenderRequest styled(const std::vector<std::string>& edits) {
  v1::RenderRequest r = withLamp(44, 34, LightKind::Spot);
  for (const char* a : {"lights.light.enabled=false", "lights.lamp.outer_deg=80", "lights.lamp.inner_deg=79", "outputs=visibility:lamp"}) set(r, a);
  set(r, "lights.lamp.shadow.style.softness=0.3");
  for (const std::string& e : edits) set(r, "lights.lamp.shadow.style." + e);
  return r;
}
Labels ran(Engine& engine, const v1::RenderRequest& r) {
  Labels out;
  for (const auto& [label, n] : nodesBy(mustRender(engine, r), v1::NodeReport::RUN)) out.insert(label);
  return out;
}

TEST(StylesMetric, EachEditReRunsItsStageAndWhatLiesBehindIt) {
  const auto engine = makeEngine();
  const Labels transfer{"style_transfer:lamp", "visibility:lamp"}, blurred{"style_abstraction:lamp", "style_transfer:lamp", "visibility:lamp"};
  Labels distance = blurred;
  distance.insert("style_distance:lamp");
  ran(*engine, styled({"abstraction=0.05"}));
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "metric=WORLD"})), Labels{}) << "as it is without";
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "metric=SURFACE"})), distance);
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "metric=SURFACE", "power=4", "norm=PUBLISHED", "samples=9"})), Labels{}) << "there is no average";
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "metric=SURFACE", "angle_deg=40"})), distance);
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.1", "metric=SURFACE"})), blurred);
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.1", "metric=SURFACE", "inflation=0.1"})), transfer);
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "hidden_layers=0"})), Labels{});
  Labels one = distance, two = distance;
  one.insert({"hidden_surface 1", "hidden_visibility 1:lamp"});
  two.insert({"hidden_surface 2", "hidden_visibility 2:lamp"});
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "hidden_layers=1"})), one);
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.05", "hidden_layers=2"})), two) << "the first layer is there";
  EXPECT_EQ(ran(*engine, styled({"abstraction=0.1", "hidden_layers=2"})), blurred);
}

TEST(StylesMetric, FieldsWithoutEffectAreNamed) {
  const auto engine = makeEngine();
  for (const auto& [edits, words] : std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>>{
           {{"metric=SURFACE"}, {}},
           {{"metric=SURFACE", "power=4"}, {"shadows.style.power"}},
           {{"metric=SURFACE", "samples=9", "norm=PUBLISHED"}, {"shadows.style.norm", "shadows.style.samples"}},
           {{"metric=WORLD", "power=4"}, {}},
       }) {
    std::vector<std::string> told;
    const RenderResult result = mustRender(*engine, styled(edits));
    for (const std::string& w : result.reply.warnings())
      if (w.find("metric SURFACE") != std::string::npos) told.push_back(w.substr(0, w.find(':')));
    EXPECT_EQ(told, words);
  }
}

TEST(StylesMetric, HiddenLayersAlongSurfacesAreRefusedByName) {
  const auto engine = makeEngine();
  v1::RenderRequest r = styled({"metric=SURFACE", "hidden_layers=2"});
  auto resolved = engine->resolve(r);
  ASSERT_FALSE(resolved.ok());
  EXPECT_EQ(resolved.status().code(), Code::InvalidArgument);
  EXPECT_EQ(resolved.status().location(), "request.lights.lamp.shadow.style.hidden_layers") << resolved.status().toString();
  EXPECT_NE(resolved.status().message().find("= 2"), std::string::npos);
  r = smallRequest("cornell", 20, 16, 1);
  set(r, "shadows.style.hidden_layers=1");
  EXPECT_TRUE(engine->resolve(r).ok());
  set(r, "shadows.style.metric=SURFACE");
  EXPECT_EQ(engine->resolve(r).status().location(), "request.shadows.style.hidden_layers");
  set(r, "shadows.style.metric=WORLD");
  set(r, "shadows.style.hidden_layers=9");
  EXPECT_EQ(engine->resolve(r).status().location(), "request.shadows.style.hidden_layers");
}

TEST(StylesMetric, ANeutralStyleIsTheHardShadowToTheBit) {
  const auto engine = makeEngine();
  v1::RenderRequest plain = styled({});
  plain.mutable_lights()->at("lamp").mutable_shadow()->clear_style();
  set(plain, "lights.lamp.shadow.ray_traced.samples=1");
  const RenderResult hard = mustRender(*engine, plain);
  for (const char* edit : {"metric=SURFACE", "hidden_layers=2"})
    EXPECT_EQ(firstDifference(mustRender(*engine, styled({"softness=0", edit})), hard), "") << edit;
}

TEST(StylesMetric, WindowsAndGuardsHaveTheBitsOfTheWhole) {
  const auto engine = makeEngine();
  for (const std::vector<std::string>& edits : std::vector<std::vector<std::string>>{
           {"metric=SURFACE"}, {"hidden_layers=2"}, {"metric=SURFACE", "guard_px=5"}, {"hidden_layers=1", "guard_px=5", "samples=9"}}) {
    v1::RenderRequest r = styled(edits);
    r.set_view_samples(2);
    const Image whole = mustRender(*engine, r).images[0].image();
    for (const char* e : {"window.x=13", "window.y=8", "window.width=20", "window.height=11"}) set(r, e);
    const Image part = mustRender(*makeEngine(), r).images[0].image();
    double most = 0;
    for (int y = 0; y < 11; ++y)
      for (int x = 0; x < 20; ++x) most = std::max(most, double(std::abs(part.at(x, y)[0] - whole.at(13 + x, 8 + y)[0])));
    EXPECT_EQ(most, 0) << edits[0];
  }
}

TEST(StylesMetric, WorkWithFormulasLevelsAndClearPanes) {
  for (const std::vector<const char*>& edits : std::vector<std::vector<const char*>>{
           {"lights.lamp.shadow.style.metric=SURFACE", "expressions.lights.lamp.shadow.style.softness.formula=0.1 + 0.3*distance"},
           {"lights.lamp.shadow.style.hidden_layers=1", "expressions.lights.lamp.shadow.style.softness.formula=0.1 + 0.3*distance"},
           {"lights.lamp.shadow.style.metric=SURFACE", "lights.lamp.shadow.style.levels=3"},
           {"lights.lamp.shadow.style.hidden_layers=1", "lights.lamp.shadow.style.levels=3"}}) {
    const auto engine = makeEngine();
    v1::RenderRequest r = styled({});
    for (const char* e : edits) set(r, e);
    const Image image = mustRender(*engine, r).images[0].image();
    double least = 1, most = 0;
    for (int y = 0; y < 34; ++y)
      for (int x = 0; x < 44; ++x) least = std::min(least, double(image.at(x, y)[0])), most = std::max(most, double(image.at(x, y)[0]));
    EXPECT_LT(least, 0.5) << edits[1];
    EXPECT_EQ(most, 1) << edits[1];
  }
}

TEST(StylesMetric, LevelsOfHardVisibilityAreOneToTheBit) {  // hidden ones, too
  const auto engine = makeEngine();
  for (const char* edit : {"metric=SURFACE", "hidden_layers=1"})
    EXPECT_EQ(firstDifference(mustRender(*engine, styled({edit, "levels=3"})), mustRender(*engine, styled({edit}))), "") << edit;
}

TEST(StylesMetric, StyleSheetsHoldThem) {
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 1);
  ASSERT_TRUE(applyStyleSheet(r, R"({"shadows": {"style": {"metric": "SURFACE", "softness": 0.1}}})", "sheet").ok());
  EXPECT_EQ(r.shadows().style().metric(), v1::ShadowStyle::SURFACE);
  ASSERT_TRUE(applyStyleSheet(r, R"({"lights": {"light": {"shadow": {"style": {"hidden_layers": 3}}}}})", "sheet").ok());
  EXPECT_EQ(r.lights().at("light").shadow().style().hidden_layers(), 3u);
}

}  // namespace styles_metric_test
}  // namespace gobo::testing
