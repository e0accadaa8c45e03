// SPDX-License-Identifier: Apache-2.0
// environment.area_lights_if_worth: what a look decides, that the picture is one of the two, bit for bit, and what the look costs when it was there.
#include <gtest/gtest.h>

#include "support/engines.h"
#include "techniques/environment_lights/worth.h"

namespace gobo::testing {
namespace {

const char* const kPathsLeftOut = "path tracing of the environment map";  // what is left out
const char* const kLightsLeftOut = "area lights of the environment map";

/// Direct light of the map alone.
v1::RenderRequest worthRequest(const std::string& scene, const std::string& sky, const std::vector<std::string>& more = {}) {
  v1::RenderRequest r = smallRequest(scene, 48, 32, 4);
  for (const std::string& e : {std::string("outputs=direct"), std::string("integrator.max_bounces=0"), std::string("shadows.ray_traced.samples=4"), sky,
                               std::string("environment.area_lights=8")})
    set(r, e);
  for (const std::string& e : more) set(r, e);
  return r;
}
v1::RenderRequest weighed(v1::RenderRequest r) {
  set(r, "environment.area_lights_if_worth=true");
  return r;
}
/// What the reply says of the look, which left out `what`; empty: it does not.
std::string lookSays(const RenderResult& r, const std::string& what) {
  const auto left = nodesBy(r, v1::NodeReport::PRUNED);
  const auto at = left.find(what);
  return at == left.end() ? "" : at->second.reason();
}
const char* const kSunnySky = "environment.sky.turbidity=3";
const char* const kEvenSky = "environment.constant=1,1,1";

TEST(AreaLightsWorth, TheLightsAreTakenWherePathsNeedHalfTheirTimeMore) {
  LookedAt seen{.mean = 2, .error2 = 0.01, .doubt = 0.0, .variance = 1.5, .varianceDoubt = 0.0, .samples = 100};  // paths: 0.015 in the time of the lights
  EXPECT_TRUE(worthBy(seen, "8 area lights").lights);
  EXPECT_EQ(worthBy(seen, "8 area lights").why,
            "worth it, by a look at a small picture: path tracing would take 1.5 times as long as 8 area lights to their error, at most 5 % of the mean");
  seen.samples = 101;
  EXPECT_FALSE(worthBy(seen, "8 area lights").lights);
  seen.samples = 50;
  EXPECT_TRUE(worthBy(seen, "8 area lights").lights);
  seen.doubt = 0.011;  // what may be wrong counts as wrong
  EXPECT_FALSE(worthBy(seen, "8 area lights").lights);
  EXPECT_EQ(worthBy(seen, "8 area lights").why.find("not worth it"), 0u);
  seen.error2 = -0.004;  // noise of the estimate; the doubt remains
  EXPECT_TRUE(worthBy(seen, "8 area lights").lights);
  EXPECT_NE(worthBy(seen, "8 area lights").why.find("2.7 times"), std::string::npos) << worthBy(seen, "8 area lights").why;
  seen.varianceDoubt = 1.0;  // few pixels hold the noise: paths may be better than they looked
  EXPECT_FALSE(worthBy(seen, "8 area lights").lights);
  seen.varianceDoubt = 2.0;
  EXPECT_NE(worthBy(seen, "8 area lights").why.find(" 0 times"), std::string::npos) << worthBy(seen, "8 area lights").why;
}

TEST(AreaLightsWorth, WithoutLightOrErrorTheLightsStay) {
  EXPECT_TRUE(worthBy({}, "8 area lights").lights);
  EXPECT_EQ(worthBy({}, "8 area lights").why, "a look at a small picture found no light of the map: 8 area lights were asked for");
  EXPECT_TRUE(worthBy({.mean = 1, .error2 = 0, .doubt = 0, .variance = 0, .varianceDoubt = 0, .samples = 0}, "no area lights").lights);
  EXPECT_FALSE(
      worthBy({.mean = 1, .error2 = 0.1, .doubt = 0, .variance = 0.1, .varianceDoubt = 0, .samples = 0}, "no area lights").lights);  // lights that take no time
}

// A sun in the sky is found by lights at once and by one path in so many; under an even sky that meets a mirror they miss what paths have at once.
TEST(AreaLightsWorth, ThePictureIsOneOfTheTwoBitForBit) {
  const auto engine = makeEngine();
  const v1::RenderRequest sun = worthRequest("fence", kSunnySky, {"lights.sun.enabled=false", "lights.key.enabled=false"});
  const RenderResult lit = mustRender(*engine, weighed(sun));
  const RenderResult asked = mustRender(*engine, sun);
  EXPECT_EQ(firstDifference(lit, asked), "");
  EXPECT_EQ(lookSays(asked, kPathsLeftOut), "");  // nobody asked whether
  EXPECT_EQ(lookSays(lit, kPathsLeftOut).find("worth it"), 0u) << lookSays(lit, kPathsLeftOut);
  EXPECT_EQ(lookSays(lit, kLightsLeftOut), "");

  v1::RenderRequest even = worthRequest("spheres", kEvenSky, {"lights.key.enabled=false"});
  const RenderResult traced = mustRender(*engine, weighed(even));
  EXPECT_EQ(lookSays(traced, kLightsLeftOut).find("not worth it"), 0u) << lookSays(traced, kLightsLeftOut);
  EXPECT_EQ(lookSays(traced, kPathsLeftOut), "");
  EXPECT_NE(firstDifference(traced, mustRender(*engine, even)), "");
  even.mutable_environment()->clear_area_lights();
  EXPECT_EQ(firstDifference(traced, mustRender(*engine, even)), "");
}

// Of one request there is one answer, whoever asks: another engine, other threads, a window of the picture.
TEST(AreaLightsWorth, EveryoneChoosesAlike) {
  const v1::RenderRequest r = weighed(worthRequest("cornell", kSunnySky, {"lights.light.enabled=false"}));
  const RenderResult one = mustRender(*makeEngine(256ull << 20, {}, 1), r), three = mustRender(*makeEngine(256ull << 20, {}, 3), r);
  EXPECT_EQ(firstDifference(one, three), "");
  const std::string said = lookSays(one, kPathsLeftOut) + lookSays(one, kLightsLeftOut);
  EXPECT_NE(said, "");
  EXPECT_EQ(lookSays(three, kPathsLeftOut) + lookSays(three, kLightsLeftOut), said);
  v1::RenderRequest window = r;
  for (const char* e : {"window.x=8", "window.y=4", "window.width=16", "window.height=8"}) set(window, e);
  const RenderResult part = mustRender(*makeEngine(), window);
  EXPECT_EQ(lookSays(part, kPathsLeftOut) + lookSays(part, kLightsLeftOut), said);
}

TEST(AreaLightsWorth, AnEditRunsWhatItChanges) {
  const auto engine = makeEngine();
  v1::RenderRequest r = weighed(worthRequest("fence", kSunnySky, {"lights.sun.enabled=false", "lights.key.enabled=false"}));
  EXPECT_GT(nodesBy(mustRender(*engine, r), v1::NodeReport::RUN).count("look by paths"), 0u);
  const auto rays = [](const RenderResult& result) {
    uint64_t n = 0;
    for (const auto& row : result.reply.plan()) n += row.rays();
    return n;
  };
  EXPECT_EQ(rays(mustRender(*engine, r)), 0u);
  set(r, "halt.spp=8");  // of other light
  const RenderResult more = mustRender(*engine, r);
  EXPECT_EQ(nodesBy(more, v1::NodeReport::RUN).count("look by paths"), 0u);
  set(r, "environment.area_lights_if_worth=false");
  EXPECT_EQ(rays(mustRender(*engine, r)), 0u);  // the lights are there
  set(r, "environment.area_lights_if_worth=true");
  set(r, "environment.rotation_deg=70");
  EXPECT_GT(nodesBy(mustRender(*engine, r), v1::NodeReport::RUN).count("look by paths"), 0u);
}

TEST(AreaLightsWorth, WhatALookCannotWeighIsSaid) {
  const auto engine = makeEngine();
  const RenderResult lens = mustRender(
      *engine, weighed(worthRequest("cornell", kSunnySky, {"lights.light.shadow.path_traced=", "camera.lens_radius=0.01", "camera.focus_distance=3"})));
  EXPECT_EQ(lookSays(lens, kLightsLeftOut), "a lens needs path-traced light");
  const RenderResult styled = mustRender(*engine, weighed(worthRequest("cornell", kSunnySky, {"shadows.style.softness=0.1"})));
  EXPECT_EQ(lookSays(styled, kPathsLeftOut), "not weighed: shadows of a style are not what path tracing comes to");
  const RenderResult none = mustRender(*engine, weighed(worthRequest("cornell", kSunnySky, {"environment.area_lights=0"})));
  ASSERT_GT(none.reply.warnings_size(), 0);
  EXPECT_NE(none.reply.warnings(0).find("area_lights_if_worth"), std::string::npos);
}

TEST(AreaLightsWorth, ADryRunSaysThatALookDecides) {
  const auto engine = makeEngine();
  const auto plan = engine->plan(weighed(worthRequest("cornell", kSunnySky)));
  ASSERT_TRUE(plan.ok()) << plan.status().toString();
  bool said = false;
  for (const auto& row : plan->plan()) said = said || row.reason() == "a look at a small picture decides whether they are worth it";
  EXPECT_TRUE(said);
  EXPECT_TRUE(plan->decides_while_planning());
}

TEST(AreaLightsWorth, AWindowReservesNoMoreThanItMayHold) {
  const auto engine = makeEngine();
  v1::RenderRequest r = worthRequest("cornell", kSunnySky);
  for (const char* e : {"width=8192", "height=8192", "window.x=8", "window.y=4", "window.width=16", "window.height=8"}) set(r, e);
  const auto plain = engine->plan(r), looks = engine->plan(weighed(r));
  ASSERT_TRUE(plain.ok() && looks.ok()) << plain.status().toString() << looks.status().toString();
  EXPECT_LT(looks->pinned_bytes(), plain->pinned_bytes() + (8u << 20));  // a small picture and its paths; the whole one's would be gigabytes
}

}  // namespace
}  // namespace gobo::testing
