// SPDX-License-Identifier: Apache-2.0
// angular_size_deg in requests: what it refuses, what it costs to change, and that every way to make the picture agrees.
#include <gtest/gtest.h>

#include <cmath>

#include "plan/planner.h"
#include "request/material_kinds.h"
#include "scene/load.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

v1::RenderRequest sunRequest(const std::vector<std::string>& more = {}, int spp = 4) {
  v1::RenderRequest r = smallRequest("cornell", 24, 18, spp);
  for (const char* a : {"lights.light.enabled=false", "lights.sun.kind=DIRECTIONAL", "lights.sun.direction=-0.3,-0.4,-1", "lights.sun.intensity=2",
                        "lights.sun.angular_size_deg=4"})
    set(r, a);
  for (const std::string& a : more) set(r, a);
  return r;
}

TEST(SoftSunRequests, BadSizesNameTheFieldAndTheValue) {
  const auto engine = makeEngine();
  for (const double bad : {-1.0, 90.5, 1e-6, 1e300, double(NAN), double(INFINITY)}) {
    v1::RenderRequest r = sunRequest();
    (*r.mutable_lights())["sun"].set_angular_size_deg(bad);
    const auto result = engine->render(r);
    ASSERT_FALSE(result.ok()) << bad;
    EXPECT_EQ(result.status().code(), Code::InvalidArgument);
    EXPECT_NE(result.status().toString().find("lights.sun.angular_size_deg"), std::string::npos) << result.status().toString();
    if (bad == 1e-6) EXPECT_NE(result.status().toString().find("1e-06"), std::string::npos) << result.status().toString();
  }
  for (const double good : {0.0, 1e-4, 0.53, 90.0}) {
    v1::RenderRequest r = sunRequest();
    (*r.mutable_lights())["sun"].set_angular_size_deg(good);
    mustRender(*engine, r);
  }
}

TEST(SoftSunRequests, NoSizeIsTheSunAsItWas) {
  v1::RenderRequest none = sunRequest();
  (*none.mutable_lights())["sun"].clear_angular_size_deg();
  const RenderResult a = mustRender(*makeEngine(), none), b = mustRender(*makeEngine(), sunRequest({"lights.sun.angular_size_deg=0"}));
  EXPECT_EQ(firstDifference(a, b), "");
  EXPECT_NE(firstDifference(a, mustRender(*makeEngine(), sunRequest())), "");
}

TEST(SoftSunRequests, PowerRetracesNothingAndSizeDoes) {
  for (const char* shadow : {"path_traced=", "ray_traced.samples=4", "percentage_closer_soft="}) {
    const auto engine = makeEngine();
    const auto request = [&](const std::string& edit) {
      v1::RenderRequest r = smallRequest("fence");  // its own sun: an added light's nominal power follows its intensity
      for (const std::string& a : {std::string("lights.sun.shadow.") + shadow, std::string("lights.sun.angular_size_deg=4"), edit}) set(r, a);
      return r;
    };
    mustRender(*engine, request("seed=0"));
    for (const char* edit : {"lights.sun.intensity=5", "lights.sun.color=1,0.5,0.2", "lights.sun.gain=0.1,2,1"}) {
      const RenderResult two = mustRender(*engine, request(edit));
      EXPECT_EQ(two.reply.rays(), 0u) << shadow << " " << edit;
      for (const auto& [label, node] : nodesBy(two, v1::NodeReport::RUN)) EXPECT_EQ(label, "beauty") << shadow << " " << edit;
    }
    const auto sized = nodesBy(mustRender(*engine, request("lights.sun.angular_size_deg=5")), v1::NodeReport::RUN);
    EXPECT_FALSE(sized.empty()) << shadow;
    for (const char* kept : {"gbuffer", "surface", "light_depth_map:sun", "depth_bounds:sun"}) EXPECT_FALSE(sized.count(kept)) << shadow << " " << kept;
  }
}

double meanOf(const RenderResult& r) {
  double sum = 0;
  for (const float v : r.images.at(0).image().data) {
    EXPECT_TRUE(std::isfinite(v));
    sum += v;
  }
  return sum / double(r.images.at(0).image().data.size());
}

TEST(SoftSunRequests, AutoTreatsItAsSoft) {
  const auto engine = makeEngine();
  const RenderResult r = mustRender(*engine, sunRequest({"shadows.auto.error=0.05", "integrator.indirect=false"}));
  bool several = false, softMap = false;
  for (const auto& n : r.reply.plan()) {
    several = several || n.node().find("auto:sun: ray_traced, 8 rays") == 0;
    softMap = softMap || n.node().find("auto:sun: percentage_closer_soft") == 0;
  }
  EXPECT_TRUE(several);
  EXPECT_TRUE(softMap);
  const double reference = meanOf(mustRender(*engine, sunRequest({"shadows.path_traced=", "integrator.indirect=false"}, 256)));
  EXPECT_NEAR(meanOf(r), reference, 0.05 * reference);
}

// A bent chain finds a sun of some size by rays alone: photons are for what has none.
TEST(SoftSunRequests, MirrorsNeedNoPhotons) {
  const auto engine = makeEngine();
  const auto mirrors = [](double degrees) {
    auto s = std::make_shared<Scene>(**makeBuiltinScene("spheres"));
    for (Light& l : s->lights) {
      l.shape = {};
      l.shape.kind = LightKind::Directional;
      l.shape.angularSize = float(degrees * M_PI / 180);
    }
    s->environment = nullptr;
    EXPECT_TRUE(s->seal().ok());
    return s;
  };
  EXPECT_FALSE(classesNotCovered(*mirrors(0)).empty()) << "the scene has no mirror: the test says nothing";
  EXPECT_TRUE(classesNotCovered(*mirrors(0.5)).empty());
}

}  // namespace
}  // namespace gobo::testing
