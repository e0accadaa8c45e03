// SPDX-License-Identifier: Apache-2.0
// environment.area_lights against the path tracer, which shares nothing with it but the map: pictures of direct light, turns of the map,
// and what the request may ask for.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "support/engines.h"

namespace gobo::testing {
namespace {

v1::RenderRequest directRequest(const std::string& scene, int width = 48, int height = 32) {
  v1::RenderRequest r = smallRequest(scene, width, height, 4);
  for (const char* e : {"outputs=direct", "view_samples=4", "integrator.at_view_samples=true", "integrator.max_bounces=0"}) set(r, e);
  return r;
}
/// Only the environment shines.
void lightsOff(Engine& engine, v1::RenderRequest& r) {
  ASSERT_TRUE(engine.openScene(r.scene(), r.scene()).ok());
  const auto info = *engine.inspectScene(r.scene());
  for (const auto& l : info.lights())
    if (l.name() != "environment") set(r, "lights." + l.name() + ".enabled=false");
}
std::vector<float> picture(Engine& engine, const v1::RenderRequest& r) {
  const RenderResult result = mustRender(engine, r);
  return result.images.empty() ? std::vector<float>{} : result.images[0].image().data;
}
std::vector<float> truth(Engine& engine, v1::RenderRequest r, int spp) {
  r.mutable_environment()->clear_area_lights();
  r.mutable_shadows()->mutable_path_traced();
  set(r, "halt.spp=" + std::to_string(spp));
  return picture(engine, r);
}
double mean(const std::vector<float>& a) {
  double sum = 0;
  for (float v : a) sum += v;
  return sum / double(a.size());
}
double rms(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (double(a[i]) - b[i]) * (double(a[i]) - b[i]);
  return std::sqrt(sum / double(a.size()));
}

// Uniform light is ambient occlusion weighted by the cosine: the path tracer's direct light divided by pi and albedo. RMSE by the mean of the picture.
TEST(EnvironmentAreaLights, UniformLightIsAmbientOcclusion) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("fence");
  set(r, "environment.constant=1,1,1");
  lightsOff(*engine, r);
  const std::vector<float> traced = truth(*engine, r, 1024);
  double before = 1;
  for (const int n : {10, 45}) {
    set(r, "environment.area_lights=" + std::to_string(n));
    set(r, "shadows.ray_traced.samples=16");
    const double error = rms(picture(*engine, r), traced) / mean(traced);
    std::printf("uniform light, %d area lights: RMSE %.4f of the mean\n", n, error);
    EXPECT_LT(error, n == 10 ? 0.06 : 0.028);   // hard shadows from the centres: 0.092 and 0.040
    EXPECT_LT(error, before);
    before = error;
  }
}

TEST(EnvironmentAreaLights, ASkyWithItsSun) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("fence");
  set(r, "environment.sky.sun_direction=0.4,0.5,0.3");
  lightsOff(*engine, r);
  const std::vector<float> traced = truth(*engine, r, 1024);
  set(r, "environment.area_lights=45");
  set(r, "shadows.ray_traced.samples=16");
  const double error = rms(picture(*engine, r), traced) / mean(traced);
  std::printf("sky, 45 area lights: RMSE %.4f of the mean\n", error);
  EXPECT_LT(error, 0.05);
  // One light has no size that tells the sun from the sky: what is left is ambient, and the plan says that it is approximate.
  set(r, "environment.area_lights=1");
  const RenderResult one = mustRender(*engine, r);
  EXPECT_GT(rms(one.images[0].image().data, traced) / mean(traced), error);
  bool approximate = false;
  for (const auto& n : one.reply.plan()) approximate = approximate || n.node() == "direct:environment map";
  EXPECT_TRUE(approximate);
}

