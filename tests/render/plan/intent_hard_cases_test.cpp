// SPDX-License-Identifier: Apache-2.0
// Shadows by intent where it is hard: a style over every technique that makes a visibility, and what breaks filters of shadows (pictures of one pixel, no
// light, all shadow, lengths beyond the scene), one request each: finite light, shadows within their range, or a refusal that names the field.
#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

#include "filters/shadow_technique.h"
#include "support/engines.h"

namespace gobo::testing {
namespace intent_hard_cases_test {

v1::RenderRequest room(std::initializer_list<std::string> more = {}) {
  v1::RenderRequest r = smallRequest("cornell", 20, 17, 1);
  for (const char* a : {"lights.lamp.kind=SPOT", "lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3",
                        "view_samples=1", "integrator.max_bounces=0"})
    set(r, a);
  for (const std::string& a : more) set(r, a);
  return r;
}

std::vector<float> picture(const RenderResult& r, size_t k = 0) {
  const auto pixels = r.images.at(k).pixels();
  return {pixels.begin(), pixels.end()};
}

/// A style stands behind any technique: a neutral one makes its visibility hard at one half, to the bit; another stays in [b, 1].
TEST(StyledTechniques, ANeutralStyleIsTheVisibilityMadeHard) {
  const auto engine = makeEngine();
  int tried = 0;
  for (const ShadowTechniqueEntry& t : shadowTechniques())
    for (const auto& [kind, more] : std::vector<std::pair<LightKind, std::vector<std::string>>>{
             {LightKind::Spot, {"lights.lamp.kind=SPOT"}},
             {LightKind::Point, {"lights.lamp.kind=POINT"}},
             {LightKind::Directional, {"lights.lamp.kind=DIRECTIONAL"}},
             {LightKind::Rect, {"lights.lamp.kind=RECT", "lights.lamp.width=0.4", "lights.lamp.height=0.3"}}}) {
      if (!t.supports(kind)) continue;
      v1::RenderRequest plain = room({std::string("shadows.") + t.name + "="});
      if (t.usesMap) set(plain, "shadows.map.resolution=64");
      for (const std::string& a : more) set(plain, a);
      v1::RenderRequest neutral = plain;
      for (v1::RenderRequest* r : {&plain, &neutral}) set(*r, "outputs=visibility:lamp,alpha");
      set(neutral, "shadows.style.softness=0");
      const std::string what = std::string(t.name) + " " + more[0];
      const auto without = engine->render(plain), with = engine->render(neutral);
      ASSERT_TRUE(without.ok()) << what << ": " << without.status().toString();
      ASSERT_TRUE(with.ok()) << what << ": " << with.status().toString();
      const std::vector<float> V = picture(*without, 0), hit = picture(*without, 1), S = picture(*with, 0);
      for (size_t i = 0; i < V.size(); ++i) {
        if (hit[i] > 0.0f) { ASSERT_EQ(S[i], V[i] >= 0.5f ? 1.0f : 0.0f) << what << " at " << i << ", V " << V[i]; }
      }
      for (const char* a : {"shadows.style.softness=0.3", "shadows.style.brightness=0.25", "shadows.style.abstraction=0.05", "shadows.style.levels=3"})
        set(neutral, a);
      const auto soft = engine->render(neutral);
      ASSERT_TRUE(soft.ok()) << what << ": " << soft.status().toString();
      const std::vector<float> T = picture(*soft, 0);
      for (size_t i = 0; i < T.size(); ++i) {
        if (hit[i] > 0.0f) { ASSERT_TRUE(T[i] >= 0.25f - 1e-6f && T[i] <= 1.0f) << what << " at " << i << ": " << T[i]; }
      }
      ++tried;
    }
  EXPECT_GT(tried, 30);
}

TEST(IntentHardCases, StylesOfWhatIsHardAreFiniteAndInRange) {
  const auto engine = makeEngine();
  const std::vector<std::pair<const char*, std::vector<std::string>>> cases{
      {"no light", {"lights.lamp.enabled=false", "lights.light.enabled=false", "outputs=beauty"}},
      {"one light", {"lights.light.enabled=false"}},
      {"one pixel", {"width=1", "height=1"}},
      {"one row", {"width=23", "height=1"}},
      {"one column", {"width=1", "height=19"}},
      {"odd sizes", {"width=13", "height=7"}},
      {"holes", {"camera.yfov_deg=150", "camera.position=0,1,9"}},
      {"nothing is hit", {"camera.position=0,1,9", "camera.look_at=0,1,99"}},
      {"all shadow: the light is under the floor", {"lights.lamp.position=0,-3,0"}},
      {"the light shines away", {"lights.lamp.direction=0,1,0"}},
      {"no shadow: the eye sees the floor before the light alone", {"camera.position=0.2,0.3,0.9", "camera.look_at=0.2,0,0.9"}},
      {"the light on the surface", {"lights.lamp.position=0.2,0,0.4"}},
      {"the eye in a shadow", {"camera.position=0.35,0.05,0.1", "camera.look_at=0.35,0,-0.2"}},
      {"cut by the border", {"camera.yfov_deg=4"}},
      {"two lights in one place",
       {"lights.twin.kind=SPOT", "lights.twin.position=0.2,1.6,0.4", "lights.twin.direction=0,-1,-0.2", "lights.twin.intensity=3",
        "outputs=beauty,visibility:lamp,visibility:twin"}},
      {"blur beyond the picture", {"shadows.style.abstraction=1e6"}},
      {"blur far below a pixel", {"shadows.style.abstraction=1e-9"}},
      {"inflated beyond the scene", {"shadows.style.inflation=1e9"}},
      {"deflated beyond the scene", {"shadows.style.inflation=-1e9"}},
      {"soft beyond the scene", {"shadows.style.softness=1e9"}},
      {"the softest edge that is none", {"shadows.style.softness=1e-30"}},
      {"nobody sees a contour", {"shadows.style.angle_deg=0"}},
      {"everybody sees every contour", {"shadows.style.angle_deg=180"}},
      {"full shadows are light", {"shadows.style.brightness=1"}},
      {"great power", {"shadows.style.power=64", "shadows.style.norm=PUBLISHED"}},
      {"a layer without weight", {"shadows.style.layers[0].weight=0", "shadows.style.layers[0].softness=1"}},
      {"few points", {"shadows.style.samples=1"}},
      {"a guard larger than the picture", {"shadows.style.guard_px=40"}},
  };
  for (const auto& [name, edits] : cases) {
    v1::RenderRequest r = room({"shadows.ray_traced.samples=1", "shadows.style.softness=0.1", "shadows.style.inflation=0.02", "shadows.style.abstraction=0.02",
                                "outputs=beauty,visibility:lamp"});
    for (const std::string& a : edits) set(r, a);
    const auto made = engine->render(r);
    ASSERT_TRUE(made.ok()) << name << ": " << made.status().toString();
    for (size_t k = 0; k < made->images.size(); ++k)
      for (const float v : picture(*made, k)) {
        ASSERT_TRUE(std::isfinite(v) && v >= 0.0f) << name << ": " << v;
        if (k > 0) { ASSERT_LE(v, 1.0f) << name; }
      }
    const auto again = engine->render(r);
    ASSERT_TRUE(again.ok()) << name;
    EXPECT_EQ(firstDifference(*made, *again), "") << name;
  }
}

TEST(IntentHardCases, SubtractiveLightOfHardMapsIsFinite) {
  const auto engine = makeEngine();
  const std::vector<std::pair<const char*, std::vector<std::string>>> cases{
      {"a black map", {"environment.constant=0,0,0"}},
      {"a map of one colour", {"environment.constant=0,0,2"}},
      {"a strong map", {"environment.constant=1e12,1e12,1e12"}},
      {"a faint map", {"environment.constant=1e-20,1e-20,1e-20"}},
      {"a sky with its sun", {"environment.sky.turbidity=3"}},
      {"a map that is off", {"environment.constant=1,1,1", "environment.gain=0"}},
      {"one light", {"environment.sky.turbidity=3", "environment.subtractive.lights=1", "environment.subtractive.bright_lights=0"}},
      {"one pixel", {"environment.sky.turbidity=3", "width=1", "height=1", "environment.subtractive.resolution=32"}},
      {"odd sizes", {"environment.sky.turbidity=3", "width=13", "height=7", "environment.subtractive.resolution=4"}},
      {"holes", {"environment.sky.turbidity=3", "camera.yfov_deg=150", "camera.position=0,1,9"}},
      {"nothing is hit", {"environment.sky.turbidity=3", "camera.position=0,1,9", "camera.look_at=0,1,99"}},
  };
  for (const auto& [name, edits] : cases)
    for (const char* form : {"RATIO", "BETA", "DIFFERENCE"})
      for (const char* from : {"PREFILTERED", "HARMONICS", "RADIANCE_CACHE"}) {
        v1::RenderRequest r = smallRequest("spheres", 18, 15, 1);
        for (const char* a : {"integrator.max_bounces=0", "environment.subtractive.lights=6", "outputs=beauty,negative_light"}) set(r, a);
        set(r, std::string("environment.subtractive.form=") + form);
        set(r, std::string("environment.subtractive.unshadowed=") + from);
        for (const std::string& a : edits) set(r, a);
        const auto made = engine->render(r);
        ASSERT_TRUE(made.ok()) << name << " " << form << " " << from << ": " << made.status().toString();
        for (size_t k = 0; k < 2; ++k)
          for (const float v : picture(*made, k)) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f) << name << " " << form << " " << from << ": " << v;
        if (std::string(form) == "RATIO")
          for (const float v : picture(*made, 1)) ASSERT_EQ(v, 0.0f) << name << ": a share of what there is cannot be negative";
      }
}

/// The lights that stand for a map's peaks beside transfer, and those of a scene, have styles.
TEST(IntentHardCases, StylesActUnderTransfer) {
  v1::RenderRequest r = smallRequest("spheres", 18, 15, 1);
  for (const char* a : {"environment.sky.turbidity=3", "environment.transfer.points=200", "environment.transfer.samples=64", "environment.transfer.bounces=0",
                        "integrator.max_bounces=1", "shadows.ray_traced.samples=1"})
    set(r, a);
  const auto engine = makeEngine();
  const auto plain = mustRender(*engine, r);
  set(r, "shadows.style.inflation=0.3");
  const auto larger = mustRender(*engine, r);
  size_t transfers = 0;
  for (const auto& n : larger.reply.plan()) transfers += n.node().starts_with("style_transfer:environment/") && n.state() != v1::NodeReport::PRUNED;
  EXPECT_GT(transfers, 0u);
  double less = 0;
  const std::vector<float> a = picture(plain), b = picture(larger);
  for (size_t i = 0; i < a.size(); ++i) {
    ASSERT_TRUE(std::isfinite(b[i]));
    less += double(a[i]) - double(b[i]);
  }
  EXPECT_GT(less, 0) << "larger shadows leave less light";
}

/// Lengths over the picture and of the scene are no lengths of each other.
TEST(IntentHardCases, MetricsThatDoNotGoTogetherAreRefusedByName) {
  const auto engine = makeEngine(0);
  for (const auto& [metric, edit, field] : std::vector<std::tuple<const char*, const char*, const char*>>{{"SCREEN", "elongation=0.1", "elongation"},
                                                                                                          {"SCREEN", "target=0.5", "target"},
                                                                                                          {"SCREEN", "keep=0.5", "keep"},
                                                                                                          {"SCREEN", "hidden_layers=1", "hidden_layers"},
                                                                                                          {"SURFACE", "hidden_layers=2", "hidden_layers"}}) {
    const auto made = engine->render(room({std::string("shadows.style.metric=") + metric, std::string("shadows.style.") + edit}));
    ASSERT_FALSE(made.ok()) << metric << " " << edit;
    EXPECT_EQ(made.status().location(), std::string("request.shadows.style.") + field);
    EXPECT_NE(made.status().message().find(metric), std::string::npos) << made.status().toString();
  }
  EXPECT_TRUE(
      engine->render(room({"shadows.style.metric=SURFACE", "shadows.style.target=0.5", "shadows.style.elongation=0.1", "shadows.style.softness=0.1"})).ok());
}

TEST(IntentHardCases, BadValuesAreRefusedWithTheirField) {
  const auto engine = makeEngine(0);
  for (const auto& [edit, field] : std::vector<std::pair<std::string, std::string>>{{"shadows.style.softness=-0.1", "shadows.style.softness"},
                                                                                    {"shadows.style.brightness=1.5", "shadows.style.brightness"},
                                                                                    {"shadows.style.brightness=-0.5", "shadows.style.brightness"},
                                                                                    {"shadows.style.abstraction=-1", "shadows.style.abstraction"},
                                                                                    {"shadows.style.layers[0].softness=-1", "shadows.style.layers[0].softness"},
                                                                                    {"shadows.style.target=1.5", "shadows.style.target"},
                                                                                    {"shadows.style.angularity=-0.5", "shadows.style.angularity"},
                                                                                    {"shadows.style.elongation=-1", "shadows.style.elongation"},
                                                                                    {"shadows.style.keep=1.5", "shadows.style.keep"},
                                                                                    {"shadows.style.hidden_layers=9", "shadows.style.hidden_layers"},
                                                                                    {"environment.subtractive.lights=0", "environment.subtractive.lights"}}) {
    v1::RenderRequest r = room();
    set(r, edit);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << edit;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument) << edit;
    EXPECT_NE(made.status().location().find(field), std::string::npos) << made.status().toString();
    EXPECT_NE(made.status().message().find(edit.substr(edit.find('=') + 1)), std::string::npos) << "its value: " << made.status().toString();
  }
}

}  // namespace intent_hard_cases_test
}  // namespace gobo::testing
