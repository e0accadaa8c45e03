// SPDX-License-Identifier: Apache-2.0
// angular_size_deg in requests: what it refuses, what it costs to change, and that every way to make the picture agrees.
#include <gtest/gtest.h>

#include <cmath>
#include <map>

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

std::map<std::string, Image> imagesOf(const RenderResult& r) {
  std::map<std::string, Image> out;
  for (const RenderedImage& i : r.images) out[i.output] = i.image();
  return out;
}

// The sun's shadow by few filtered rays: with its maps, and as near the path tracer's as the other technique that knows its size.
TEST(SoftSunRequests, AxisAlignedFiltersItsShadow) {
  const auto engine = makeEngine();
  const auto fence = [](const std::vector<std::string>& edits) {
    v1::RenderRequest r = smallRequest("fence", 64, 48, 1);
    set(r, "view_samples=1");
    set(r, "lights.sun.angular_size_deg=12");
    set(r, "camera.yfov_deg=12");
    for (const std::string& a : edits) set(r, a);
    return r;
  };
  const std::string outputs = "outputs=visibility:sun,shadow_rays:sun,shadow_width:sun,alpha";
  const RenderResult r = mustRender(*engine, fence({"lights.sun.shadow.axis_aligned.mean_samples=16", outputs}));
  for (const std::string& w : r.reply.warnings()) EXPECT_EQ(w.find("axis_aligned"), std::string::npos) << w;
  auto images = imagesOf(r), truth = imagesOf(mustRender(*engine, fence({"lights.sun.shadow.ray_traced.samples=2048", "outputs=visibility:sun"})));
  auto plain = imagesOf(mustRender(*engine, fence({"lights.sun.shadow.ray_traced.samples=16", "outputs=visibility:sun"})));
  double filtered = 0, noise = 0;
  size_t many = 0, wide = 0;
  for (size_t i = 0; i < images["alpha"].data.size(); ++i) {
    const float rays = images["shadow_rays:sun"].data[i], width = images["shadow_width:sun"].data[i];
    if (images["alpha"].data[i] == 0.0f) continue;
    ASSERT_TRUE(rays == 4.0f || rays == 16.0f) << rays;
    ASSERT_TRUE(std::isfinite(width) && width >= 0.0f);
    many += rays == 16.0f;
    wide += width > 0.5f;
    const float t = truth["visibility:sun"].data[i];
    filtered += (images["visibility:sun"].data[i] - t) * (images["visibility:sun"].data[i] - t);
    noise += (plain["visibility:sun"].data[i] - t) * (plain["visibility:sun"].data[i] - t);
  }
  EXPECT_GT(many, 50u);
  EXPECT_GT(wide, 50u);
  EXPECT_LT(filtered, noise) << "of as many rays where there is a penumbra, fewer elsewhere";
  // Its size is the width's unit: twice the sun, twice the filter where the published width decides.
  const auto widths = [&](const char* size) {
    return imagesOf(mustRender(*engine, fence({"lights.sun.shadow.axis_aligned.width=BAND_LIMIT", "lights.sun.shadow.axis_aligned.k=1",
                                               std::string("lights.sun.angular_size_deg=") + size, outputs})))["shadow_width:sun"]
        .data;
  };
  const auto four = widths("12"), eight = widths("24");
  double a = 0, b = 0;
  for (size_t i = 0; i < four.size(); ++i)
    if (four[i] > 1.5f && eight[i] > 1.5f) a += four[i], b += eight[i];
  EXPECT_GT(a, 0.0);
  EXPECT_NEAR(b / a, 2.0, 0.3);  // pilots of a larger sun meet other pickets

  // A direction has no penumbra: rays, as ever, and the reply says so.
  const auto delta = engine->render(fence({"lights.sun.angular_size_deg=0", "lights.sun.shadow.axis_aligned.mean_samples=16", "outputs=visibility:sun"}));
  ASSERT_TRUE(delta.ok());
  bool said = false;
  for (const std::string& w : delta->reply.warnings())
    said = said || w.find("axis_aligned does not do the kind of light 'sun': ray_traced used") != std::string::npos;
  EXPECT_TRUE(said);
  const Status refused = engine->render(fence({"lights.sun.angular_size_deg=0", "lights.sun.shadow.axis_aligned.mean_samples=16", outputs})).status();
  EXPECT_EQ(refused.code(), Code::InvalidArgument) << refused.toString();
}

// The rectangles at infinity that stand for an environment are filtered like the sun.
TEST(SoftSunRequests, AxisAlignedFiltersTheSkysRectangles) {
  const auto engine = makeEngine();
  const auto sky = [](const std::vector<std::string>& edits) {
    v1::RenderRequest r = smallRequest("cornell", 24, 18, 1);
    for (const char* a :
         {"view_samples=1", "lights.light.enabled=false", "environment.sky.turbidity=3", "environment.area_lights=6", "integrator.indirect=false"})
      set(r, a);
    for (const std::string& a : edits) set(r, a);
    return r;
  };
  const RenderResult r = mustRender(*engine, sky({"shadows.axis_aligned.mean_samples=16"}));
  for (const std::string& w : r.reply.warnings()) EXPECT_EQ(w.find("'environment"), std::string::npos) << w;  // the room's own lamp is a mesh
  bool filtered = false;
  for (const auto& [label, node] : nodesBy(r, v1::NodeReport::RUN)) filtered = filtered || label.find("axis_aligned_filter:environment/") == 0;
  EXPECT_TRUE(filtered);
  const double reference = meanOf(mustRender(*engine, sky({"shadows.ray_traced.samples=256"})));
  EXPECT_NEAR(meanOf(r), reference, 0.02 * reference);
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
