// SPDX-License-Identifier: Apache-2.0
// environment.subtractive.unshadowed, and styles of the few lights' shadows, in whole requests: what an edit runs again, what is refused, and pictures.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "support/engines.h"

namespace gobo::testing {
namespace subtractive_unshadowed_test {

v1::RenderRequest mapAlone(Engine& engine, const char* scene, int width = 24, int height = 16, std::initializer_list<const char*> edits = {}) {
  v1::RenderRequest r = smallRequest(scene, width, height, 1);
  for (const char* a : {"environment.sky.turbidity=3", "environment.subtractive.lights=8", "environment.subtractive.bright_lights=0", "outputs=direct",
                        "integrator.max_bounces=0"})
    set(r, a);
  for (const Light& light : (*engine.scene(scene))->lights)
    if (light.shape.kind != LightKind::Environment) set(r, "lights." + light.name + ".enabled=false");
  for (const char* e : edits) set(r, e);
  return r;
}
std::string ran(Engine& engine, v1::RenderRequest& r, const std::string& edit, const char* also = nullptr) {
  if (!edit.empty()) set(r, edit);
  std::string out;
  for (const auto& [label, row] : nodesBy(mustRender(engine, r), v1::NodeReport::RUN))
    if (label.rfind("subtractive:", 0) == 0 || label.rfind("environment:", 0) == 0 || (also && label.rfind(also, 0) == 0)) out += label + " ";
  return out;
}
/// Whether an edit would make the tables of the cache, which takes seconds.
bool wouldMakeCache(Engine& engine, v1::RenderRequest r, const std::string& edit) {
  set(r, edit);
  const auto planned = engine.plan(r);
  EXPECT_TRUE(planned.ok()) << planned.status().toString();
  bool made = false;
  if (planned.ok())
    for (const v1::NodeReport& n : planned->plan()) made = made || (n.node() == "environment:cache" && n.state() == v1::NodeReport::RUN);
  return made;
}
/// Whether the plan has a node whose label begins so.
bool holds(const RenderResult& r, const std::string& label) {
  for (const auto& n : r.reply.plan())
    if (n.state() != v1::NodeReport::PRUNED && n.node().rfind(label, 0) == 0) return true;
  return false;
}
double meanOf(const Image& image) {
  double sum = 0;
  for (const float v : image.data) sum += double(v) / double(image.data.size());
  return sum;
}

TEST(SubtractiveUnshadowed, AnEditRunsWhatItChanges) {
  const auto engine = makeEngine();
  v1::RenderRequest r = mapAlone(*engine, "lights8");
  EXPECT_NE(ran(*engine, r, ""), "");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.unshadowed=PREFILTERED"), "") << "what stands for nothing said";
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.unshadowed=HARMONICS"), "subtractive:light subtractive:unshadowed ");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.unshadowed=RADIANCE_CACHE"), "environment:cache subtractive:light subtractive:unshadowed ");
  EXPECT_EQ(ran(*engine, r, "environment.gain=2,2,2"), "");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.form=DIFFERENCE"), "subtractive:light ");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.lights=9"), "subtractive:light subtractive:lights subtractive:samples ");
  // The tables are of the camera's axis and of the map; not of how wide the view is, nor of the picture's size.
  EXPECT_EQ(ran(*engine, r, "camera.yfov_deg=33"), "subtractive:light subtractive:samples subtractive:unshadowed ");
  EXPECT_EQ(ran(*engine, r, "height=15"), "subtractive:light subtractive:samples subtractive:unshadowed ");
  EXPECT_EQ(ran(*engine, r, "environment.rotation_deg=40"), "environment:cache subtractive:light subtractive:samples subtractive:unshadowed ");
  EXPECT_TRUE(wouldMakeCache(*engine, r, "camera.look_at=0,1,0"));
  EXPECT_FALSE(wouldMakeCache(*engine, r, "camera.yfov_deg=37"));
}

TEST(SubtractiveUnshadowed, APanoramaHasNoAxis) {
  const auto engine = makeEngine();
  v1::RenderRequest r = mapAlone(*engine, "fence", 24, 12, {"camera.panorama=true"});
  for (const char* source : {"PREFILTERED", "HARMONICS"}) {
    set(r, std::string("environment.subtractive.unshadowed=") + source);
    mustRender(*engine, r);
  }
  set(r, "environment.subtractive.unshadowed=RADIANCE_CACHE");
  const auto made = engine->render(r);
  ASSERT_FALSE(made.ok());
  EXPECT_EQ(made.status().code(), Code::InvalidArgument);
  EXPECT_EQ(made.status().location(), "request.environment.subtractive.unshadowed");
  EXPECT_NE(made.status().message().find("RADIANCE_CACHE"), std::string::npos) << made.status().toString();
}

