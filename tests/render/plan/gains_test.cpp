// SPDX-License-Identifier: Apache-2.0
// Gains act on each channel by itself, for every kind of light; a turned environment is a turned environment whatever stands for it.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace {

void expectScaled(const RenderResult& one, const RenderResult& scaled, const Vec3& by, const std::string& what) {
  ASSERT_EQ(one.images.size(), 1u);
  const Image &a = one.images[0].image(), &b = scaled.images[0].image();
  Vec3 most(0.0f);
  for (size_t i = 0; i < a.data.size(); ++i) {
    const int c = int(i % 3);
    most[c] = std::max(most[c], a.data[i]);
    ASSERT_NEAR(b.data[i], a.data[i] * by[c], 1e-5f * (1e-3f + a.data[i] * by[c])) << what << ", channel " << c;
  }
  for (int c = 0; c < 3; ++c) EXPECT_GT(most[c], 0.0f) << what << ": black, the test says nothing";
}

TEST(Gains, OfTheEnvironmentActOnEachChannel) {
  for (const char* kind : {"environment.constant=0.5,0.6,0.7", "environment.sky.turbidity=3"})
    for (const char* as : {"seed=0", "environment.area_lights=3", "environment.extract_lights=3", "environment.transfer.points=300"}) {
      const auto engine = makeEngine();
      v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
      for (const char* a : {kind, as, "lights.light.enabled=false"}) set(r, a);
      const RenderResult one = mustRender(*engine, r);
      for (const Vec3 gain : {Vec3(3, 1, 1), Vec3(1, 3, 1), Vec3(1, 1, 3)}) {
        set(r, "environment.gain=" + std::to_string(gain.x) + "," + std::to_string(gain.y) + "," + std::to_string(gain.z));
        expectScaled(one, mustRender(*engine, r), gain, std::string(kind) + " " + as);
      }
    }
}

TEST(Gains, OfEveryKindOfLightActOnEachChannel) {
  for (const char* kind : {"POINT", "SPOT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"})
    for (const char* shadow : {"path_traced=", "ray_traced.samples=1"}) {
      const auto engine = makeEngine();
      v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
      for (const std::string& a :
           {std::string("lights.light.enabled=false"), std::string("lights.lamp.kind=") + kind, std::string("lights.lamp.position=0.2,1.5,0.4"),
            std::string("lights.lamp.direction=0,-0.3,-1"), std::string("lights.lamp.angular_size_deg=3"), std::string("lights.lamp.intensity=3"),
            std::string("lights.lamp.outer_deg=60"), std::string("lights.lamp.shadow.") + shadow})
        set(r, a);
      const RenderResult one = mustRender(*engine, r);
      set(r, "lights.lamp.gain=1,2,5");
      expectScaled(one, mustRender(*engine, r), Vec3(1, 2, 5), std::string(kind) + " " + shadow);
      set(r, "lights.lamp.color=2,1,0.5");
      expectScaled(one, mustRender(*engine, r), Vec3(2, 2, 2.5f), std::string(kind) + " " + shadow + " coloured");
    }
}

// What a scene's file says of a light, said again by a request, is no edit; each of the two numbers keeps the other.
TEST(Gains, ColourAndIntensityOfTheFileSaidAgainChangeNothing) {
  const auto engine = makeEngine();
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(2.0f), m.material(Vec3(0.7f))));
  Light lamp;
  lamp.name = "lamp";
  lamp.shape.kind = LightKind::Point;
  lamp.shape.position = Vec3(0, 1, 0);
  setPower(lamp, {Vec3(1, 0.5f, 0.125f), 8});
  m.scene.lights.push_back(lamp);
  m.camera(Vec3(0, 2, 2), Vec3(0.0f));
  const ScenePtr scene = m.finish();
  const auto picture = [&](const std::vector<std::string>& edits) {
    v1::RenderRequest r = smallRequest("by hand", 12, 8, 4);
    for (const std::string& edit : edits) set(r, edit);
    RenderControl control;
    control.scene = scene;
    Result<RenderResult> result = engine->render(r, control);
    EXPECT_TRUE(result.ok()) << result.status().toString();
    return result.ok() ? std::move(*result) : RenderResult{};
  };
  const RenderResult plain = picture({});
  const std::string intensity = "lights.lamp.intensity=8", color = "lights.lamp.color=1,0.5,0.125";
  for (const std::vector<std::string>& edits : {std::vector{intensity}, {color}, {color, intensity}})
    EXPECT_EQ(firstDifference(plain, picture(edits)), "") << edits[0];
  expectScaled(plain, picture({"lights.lamp.intensity=24"}), Vec3(3.0f), "three times");
  expectScaled(plain, picture({"lights.lamp.color=1,1,1"}), Vec3(1, 2, 8), "white");
}

