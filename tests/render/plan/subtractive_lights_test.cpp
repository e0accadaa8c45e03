// SPDX-License-Identifier: Apache-2.0
// shadows.subtractive in whole requests: what an edit runs again, gains of lamps alone, together and in clusters, whom it leaves to others, what it refuses,
// and the output of negative light.
#include <gtest/gtest.h>

#include <array>

#include "support/engines.h"
#include "support/planned_nodes.h"

namespace gobo::testing::subtractive_lights_test {
namespace {

v1::RenderRequest lampsRequest(const char* scene, int width = 24, int height = 16) {
  v1::RenderRequest r = smallRequest(scene, width, height, 4);
  for (const char* a : {"shadows.subtractive.lights=3", "outputs=direct", "integrator.max_bounces=0"}) set(r, a);
  return r;
}

std::string ranSubtractive(Engine& engine, const v1::RenderRequest& r) {
  std::string out;
  for (const auto& [label, row] : nodesBy(mustRender(engine, r), v1::NodeReport::RUN))
    if (label != "direct" && label.find("direct:") == std::string::npos) out += label.substr(0, label.find(':')) + " ";
  return out;
}

double meanOf(const Image& image) {
  double sum = 0;
  for (const float v : image.data) sum += double(v) / double(image.data.size());
  return sum;
}

Image imageOf(const RenderResult& r, size_t i = 0) { return r.images[i].image(); }

TEST(SubtractiveLightRequests, AnEditRunsWhatItChanges) {
  const auto engine = makeEngine();
  v1::RenderRequest r = lampsRequest("lights8");
  const auto ran = [&](const char* edit) {
    if (*edit) set(r, edit);
    return ranSubtractive(*engine, r);
  };
  const std::string all = "subtractive subtractive_samples unshadowed ", behind = "subtractive subtractive_samples ";
  EXPECT_EQ(ran(""), "gbuffer " + behind + "surface unshadowed ");
  EXPECT_EQ(ran("shadows.subtractive.form=DIFFERENCE"), "subtractive ");
  EXPECT_EQ(ran("shadows.subtractive.form=BETA"), "subtractive ");
  for (const char* edit : {"shadows.subtractive.resolution=2", "shadows.subtractive.width=1", "shadows.subtractive.angle_deg=10",
                           "shadows.subtractive.plane_distance=2", "shadows.subtractive.lights=4"})
    EXPECT_EQ(ran(edit), behind) << edit;
  EXPECT_EQ(ran("shadows.subtractive.lights=100"), behind);
  EXPECT_EQ(ran("shadows.subtractive.form=RATIO"), "subtractive ");
  EXPECT_EQ(ran("shadows.subtractive.lights=200"), "") << "all have rays already, and the ratio knows no number of lights";
  EXPECT_EQ(ran("lights.key.gain=2,1,1"), all) << "of several lamps the gains are part of what is seen of them";
  EXPECT_EQ(ran("seed=9"), all) << "lamps of some size";
}

TEST(SubtractiveLightRequests, ALampAloneKeepsItsGain) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 24, 16, 4);
  for (const char* a : {"lights.key.shadow.subtractive.lights=3", "outputs=direct,group:key", "integrator.max_bounces=0"}) set(r, a);
  const RenderResult first = mustRender(*engine, r);
  set(r, "lights.key.gain=2,1,0.5");
  EXPECT_EQ(ranSubtractive(*engine, r), "group ");
  const Image before = imageOf(first, 1), after = imageOf(mustRender(*engine, r), 1);
  ASSERT_GT(meanOf(before), 0.001);
  const float gain[3] = {2, 1, 0.5f};
  for (size_t i = 0; i < before.data.size(); ++i) ASSERT_NEAR(after.data[i], gain[i % 3] * before.data[i], 1e-6f + 1e-5f * after.data[i]);
  set(r, "lights.key.enabled=false");
  const RenderResult off = mustRender(*engine, r);
  for (const float v : imageOf(off, 1).data) ASSERT_EQ(v, 0.0f);
}