// A uniform map: the path tracer's mean within 3 %, whatever the unshadowed light comes from.
TEST(SubtractiveUnshadowed, PicturesAreThoseOfThePathTracer) {
  const auto engine = makeEngine();
  for (const char* scene : {"tentacles", "fence"}) {
    v1::RenderRequest r = mapAlone(*engine, scene, 48, 32, {"integrator.at_view_samples=true", "halt.spp=256"});
    r.mutable_environment()->clear_sky();
    set(r, "environment.constant=1,0.8,0.6");
    v1::RenderRequest traced = r;
    traced.mutable_environment()->clear_subtractive();
    set(r, "environment.subtractive.lights=100");
    set(r, "environment.subtractive.resolution=1");
    const double truth = meanOf(mustRender(*engine, traced).images[0].image());
    ASSERT_GT(truth, 0.05);
    for (const char* source : {"HARMONICS", "RADIANCE_CACHE"}) {
      set(r, std::string("environment.subtractive.unshadowed=") + source);
      EXPECT_NEAR(meanOf(mustRender(*engine, r).images[0].image()) / truth, 1.0, 0.03) << scene << " " << source;
    }
  }
}

TEST(SubtractiveUnshadowed, AWindowHasTheBitsOfTheWhole) {
  const auto engine = makeEngine();
  for (const char* edit :
       {"environment.subtractive.unshadowed=RADIANCE_CACHE", "environment.subtractive.unshadowed=HARMONICS", "lights.environment.shadow.style.softness=0.2"}) {
    v1::RenderRequest whole = mapAlone(*engine, "lights8", 40, 30, {"environment.subtractive.resolution=3"});
    set(whole, edit);
    v1::RenderRequest part = whole;
    for (const char* a : {"window.x=12", "window.y=9", "window.width=14", "window.height=8"}) set(part, a);
    const Image all = mustRender(*engine, whole).images[0].image(), some = mustRender(*engine, part).images[0].image();
    ASSERT_EQ(some.width, 14);
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 14; ++x)
        for (int c = 0; c < 3; ++c)
          ASSERT_EQ(some.data[size_t(some.channels * (14 * y + x) + c)], all.data[size_t(all.channels * (40 * (y + 9) + x + 12) + c)])
              << edit << " " << x << "," << y;
  }
}

// A style that changes nothing: the picture of the rays, to the bit, whatever the form and the resolution.
TEST(SubtractiveStyle, NeutralIsTheUnstyledPictureToTheBit) {
  const auto engine = makeEngine();
  for (const char* scene : {"fence", "lights8"})
    for (const char* form : {"RATIO", "BETA", "DIFFERENCE"})
      for (const char* resolution : {"1", "4"}) {
        v1::RenderRequest plain = mapAlone(*engine, scene, 40, 30);
        set(plain, std::string("environment.subtractive.form=") + form);
        set(plain, std::string("environment.subtractive.resolution=") + resolution);
        v1::RenderRequest styled = plain;
        set(styled, "lights.environment.shadow.style.softness=0");
        const RenderResult a = mustRender(*engine, plain), b = mustRender(*engine, styled);
        EXPECT_EQ(b.reply.warnings_size(), 0) << b.reply.warnings(0);
        EXPECT_TRUE(holds(b, "style_transfer:environment/few0"));
        EXPECT_EQ(firstDifference(a, b), "") << scene << " " << form << " " << resolution;
      }
}

// Brightness 1: no shadow, so C, which does not know of the lights.
TEST(SubtractiveStyle, OfBrightnessOneIsTheUnshadowedLight) {
  const auto engine = makeEngine();
  for (const char* form : {"RATIO", "BETA", "DIFFERENCE"}) {
    v1::RenderRequest r = mapAlone(*engine, "lights8", 40, 30, {"lights.environment.shadow.style.brightness=1"});
    set(r, std::string("environment.subtractive.form=") + form);
    const RenderResult few = mustRender(*engine, r);
    for (const char* edit : {"environment.subtractive.lights=19", "environment.subtractive.resolution=1", "lights.environment.shadow.style.softness=0.3"}) {
      set(r, edit);
      EXPECT_EQ(firstDifference(few, mustRender(*engine, r)), "") << form << " " << edit;
    }
    r.mutable_lights()->at("environment").clear_shadow();
    EXPECT_LT(meanOf(mustRender(*engine, r).images[0].image()), 0.95 * meanOf(few.images[0].image())) << form;
  }
}

