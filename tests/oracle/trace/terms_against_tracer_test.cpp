// SPDX-License-Identifier: Apache-2.0
// The decomposition is the rendering equation: terms put together agree with the path tracer, which shares no estimator
// with them. Means over the picture, with a standard error from independent seeds.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"

namespace gobo::testing {
namespace {

struct Mean {
  double value = 0, error = 0;
};

double pictureMean(const Image& image) {
  double sum = 0;
  for (float v : image.data) sum += v;
  return sum / double(image.data.size());
}

/// Mean of the first output over seeds, with its standard error.
Mean meanOver(Engine& engine, v1::RenderRequest request, int seeds) {
  double sum = 0, squares = 0;
  for (int s = 0; s < seeds; ++s) {
    request.set_seed(uint64_t(100 + s));
    const RenderResult r = mustRender(engine, request);
    if (r.images.empty()) return {NAN, 0};
    const double m = pictureMean(r.images[0].image());
    sum += m;
    squares += m * m;
  }
  const double mean = sum / seeds;
  return {mean, std::sqrt(std::max(0.0, squares / seeds - mean * mean) / (seeds - 1))};
}

void expectSameDirect(const std::string& scene, const std::vector<std::string>& light, const std::string& technique, double tolerance) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest(scene, 40, 30, 64);
  for (const char* e : {"outputs=direct", "view_samples=4", "integrator.at_view_samples=true", "integrator.indirect=false"}) set(r, e);
  for (const auto& e : light) set(r, e);
  // Only the light under test shines.
  ASSERT_TRUE(engine->openScene(scene, scene).ok());
  const auto info = *engine->inspectScene(scene);
  for (const auto& l : info.lights()) set(r, "lights." + l.name() + ".enabled=false");
  set(r, "lights.test.shadow.path_traced=");
  const Mean traced = meanOver(*engine, r, 8);
  set(r, "lights.test.shadow." + technique);
  const Mean terms = meanOver(*engine, r, 4);
  ASSERT_GT(traced.value, 1e-4) << scene;
  const double sigma = std::sqrt(traced.error * traced.error + terms.error * terms.error);
  EXPECT_NEAR(terms.value, traced.value, 4 * sigma + tolerance * traced.value) << scene << " " << light[0] << " " << technique << " sigma " << sigma;
}

const std::vector<std::string> kPoint{"lights.test.kind=POINT", "lights.test.position=0.3,1.5,0.4", "lights.test.intensity=2"};
const std::vector<std::string> kSpot{"lights.test.kind=SPOT", "lights.test.position=0.3,1.7,0.4", "lights.test.direction=-0.2,-1,-0.1",
                                     "lights.test.outer_deg=45", "lights.test.intensity=3"};
const std::vector<std::string> kSun{"lights.test.kind=DIRECTIONAL", "lights.test.direction=-0.3,-0.4,-1", "lights.test.intensity=2"};
const std::vector<std::string> kSoftSun{"lights.test.kind=DIRECTIONAL", "lights.test.direction=-0.3,-0.4,-1", "lights.test.intensity=2",
                                        "lights.test.angular_size_deg=12"};
const std::vector<std::string> kRect{"lights.test.kind=RECT", "lights.test.position=0.2,1.6,0.2", "lights.test.direction=0,-1,0",
                                     "lights.test.width=0.3", "lights.test.height=0.2",           "lights.test.intensity=20"};
const std::vector<std::string> kDisk{"lights.test.kind=DISK", "lights.test.position=0.2,1.6,0.2", "lights.test.direction=0,-1,0.1", "lights.test.radius=0.2",
                                     "lights.test.intensity=20"};
const std::vector<std::string> kSphere{"lights.test.kind=SPHERE", "lights.test.position=0.2,1.4,0.3", "lights.test.radius=0.12", "lights.test.intensity=15"};

TEST(TermsAgainstTracer, PunctualLightsOnLambert) {
  for (const auto& light : {kPoint, kSpot, kSun}) expectSameDirect("cornell", light, "ray_traced.samples=1", 1e-4);
}

// The split U x V is exact where unshadowed or fully shadowed; in penumbrae it assumes that BRDF and visibility do not vary
// together over the light: a bound of 1 % of the mean for these lights.
TEST(TermsAgainstTracer, AreaLightsOnLambert) {
  for (const auto& light : {kRect, kDisk, kSphere, kSoftSun}) expectSameDirect("cornell", light, "ray_traced.samples=64", 0.01);
}

TEST(TermsAgainstTracer, AxisAlignedFilterKeepsTheMean) { expectSameDirect("cornell", kRect, "axis_aligned.k=3", 0.015); }

TEST(TermsAgainstTracer, GlossySurfaces) {
  std::vector<std::string> rect = kRect;
  rect[1] = "lights.test.position=0.5,4,1";
  rect[3] = "lights.test.width=1.5";
  rect[4] = "lights.test.height=1.5";
  expectSameDirect("spheres", rect, "ray_traced.samples=64", 0.02);
  expectSameDirect("spheres", kSoftSun, "ray_traced.samples=64", 0.02);
}

TEST(TermsAgainstTracer, ClassesAddUpToTheBeauty) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 32, 24, 32);
  set(r, "outputs=beauty,direct,indirect,emission");
  const RenderResult x = mustRender(*engine, r);
  ASSERT_EQ(x.images.size(), 4u);
  for (size_t i = 0; i < x.images[0].image().data.size(); ++i) {
    const double sum = double(x.images[1].image().data[i]) + x.images[2].image().data[i] + x.images[3].image().data[i];
    EXPECT_NEAR(x.images[0].image().data[i], sum, 1e-5 * (1.0 + sum));
  }
}

