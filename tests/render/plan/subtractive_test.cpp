// SPDX-License-Identifier: Apache-2.0
// environment.subtractive in whole requests: what an edit runs again, what it is in the plan, whom it leaves to the path tracer, what it refuses.
#include <gtest/gtest.h>

#include <set>

#include "support/engines.h"

namespace gobo::testing {
namespace {

v1::RenderRequest subtractiveRequest(const char* scene) {
  v1::RenderRequest r = smallRequest(scene, 24, 16, 4);
  for (const char* a : {"environment.sky.turbidity=3", "environment.subtractive.lights=8"}) set(r, a);
  return r;
}

TEST(Subtractive, AnEditRunsWhatItChanges) {
  const auto engine = makeEngine();
  v1::RenderRequest r = subtractiveRequest("lights8");  // has what shines
  set(r, "environment.subtractive.bright_lights=0");
  set(r, "outputs=direct");
  const auto ran = [&](const char* edit) {
    if (*edit) set(r, edit);
    std::string out;
    for (const auto& [label, row] : nodesBy(mustRender(*engine, r), v1::NodeReport::RUN))
      if (label.rfind("subtractive:", 0) == 0 || label.rfind("environment:", 0) == 0) out += label + " ";
    return out;
  };
  EXPECT_EQ(ran(""), "environment:gloss environment:split subtractive:light subtractive:lights subtractive:samples subtractive:unshadowed ");
  EXPECT_EQ(ran("environment.gain=2,2,2"), "");
  EXPECT_EQ(ran("environment.subtractive.form=DIFFERENCE"), "subtractive:light ");
  EXPECT_EQ(ran("environment.subtractive.form=BETA"), "subtractive:light ");
  for (const char* edit : {"environment.subtractive.resolution=2", "environment.subtractive.width=1", "environment.subtractive.angle_deg=10",
                           "environment.subtractive.plane_distance=2"})
    EXPECT_EQ(ran(edit), "subtractive:light subtractive:samples ") << edit;
  EXPECT_EQ(ran("environment.subtractive.lights=9"), "subtractive:light subtractive:lights subtractive:samples ");
  EXPECT_EQ(ran("environment.extract_by=STRUCTURED"), "subtractive:light subtractive:lights subtractive:samples ");
  EXPECT_EQ(ran("environment.rotation_deg=40"), "subtractive:light subtractive:samples subtractive:unshadowed ");
  EXPECT_NE(ran("environment.subtractive.bright_lights=2").find("environment:split"), std::string::npos);
  EXPECT_NE(ran("environment.subtractive.bright_share=0.3").find("environment:split"), std::string::npos);
}

TEST(Subtractive, WhatItCannotDoIsPathTracedAndSaid) {
  const auto engine = makeEngine();
  v1::RenderRequest r = subtractiveRequest("spheres");  // glass
  const RenderResult asked = mustRender(*engine, r);
  ASSERT_EQ(asked.reply.warnings_size(), 1);
  EXPECT_NE(asked.reply.warnings(0).find("environment.subtractive: the scene has"), std::string::npos) << asked.reply.warnings(0);
  r.mutable_environment()->clear_subtractive();
  EXPECT_EQ(firstDifference(asked, mustRender(*engine, r)), "");
}

TEST(Subtractive, WithoutAnEnvironmentItIsSaidThatThereIsNothingToDo) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 4), plain = r;
  ASSERT_EQ((*engine->scene("cornell"))->environment, nullptr);
  set(r, "environment.subtractive.lights=8");
  for (const char* other : {"", "environment.extract_lights=3"}) {
    if (*other) set(r, other);
    const RenderResult asked = mustRender(*engine, r);
    ASSERT_EQ(asked.reply.warnings_size(), 1) << other;
    EXPECT_EQ(asked.reply.warnings(0), "environment.subtractive: the scene has no environment and the request brings none: nothing to do");
    EXPECT_EQ(firstDifference(asked, mustRender(*engine, plain)), "");
  }
}

TEST(Subtractive, TwoWaysOfOneMapAreRefused) {
  const auto engine = makeEngine();
  for (const char* other : {"environment.extract_lights=3", "environment.area_lights=3", "environment.transfer.points=300"}) {
    v1::RenderRequest r = subtractiveRequest("cornell");
    set(r, other);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << other;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), "request.environment.subtractive") << made.status().toString();
    const std::string field(std::string(other).substr(12, std::string(other).find_first_of("=.", 12) - 12));
    EXPECT_NE(made.status().message().find("subtractive: " + field + " stands for the map too"), std::string::npos) << made.status().toString();
  }
  for (const char* bad : {"environment.subtractive.lights=0", "environment.subtractive.resolution=33", "environment.subtractive.width=0"}) {
    v1::RenderRequest r = subtractiveRequest("cornell");
    set(r, bad);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << bad;
    EXPECT_NE(made.status().location().find("environment.subtractive"), std::string::npos) << made.status().toString();
  }
}

double meanOf(const Image& image) {
  double sum = 0;
  for (const float v : image.data) sum += double(v) / double(image.data.size());
  return sum;
}

// A uniform map: the light of every place is its openness. The path tracer's mean within 3 %, and every form close to it.
TEST(Subtractive, PicturesAreThoseOfThePathTracer) {
  const auto engine = makeEngine();
  for (const char* scene : {"fence", "tentacles"}) {
    v1::RenderRequest r = smallRequest(scene, 48, 32, 256);
    for (const char* a : {"environment.constant=1,0.8,0.6", "outputs=direct", "integrator.at_view_samples=true"}) set(r, a);
    const ScenePtr loaded = *engine->scene(scene);
    for (const Light& light : loaded->lights)
      if (light.shape.kind != LightKind::Environment) set(r, "lights." + light.name + ".enabled=false");
    const Image truth = mustRender(*engine, r).images[0].image();
    for (const char* form : {"RATIO", "BETA", "DIFFERENCE"})
      for (const char* resolution : {"1", "4"}) {
        v1::RenderRequest s = r;
        for (const std::string& a : {std::string("environment.subtractive.lights=100"), std::string("environment.subtractive.form=") + form,
                                     std::string("environment.subtractive.resolution=") + resolution})
          set(s, a);
        const Image picture = mustRender(*engine, s).images[0].image();
        double error = 0;
        for (size_t i = 0; i < truth.data.size(); ++i) error += (double(picture.data[i]) - truth.data[i]) * (double(picture.data[i]) - truth.data[i]);
        const double mean = meanOf(truth);
        ASSERT_GT(mean, 0.05);
        EXPECT_NEAR(meanOf(picture) / mean, 1.0, 0.03) << scene << " " << form << " " << resolution;
        EXPECT_LT(std::sqrt(error / double(truth.data.size())) / mean, 0.15) << scene << " " << form << " " << resolution;
      }
  }
}

}  // namespace
}  // namespace gobo::testing
