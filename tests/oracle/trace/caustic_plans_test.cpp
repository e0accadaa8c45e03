// SPDX-License-Identifier: Apache-2.0
// Caustics in plans: what a request switches on, what the reply says of it, how passes extend, and how they add up with gains,
// outputs by class and lobe, and the certificate.
#include <gtest/gtest.h>

#include <cmath>

#include "plan/planner.h"
#include "support/engines.h"

namespace gobo::testing::caustic_plans_test {
namespace {

v1::RenderRequest spheres(int spp = 16) {
  v1::RenderRequest r = smallRequest("spheres", 24, 16, spp);
  for (const char* a : {"lights.lamp.kind=POINT", "lights.lamp.position=0,6,2", "lights.lamp.intensity=200", "integrator.caustic_photons=4000",
                        "integrator.caustic_radius=0.02", "integrator.max_bounces=5"})
    set(r, a);
  return r;
}

double mean(const Image& image) {
  double s = 0;
  for (float v : image.data) s += v / double(image.data.size());
  return s;
}

TEST(CausticPlans, OnlyWhereThereIsSomethingToFind) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spheres();
  const RenderResult on = mustRender(*engine, r);
  const auto row = nodesBy(on, v1::NodeReport::RUN).at("caustics");
  EXPECT_TRUE(row.approximate());
  EXPECT_NE(row.reason().find("radius of"), std::string::npos) << row.reason();
  EXPECT_EQ(row.samples(), 16u);
  EXPECT_EQ(on.reply.path_classes_missing_size(), 0);

  set(r, "integrator.caustic_photons=0");
  const RenderResult off = mustRender(*engine, r);
  EXPECT_TRUE(nodesBy(off, v1::NodeReport::PRUNED).at("caustics").approximate());
  ASSERT_EQ(off.reply.path_classes_missing_size(), 1);
  EXPECT_EQ(off.reply.path_classes_missing(0), "point lights through mirrors and smooth refraction (caustics), on surfaces");
  EXPECT_GT(mean(on.images[0].image()), mean(off.images[0].image()));

  v1::RenderRequest area = spheres();
  set(area, "lights.lamp.kind=SPHERE");
  set(area, "lights.lamp.radius=0.2");
  EXPECT_EQ(nodesBy(mustRender(*engine, area), v1::NodeReport::PRUNED).at("caustics").reason(), "the scene has no point, spot or hard directional light");
  v1::RenderRequest dull = spheres();
  dull.set_scene("cornell");
  EXPECT_EQ(nodesBy(mustRender(*engine, dull), v1::NodeReport::PRUNED).at("caustics").reason(), "no surface is a mirror or smooth glass");
  EXPECT_FALSE(nodesBy(mustRender(*engine, dull), v1::NodeReport::PRUNED).at("caustics").approximate());
  v1::RenderRequest direct = spheres();
  set(direct, "integrator.indirect=false");
  EXPECT_TRUE(nodesBy(mustRender(*engine, direct), v1::NodeReport::PRUNED).at("caustics").approximate());
}

TEST(CausticPlans, PassesExtendToTheSameBits) {
  const auto warm = makeEngine(), cold = makeEngine(256ull << 20, {}, 7);
  mustRender(*warm, spheres(16));
  const RenderResult extended = mustRender(*warm, spheres(48));
  EXPECT_NE(nodesBy(extended, v1::NodeReport::RUN).at("caustics").reason().find("extended from 16 samples"), std::string::npos);
  EXPECT_EQ(firstDifference(extended, mustRender(*cold, spheres(48))), "");
}

TEST(CausticPlans, PartsAddUp) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spheres();
  set(r, "outputs=beauty,emission,direct,indirect,diffuse,specular,group:lamp");
  const RenderResult a = mustRender(*engine, r);
  set(r, "lights.lamp.gain=3,3,3");
  const RenderResult b = mustRender(*engine, r);
  set(r, "lights.lamp.gain=1,1,1");
  set(r, "integrator.caustic_photons=0");
  const RenderResult none = mustRender(*engine, r);
  const auto at = [](const RenderResult& x, int k, size_t i) { return double(x.images[size_t(k)].image().data[i]); };
  double caustics = 0;
  for (size_t i = 0; i < a.images[0].image().data.size(); ++i) {
    const double beauty = at(a, 0, i);
    EXPECT_NEAR(at(a, 1, i) + at(a, 2, i) + at(a, 3, i), beauty, 1e-4 * (1 + beauty));
    EXPECT_NEAR(at(a, 1, i) + at(a, 4, i) + at(a, 5, i), beauty, 1e-4 * (1 + beauty));
    EXPECT_NEAR(at(b, 0, i) - beauty, 2 * at(a, 6, i), 1e-4 * (1 + beauty));
    EXPECT_NEAR(at(a, 3, i) - at(none, 3, i), beauty - at(none, 0, i), 1e-4 * (1 + beauty)) << "all of it is indirect";
    caustics += beauty - at(none, 0, i);
  }
  EXPECT_GT(caustics, 0.0);
}

TEST(CausticPlans, CertificateHasThemInItsReference) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spheres(64);
  set(r, "certificate.pixel_fraction=1");
  const auto on = mustRender(*engine, r).reply.certificate();
  EXPECT_EQ(on.not_covered_size(), 0);
  set(r, "integrator.caustic_photons=0");
  const auto off = mustRender(*engine, r).reply.certificate();
  EXPECT_EQ(off.not_covered_size(), 0) << "the reference has them whether or not the picture has";
  EXPECT_GT(off.rmse(), on.rmse());
}

TEST(CausticPlans, NeverMoreLightWithoutAChain) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spheres();
  r.set_scene("cornell");
  const RenderResult on = mustRender(*engine, r);
  set(r, "integrator.caustic_photons=0");
  EXPECT_EQ(firstDifference(on, mustRender(*engine, r)), "");
}

}  // namespace
}  // namespace gobo::testing::caustic_plans_test