TEST(Gains, BeyondWhatAFloatHoldsAreRefusedByName) {
  const auto engine = makeEngine();
  for (const char* gain : {"1e30,1,1", "1,1,1e38"}) {
    v1::RenderRequest r = smallRequest("cornell", 8, 6, 1);
    set(r, std::string("lights.light.gain=") + gain);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << gain;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument) << made.status().toString();
    EXPECT_EQ(made.status().location(), "request.lights.light") << made.status().toString();
  }
  v1::RenderRequest r = smallRequest("cornell", 8, 6, 1);
  set(r, "lights.light.gain=1e6,1,1");
  EXPECT_TRUE(engine->render(r).ok());
}

double meanDifference(const RenderResult& a, const RenderResult& b) {
  const Image &x = a.images[0].image(), &y = b.images[0].image();
  double difference = 0, sum = 0;
  for (size_t i = 0; i < x.data.size(); ++i) {
    difference += std::fabs(double(x.data[i]) - y.data[i]);
    sum += y.data[i];
  }
  return difference / sum;
}

// A sky whose sun stands elsewhere is the sky turned, but for its texels. One light: most of the sky is the ambient remainder.
TEST(EnvironmentTurn, LightsAndRemainderTurnTogether) {
  for (const char* as : {"environment.area_lights=1", "environment.area_lights=4", "environment.extract_lights=16", "environment.transfer.points=3000"}) {
    v1::RenderRequest r = smallRequest("fence", 32, 24, 1);
    r.add_outputs("direct");
    for (const char* a : {as, "shadows.ray_traced.samples=16", "integrator.indirect=false", "lights.sun.enabled=false", "lights.key.enabled=false",
                          "environment.sky.sun_direction=1,0.6,0"})
      set(r, a);
    const auto engine = makeEngine();
    const RenderResult unturned = mustRender(*engine, r);
    v1::RenderRequest turned = r, moved = r, wrong = r;
    set(turned, "environment.rotation_deg=90");  // counter-clockwise seen from above: +x goes to -z
    set(moved, "environment.sky.sun_direction=0,0.6,-1");
    set(wrong, "environment.sky.sun_direction=0,0.6,1");
    const RenderResult a = mustRender(*engine, turned), b = mustRender(*engine, moved), c = mustRender(*engine, wrong);
    const double right = meanDifference(a, b), other = meanDifference(a, c);
    EXPECT_LT(right, 0.1) << as;
    EXPECT_GT(other, 2 * right) << as << ": turning the other way must be another picture";
    EXPECT_GT(meanDifference(unturned, b), 2 * right) << as;
  }
}

/// What a file says of its map's strength (0.4 in `spheres`) reaches whatever stands for the map: the mean of its direct light is that of the
/// traced map, within what a remainder without shadows costs.
TEST(EnvironmentStrength, OfTheFileReachesLightsAndRemainder) {
  v1::RenderRequest r = smallRequest("spheres", 32, 24, 64);
  r.add_outputs("direct");
  set(r, "integrator.indirect=false");
  const auto engine = makeEngine();
  const auto mean = [](const RenderResult& result) {
    double sum = 0;
    for (const float v : result.images[0].image().data) sum += double(v);
    return sum;
  };
  const double traced = mean(mustRender(*engine, r));
  for (const char* as : {"environment.area_lights=1", "environment.area_lights=8"}) {
    v1::RenderRequest other = r;
    set(other, as);
    const double ratio = mean(mustRender(*engine, other)) / traced;
    EXPECT_GT(ratio, 0.75) << as;
    EXPECT_LT(ratio, 1.5) << as;
  }
}

}  // namespace
}  // namespace gobo::testing