// Gloss sees the squares and not their centres: one direction on a smooth sphere is a point of thousands of times the mean (RMSE of 1 to 3).
// The sun of this map is about one texel, looked up bilinearly: a peak, of which a square with the same flux and moments has half the height.
// Its highlights are smaller than a view sample's distance, so that the RMSE compares peaks: about a half is what squares can do.
TEST(EnvironmentAreaLights, SmoothSurfacesSeeSquares) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("spheres");
  set(r, "environment.sky.sun_direction=0.4,0.5,0.3");
  lightsOff(*engine, r);
  const std::vector<float> traced = truth(*engine, r, 1024);
  set(r, "environment.area_lights=45");
  set(r, "shadows.ray_traced.samples=16");
  const double error = rms(picture(*engine, r), traced) / mean(traced);
  std::printf("glossy spheres under a sky, 45 area lights: RMSE %.4f of the mean\n", error);
  EXPECT_LT(error, 0.6);
}

// The lights are fitted in the map's own axes and turned with it: equal steps change the picture by about equal amounts, nothing pops.
TEST(EnvironmentAreaLights, TurningTheMapChangesThePictureSteadily) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("fence", 32, 24);
  set(r, "environment.sky.sun_direction=0.4,0.5,0.3");
  lightsOff(*engine, r);
  set(r, "shadows.ray_traced.samples=64");
  std::vector<float> before, tracedBefore;
  double worst = 0, ratio = 0;
  for (int step = 0; step < 8; ++step) {
    set(r, "environment.rotation_deg=" + std::to_string(2 * step));
    r.mutable_environment()->clear_area_lights();
    const std::vector<float> traced = truth(*engine, r, 512);
    set(r, "environment.area_lights=30");
    const std::vector<float> now = picture(*engine, r);
    if (step > 0) {
      const double change = rms(now, before), true_ = rms(traced, tracedBefore);
      worst = std::max(worst, change / true_);
      ratio += change / true_ / 7;
    }
    before = now;
    tracedBefore = traced;
  }
  std::printf("steps of 2 degrees: change by the truth's change, mean %.3f, worst %.3f\n", ratio, worst);
  EXPECT_LT(worst, 1.2);   // hard shadows from the centres: 1.43
}

TEST(EnvironmentAreaLights, BlackMapsAndConflictsAreHandled) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("fence", 16, 12);
  set(r, "environment.constant=0,0,0");
  lightsOff(*engine, r);
  for (const char* field : {"environment.area_lights=45", "environment.extract_lights=5"}) {
    v1::RenderRequest e = r;
    set(e, field);
    EXPECT_EQ(mean(picture(*engine, e)), 0.0) << field;
  }
  set(r, "environment.area_lights=45");
  set(r, "environment.extract_lights=5");
  const auto both = engine->render(r);
  ASSERT_FALSE(both.ok());
  EXPECT_EQ(both.status().code(), Code::InvalidArgument);
  EXPECT_EQ(both.status().location(), "request.environment.area_lights");
}

// Terms of many lights in a large picture (here 128 lights x 393216 view samples x 16 bytes = 805 MB) are made and dropped one by one.
TEST(EnvironmentAreaLights, ManyLightsDoNotHoldTheirTermsAtOnce) {
  const auto engine = makeEngine();
  v1::RenderRequest r = directRequest("fence", 384, 256);
  set(r, "environment.constant=1,1,1");
  lightsOff(*engine, r);
  set(r, "environment.area_lights=128");
  set(r, "shadows.shadow_map=");
  set(r, "shadows.map.resolution=64");
  uint32_t folded = 0;
  const RenderResult result = mustRender(*engine, r);
  for (const auto& n : result.reply.plan()) {
    EXPECT_NE(n.node(), "unoccluded:environment/0") << "a term of its own in the store";
    if (n.node() == "direct_unoccluded (folded)" && n.state() == v1::NodeReport::RUN) folded += n.count();
  }
  EXPECT_EQ(folded, 128u);
  for (const float v : result.images[0].image().data) ASSERT_TRUE(std::isfinite(v));
  EXPECT_GT(mean(result.images[0].image().data), 0.05);
}

}  // namespace
}  // namespace gobo::testing