TEST(SubtractiveStyle, ActsOnTheFewLightsShadows) {
  const auto engine = makeEngine();
  v1::RenderRequest r = mapAlone(*engine, "fence", 60, 40, {"environment.subtractive.resolution=1"}), all = r;
  const Image hard = mustRender(*engine, r).images[0].image();
  set(all, "lights.environment.shadow.style.brightness=1");
  const Image none = mustRender(*engine, all).images[0].image();
  for (const char* edit : {"shadow.style.inflation=0.1", "shadow.style.softness=0.15", "shadow.style.brightness=0.5", "shadow.style.abstraction=0.1"}) {
    v1::RenderRequest styled = r;
    set(styled, std::string("lights.environment.") + edit);
    const Image picture = mustRender(*engine, styled).images[0].image();
    double changed = 0;
    for (size_t i = 0; i < picture.data.size(); ++i) {
      changed += std::abs(double(picture.data[i]) - double(hard.data[i]));
      ASSERT_LE(picture.data[i], none.data[i] * 1.00001f + 1e-7f) << edit << ": never more than C";
      ASSERT_GE(picture.data[i], 0.0f);
    }
    EXPECT_GT(changed / double(picture.data.size()), 0.001 * meanOf(hard)) << edit;
  }
  // Half of what is missing is there again.
  v1::RenderRequest half = r;
  set(half, "lights.environment.shadow.style.brightness=0.5");
  const Image middle = mustRender(*engine, half).images[0].image();
  for (size_t i = 0; i < middle.data.size(); ++i) EXPECT_NEAR(middle.data[i], 0.5f * (hard.data[i] + none.data[i]), 1e-5f + 1e-4f * none.data[i]) << i;
}

TEST(SubtractiveStyle, AnEditRunsWhatItChanges) {
  const auto engine = makeEngine();
  v1::RenderRequest r = mapAlone(*engine, "fence", 24, 16, {"environment.subtractive.lights=2", "environment.subtractive.resolution=2"});
  EXPECT_EQ(ran(*engine, r, "lights.environment.shadow.style.softness=0.1", "style_"),
            "environment:split style_distance:environment/few0 style_distance:environment/few1 style_transfer:environment/few0 style_transfer:environment/few1 "
            "subtractive:light subtractive:lights subtractive:samples subtractive:unshadowed ");
  EXPECT_EQ(ran(*engine, r, "lights.environment.shadow.style.softness=0.2", "style_"),
            "style_transfer:environment/few0 style_transfer:environment/few1 subtractive:light subtractive:samples ");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.resolution=4", "style_"), "subtractive:light subtractive:samples ");
  EXPECT_EQ(ran(*engine, r, "environment.subtractive.form=BETA", "style_"), "subtractive:light ");
  EXPECT_EQ(ran(*engine, r, "expressions.lights.environment.shadow.style.brightness.formula=0.1*depth", "style_transfer"),
            "style_transfer:environment/few0 style_transfer:environment/few1 subtractive:light subtractive:samples ");
}

// More than may be kept: lights one after the other, and the same picture.
TEST(SubtractiveStyle, ManyLightsAreFoldedInBoundedMemory) {
  const auto engine = makeEngine();
  v1::RenderRequest plain = mapAlone(*engine, "fence", 160, 120, {"environment.subtractive.lights=180", "view_samples=2"}), styled = plain;
  set(styled, "lights.environment.shadow.style.softness=0");
  const RenderResult a = mustRender(*engine, plain), b = mustRender(*engine, styled);
  EXPECT_EQ(firstDifference(a, b), "");
  EXPECT_LT(b.reply.peak_bytes(), 40u << 20) << "180 visibilities of 160 x 120 x 2 samples, and what styles hold of them, are 276 MB";
}

// All techniques of visibility may be styled, and the style of all lights is that of the map too; what scene lights share has none, and says so.
TEST(SubtractiveStyle, OfAllLightsIsTheMapsToo) {
  const auto engine = makeEngine();
  v1::RenderRequest r = mapAlone(*engine, "fence", 24, 16, {"shadows.style.softness=0.2", "environment.subtractive.bright_lights=4"});
  EXPECT_EQ(mustRender(*engine, r).reply.warnings_size(), 0);
  v1::RenderRequest soft = r;
  set(soft, "shadows.percentage_closer.taps=3");
  EXPECT_TRUE(holds(mustRender(*engine, soft), "style_transfer:environment/few"));
  v1::RenderRequest shared = mapAlone(*engine, "lights8", 24, 16, {"shadows.subtractive.lights=3", "shadows.style.softness=0.2"});
  shared.clear_lights();
  const RenderResult both = mustRender(*engine, shared);
  int map = 0, lights = 0;
  for (const std::string& w : both.reply.warnings()) {
    map += w.find("'environment'") != std::string::npos;
    lights += w.find("shares its subtractive shadow") != std::string::npos;
  }
  EXPECT_EQ(map, 0);
  EXPECT_GT(lights, 0);
  EXPECT_TRUE(holds(both, "style_transfer:environment/few0"));
}

}  // namespace subtractive_unshadowed_test
}  // namespace gobo::testing
