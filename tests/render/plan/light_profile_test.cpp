// SPDX-License-Identifier: Apache-2.0
// lights.NAME.profile and profile_rotation_deg in requests: what they refuse, what it costs to change them, what they leave as it was.
#include <gtest/gtest.h>

#include "request/effective_scene.h"
#include "scene/light_axes.h"
#include "scene/load.h"
#include "support/engines.h"

namespace gobo::testing {
namespace light_profile_requests {

v1::RenderRequest spotRequest(const std::vector<std::string>& more = {}) {
  v1::RenderRequest r = smallRequest("cornell", 24, 18, 4);
  for (const char* a : {"lights.light.enabled=false", "lights.spot.kind=SPOT", "lights.spot.position=0,1,1.2", "lights.spot.direction=0,0,-1",
                        "lights.spot.outer_deg=40", "lights.spot.inner_deg=39", "lights.spot.intensity=4", "lights.spot.profile=WINDOW"})
    set(r, a);
  for (const std::string& a : more) set(r, a);
  return r;
}

TEST(LightProfileRequests, WhatCannotBeNamesFieldAndValue) {
  const auto engine = makeEngine();
  const auto refused = [&](const std::vector<std::string>& edits, const char* what) {
    const auto result = engine->render(spotRequest(edits));
    ASSERT_FALSE(result.ok()) << what;
    EXPECT_EQ(result.status().code(), Code::InvalidArgument);
    EXPECT_NE(result.status().toString().find(what), std::string::npos) << result.status().toString();
  };
  for (const char* kind : {"POINT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"})
    refused({std::string("lights.spot.kind=") + kind, "lights.spot.profile=LEAVES"}, "lights.spot.profile = LEAVES");
  refused({"lights.light.profile=BLINDS"}, "lights.light");
  refused({"lights.spot.profile_rotation_deg=1e6"}, "lights.spot.profile_rotation_deg");
  mustRender(*engine, spotRequest({"lights.spot.kind=POINT", "lights.spot.profile=NONE"}));
}

TEST(LightProfileRequests, NoneIsTheLampAsItWas) {
  v1::RenderRequest never = spotRequest();
  (*never.mutable_lights())["spot"].clear_profile();
  const RenderResult plain = mustRender(*makeEngine(), never);
  EXPECT_EQ(firstDifference(plain, mustRender(*makeEngine(), spotRequest({"lights.spot.profile=NONE"}))), "");
  EXPECT_EQ(firstDifference(plain, mustRender(*makeEngine(), spotRequest({"lights.spot.profile=NONE", "lights.spot.profile_rotation_deg=30"}))), "");
  EXPECT_NE(firstDifference(plain, mustRender(*makeEngine(), spotRequest())), "");
  EXPECT_EQ(firstDifference(mustRender(*makeEngine(), spotRequest({"lights.spot.profile_rotation_deg=40"})),
                            mustRender(*makeEngine(), spotRequest({"lights.spot.profile_rotation_deg=400"}))),
            "");
}

TEST(LightProfileRequests, PowerRetracesNothingAndRotationDoes) {
  for (const char* shadow : {"path_traced=", "ray_traced.samples=1", "percentage_closer="}) {
    const auto engine = makeEngine();
    const auto request = [&](const std::string& edit) { return spotRequest({std::string("lights.spot.shadow.") + shadow, edit}); };
    mustRender(*engine, request("seed=0"));
    for (const char* edit : {"lights.spot.intensity=5", "lights.spot.color=1,0.5,0.2", "lights.spot.gain=0.1,2,1"}) {
      const RenderResult two = mustRender(*engine, request(edit));
      EXPECT_EQ(two.reply.rays(), 0u) << shadow << " " << edit;
      for (const auto& [label, node] : nodesBy(two, v1::NodeReport::RUN)) EXPECT_EQ(label, "beauty") << shadow << " " << edit;
    }
    for (const char* edit : {"lights.spot.profile_rotation_deg=25", "lights.spot.profile=BLINDS"}) {
      const RenderResult other = mustRender(*engine, request(edit));
      EXPECT_GT(other.reply.rays(), 0u) << shadow << " " << edit;
      const auto run = nodesBy(other, v1::NodeReport::RUN);
      if (std::string(shadow) != "path_traced=") { EXPECT_TRUE(run.count("unoccluded:spot")) << shadow << " " << edit; }
      for (const char* kept : {"gbuffer", "surface"}) EXPECT_FALSE(run.count(kept)) << shadow << " " << edit << " " << kept;
    }
  }
}

// Seen from where the lamp is, each pixel is a direction of the lamp, whatever stands there: the profile is what it has of the picture without one.
TEST(LightProfileRequests, RotationTurnsThePicture) {
  const auto engine = makeEngine();
  const auto seen = [&](const char* edit) {
    v1::RenderRequest r =
        spotRequest({"camera.position=0,1,0", "camera.look_at=0,1,-1", "camera.yfov_deg=50", "integrator.indirect=false", "lights.spot.position=0,1,0",
                     "lights.spot.profile=LEAVES", "width=32", "height=32", "view_samples=16", "shadows.ray_traced.samples=1"});
    set(r, std::string("lights.spot.profile") + edit);
    return mustRender(*engine, r).images.at(0).image();
  };
  const Image none = seen("=NONE"), straight = seen("_rotation_deg=0"), quarter = seen("_rotation_deg=90"), again = seen("_rotation_deg=450");
  const auto factor = [&](const Image& image, int x, int y) { return double(image.at(x, y)[1]) / double(none.at(x, y)[1]); };
  // Counter-clockwise: what was at the right is at the top.
  double same = 0, turned = 0, back = 0, sum = 0;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      ASSERT_GT(none.at(x, y)[1], 0.0f);
      const double q = factor(quarter, x, y);
      turned += std::fabs(q - factor(straight, 31 - y, x));
      same += std::fabs(q - factor(straight, x, y));
      back += std::fabs(q - factor(again, x, y));
      sum += q;
    }
  EXPECT_GT(sum, 0.0);
  EXPECT_LT(turned, 0.35 * same);
  EXPECT_EQ(back, 0.0);
}

// The lamp keeps its picture upright as far as it can, wherever it is aimed: also straight down and up.
TEST(LightProfileRequests, DirectionsCarryThePictureAlong) {
  const ScenePtr base = *makeBuiltinScene("cornell");
  const auto frame = [&](const Vec3& d) {
    Scene s = *base;
    Light l;
    l.name = "lamp";
    s.lights.push_back(l);
    v1::LightEdit e;
    e.set_kind(v1::LightEdit::SPOT);
    e.set_profile(v1::LightEdit::BLINDS);
    e.mutable_direction()->set_x(d.x);
    e.mutable_direction()->set_y(d.y);
    e.mutable_direction()->set_z(d.z);
    EXPECT_TRUE(applyLightShape(e, s, s.lights.size() - 1, "lights.lamp").ok());
    return profileFrame(s.lights.back().shape);
  };
  const Frame down = frame(Vec3(0, -1, 0));
  EXPECT_NEAR(glm::length(down.x - Vec3(1, 0, 0)), 0, 1e-6);
  for (int i = 0; i < 32; ++i) {
    const float a = float(i) * 0.2f;
    const Frame f = frame(Vec3(0.01f * std::cos(a), -1, 0.01f * std::sin(a)));
    EXPECT_LT(glm::length(f.x - down.x), 0.011f) << "no jump round straight down";
  }
  for (const Vec3& d : {Vec3(0, 1, 0), Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 0, 1)}) {
    const Frame f = frame(d);
    EXPECT_TRUE(isFinite(f.x) && isFinite(f.y));
    EXPECT_NEAR(glm::length(f.x), 1, 1e-5);
    EXPECT_NEAR(glm::dot(f.x, f.z), 0, 1e-5);
  }
}

}  // namespace light_profile_requests
}  // namespace gobo::testing