// Edits of single lamps are those of a picture in which each is a group of its own, or fewer of them are in the cluster.
TEST(SubtractiveLightRequests, GainsInsideAClusterAreTheLampsOwn) {
  for (const auto& [scene, lamps] : {std::pair{"lamps", std::array{"lamp0003", "lamp0900", "lamp0500"}}, std::pair{"lights8", std::array{"a", "key", "e"}}}) {
    v1::RenderRequest r = lampsRequest(scene, 20, 14);
    for (const std::string& a : {std::string("shadows.subtractive.resolution=2"), std::string("lights.") + lamps[0] + ".enabled=false",
                                 std::string("lights.") + lamps[1] + ".gain=30,1,1", std::string("lights.") + lamps[2] + ".color=0,0,1"})
      set(r, a);
    Image pictures[2];
    int k = 0;
    for (const char* groups : {"integrator.max_groups=2", "integrator.max_groups=16"}) {
      set(r, groups);
      const auto engine = makeEngine();
      const RenderResult made = mustRender(*engine, r);
      for (const auto& [label, row] : nodesBy(made, v1::NodeReport::RUN)) EXPECT_EQ(label.find("difference"), std::string::npos) << label;
      pictures[k++] = imageOf(made);
    }
    ASSERT_GT(meanOf(pictures[0]), 0.01);
    for (size_t i = 0; i < pictures[0].data.size(); ++i) ASSERT_NEAR(pictures[0].data[i], pictures[1].data[i], 1e-5f * pictures[1].data[i]) << scene << i;
  }
}

// Indirect light and emission of an edited lamp of a cluster are differences still.
TEST(SubtractiveLightRequests, TheRestOfAClusterIsADifference) {
  const auto engine = makeEngine();
  v1::RenderRequest r = lampsRequest("lamps", 20, 14);
  for (const char* a : {"integrator.max_groups=3", "integrator.max_bounces=2", "outputs=direct,indirect", "lights.lamp0900.gain=30,30,30"}) set(r, a);
  std::string run;
  for (const auto& [label, row] : nodesBy(mustRender(*engine, r), v1::NodeReport::RUN)) run += label + " ";
  EXPECT_NE(run.find("difference:lamp0900"), std::string::npos) << run;
  v1::RenderRequest alone = r;
  set(alone, "integrator.max_bounces=0");
  EXPECT_EQ(firstDifference(mustRender(*engine, r), mustRender(*engine, r)), "");
  const Image with = imageOf(mustRender(*engine, r)), without = imageOf(mustRender(*engine, alone));
  for (size_t i = 0; i < with.data.size(); ++i) ASSERT_EQ(with.data[i], without.data[i]) << "direct light is the technique's alone, " << i;
}

// Every lamp has a ray at every sample: the path tracer's direct light, up to the noise of one ray to lamps of some size.
TEST(SubtractiveLightRequests, PicturesAreThoseOfThePathTracer) {
  const auto engine = makeEngine();
  for (const char* scene : {"lights8", "fence"}) {
    v1::RenderRequest r = smallRequest(scene, 48, 32, 256);
    for (const char* a : {"outputs=direct", "integrator.max_bounces=0", "integrator.at_view_samples=true", "view_samples=4", "environment.path=none"})
      set(r, a);
    const Image truth = imageOf(mustRender(*engine, r));
    ASSERT_GT(meanOf(truth), 0.01);
    for (const char* form : {"RATIO", "BETA", "DIFFERENCE"})
      for (const auto& [resolution, bound] : {std::pair{"1", 0.02}, std::pair{"4", 0.06}}) {
        v1::RenderRequest s = r;
        for (const std::string& a : {std::string("shadows.subtractive.form=") + form, std::string("shadows.subtractive.resolution=") + resolution}) set(s, a);
        EXPECT_NEAR(meanOf(imageOf(mustRender(*engine, s))) / meanOf(truth), 1.0, bound) << scene << " " << form << " " << resolution;
      }
  }
}

TEST(SubtractiveLightRequests, WhatItCannotDoFallsBackAndSaysSo) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("pane", 24, 16, 4);  // a clear one
  for (const char* a : {"lights.bulb.kind=POINT", "lights.bulb.position=0.1,1.5,0.2", "lights.bulb.intensity=5"}) set(r, a);
  v1::RenderRequest rays = r;
  set(r, "shadows.subtractive.lights=3");
  set(rays, "shadows.ray_traced.samples=16");
  RenderControl control;
  control.scene = paneScene();
  const auto asked = engine->render(r, control), traced16 = engine->render(rays, control);
  ASSERT_TRUE(asked.ok() && traced16.ok()) << asked.status().toString() << traced16.status().toString();
  ASSERT_GE(asked->reply.warnings_size(), 1);
  EXPECT_NE(asked->reply.warnings(0).find("shadows.subtractive: the scene has"), std::string::npos) << asked->reply.warnings(0);
  EXPECT_EQ(firstDifference(*asked, *traced16), "");

  v1::RenderRequest sky = smallRequest("fence", 24, 16, 4), traced = sky;  // its map is path traced as ever
  for (v1::RenderRequest* s : {&sky, &traced})
    for (const char* a : {"environment.constant=1,1,1", "outputs=group:environment"}) set(*s, a);
  set(sky, "shadows.subtractive.lights=3");
  set(traced, "shadows.ray_traced.samples=4");  // so that the tracer has the map alone there too
  EXPECT_EQ(firstDifference(mustRender(*engine, sky), mustRender(*engine, traced)), "");

  v1::RenderRequest styled = lampsRequest("lights8"), plain = styled;
  set(styled, "shadows.style.brightness=0.5");
  const RenderResult with = mustRender(*engine, styled);
  ASSERT_GE(with.reply.warnings_size(), 1);
  EXPECT_NE(with.reply.warnings(0).find("shadows.style"), std::string::npos) << with.reply.warnings(0);
  EXPECT_EQ(firstDifference(with, mustRender(*engine, plain)), "");
}