TEST(TermsAgainstTracer, GroupsAddUpAndGainsAreLinear) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 24, 18, 16);
  ASSERT_TRUE(engine->openScene("lights8", "lights8").ok());
  std::string outputs = "outputs=beauty";
  const auto info = *engine->inspectScene("lights8");
  for (const auto& l : info.lights()) outputs += ",group:" + l.name();
  set(r, outputs);
  const RenderResult x = mustRender(*engine, r);
  std::vector<double> sum(x.images[0].image().data.size(), 0.0);
  for (size_t k = 1; k < x.images.size(); ++k)
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += x.images[k].image().data[i];
  for (size_t i = 0; i < sum.size(); ++i) EXPECT_NEAR(x.images[0].image().data[i], sum[i], 1e-5 * (1 + sum[i]));

  set(r, "lights." + info.lights(0).name() + ".gain=3,3,3");
  const RenderResult y = mustRender(*engine, r);
  for (size_t i = 0; i < sum.size(); ++i) EXPECT_NEAR(y.images[1].image().data[i], 3.0 * x.images[1].image().data[i], 1e-5 * (1 + y.images[1].image().data[i]));
}

// A cluster folded one light at a time equals the sum of the lights each alone, in less memory.
TEST(TermsAgainstTracer, FoldOverManyLightsEqualsTheirSum) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 24, 18, 16);
  set(r, "integrator.indirect=false");
  set(r, "outputs=direct");
  set(r, "shadows.ray_traced.samples=4");
  const RenderResult apart = mustRender(*engine, r);
  set(r, "integrator.max_groups=1");
  const RenderResult folded = mustRender(*engine, r);
  int folds = 0;
  for (const auto& n : folded.reply.plan()) folds += n.node().find("(folded)") != std::string::npos && n.state() != v1::NodeReport::NOT_NEEDED;
  EXPECT_GE(folds, 2) << "unoccluded light and visibility are evaluated one light at a time";
  EXPECT_LT(folded.reply.peak_bytes(), apart.reply.peak_bytes());
  for (size_t i = 0; i < apart.images[0].image().data.size(); ++i)
    EXPECT_NEAR(folded.images[0].image().data[i], apart.images[0].image().data[i], 2e-4 * (1 + apart.images[0].image().data[i]));
}

// Editing one light of a cluster adds a difference traced apart: the mean agrees with a render where that light is alone.
TEST(TermsAgainstTracer, ClusterDifferencesAreUnbiased) {
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene("lights8", "lights8").ok());
  const std::string name = engine->inspectScene("lights8")->lights(7).name();
  v1::RenderRequest r = smallRequest("lights8", 24, 18, 64);
  set(r, "lights." + name + ".gain=4,2,1");
  const Mean single = meanOver(*engine, r, 6);
  set(r, "integrator.max_groups=2");
  const Mean difference = meanOver(*engine, r, 6);
  EXPECT_NEAR(single.value, difference.value, 4 * std::hypot(single.error, difference.error));
}

}  // namespace
}  // namespace gobo::testing