TEST(SubtractiveLightRequests, RefusalsNameFieldAndValue) {
  const auto engine = makeEngine();
  for (const char* bad :
       {"shadows.subtractive.lights=0", "shadows.subtractive.resolution=33", "shadows.subtractive.width=0", "shadows.subtractive.angle_deg=90"}) {
    v1::RenderRequest r = lampsRequest("lights8");
    set(r, bad);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << bad;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_NE(made.status().location().find("shadows.subtractive"), std::string::npos) << made.status().toString();
  }
  v1::RenderRequest r = lampsRequest("lights8");
  set(r, "outputs=direct,group:key");
  const auto made = engine->render(r);
  ASSERT_FALSE(made.ok());
  EXPECT_EQ(made.status().code(), Code::InvalidArgument);
  EXPECT_EQ(made.status().location(), "request.outputs");
  EXPECT_NE(made.status().message().find("group:key"), std::string::npos) << made.status().toString();
}

// Lamps of other settings are a set of their own, with lists of their own.
TEST(SubtractiveLightRequests, SetsOfEqualSettingsAreTogether) {
  const auto engine = makeEngine();
  v1::RenderRequest r = lampsRequest("lights8");
  set(r, "lights.key.shadow.subtractive.lights=7");
  int samples = 0;
  for (const auto& [label, row] : nodesBy(mustRender(*engine, r), v1::NodeReport::RUN)) samples += label.rfind("subtractive_samples:", 0) == 0;
  EXPECT_EQ(samples, 2);
  set(r, "lights.key.shadow.subtractive.lights=3");
  const v1::RenderRequest plain = lampsRequest("lights8");
  EXPECT_EQ(firstDifference(mustRender(*engine, r), mustRender(*engine, plain)), "");
}

TEST(NegativeLight, IsWhatTheDifferenceCutsOff) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 4);  // closed but for its front: most of the map is hidden
  for (const char* a : {"environment.constant=1,1,1", "environment.subtractive.lights=9", "environment.subtractive.form=DIFFERENCE",
                        "environment.subtractive.resolution=1", "integrator.max_bounces=0", "outputs=negative_light"})
    set(r, a);
  const Image cut = imageOf(mustRender(*engine, r));
  EXPECT_GT(meanOf(cut), 0.001);
  for (const float v : cut.data) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f);
  set(r, "environment.gain=2,1,0.25");
  const Image gained = imageOf(mustRender(*engine, r));
  const float gain[3] = {2, 1, 0.25f};
  for (size_t i = 0; i < cut.data.size(); ++i) ASSERT_NEAR(gained.data[i], gain[i % 3] * cut.data[i], 1e-6f) << i;
  set(r, "environment.subtractive.form=RATIO");
  for (const float v : imageOf(mustRender(*engine, r)).data) ASSERT_EQ(v, 0.0f);

  v1::RenderRequest lamps = lampsRequest("lights8", 48, 32);  // resampled shadows darker than the light that there is
  for (const char* a : {"shadows.subtractive.form=DIFFERENCE", "shadows.subtractive.resolution=16", "shadows.subtractive.width=4", "outputs=negative_light"})
    set(lamps, a);
  EXPECT_GT(meanOf(imageOf(mustRender(*engine, lamps))), 1e-8);
  set(lamps, "shadows.subtractive.form=RATIO");
  EXPECT_EQ(meanOf(imageOf(mustRender(*engine, lamps))), 0.0);

  v1::RenderRequest none = smallRequest("cornell", 24, 16, 4);
  set(none, "outputs=negative_light");
  const RenderResult black = mustRender(*engine, none);
  EXPECT_EQ(meanOf(imageOf(black)), 0.0);
  ASSERT_GE(black.reply.warnings_size(), 1);
  EXPECT_NE(black.reply.warnings(0).find("negative_light is black"), std::string::npos) << black.reply.warnings(0);
}

}  // namespace
}  // namespace gobo::testing::subtractive_lights_test
