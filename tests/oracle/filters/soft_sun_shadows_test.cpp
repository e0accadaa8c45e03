// SPDX-License-Identifier: Apache-2.0
// Shadows of a sun of some angular size by every technique that knows its size. Oracle: behind a straight edge the visible part of a uniform
// disk is a circular segment; soft maps take the square of equal solid angle, whose part is a ramp.
#include <gtest/gtest.h>

#include "filters/soft_shadow/soft_shadow.h"
#include "support/shadow_stage.h"
#include "support/sun_edge.h"
#include "support/tiny_scenes.h"

namespace gobo::test {
namespace {

constexpr double kHeight = 2.0;
constexpr int kPixels = 61;

LightShape sun(double degrees) {
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = Vec3(0, -1, 0);
  s.angularSize = float(degrees * kDegree);
  return s;
}

/// A floor under half a roof, the half at x < 0; the camera under the roof looks down on 2.4 penumbras.
ScenePtr edgeScene(double degrees, bool asSquare = false) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(3.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(tests::quad(Vec3(-3, float(kHeight), 3), Vec3(3, 0, 0), Vec3(0, 0, -6)), m.material(Vec3(0.0f))));
  LightShape light = sun(degrees);
  if (asSquare) {
    light.skyRectangle = softLight(light).size;
    light.angularSize = 0.0f;
  }
  m.light(light);
  Camera c;
  c.perspective = false;
  c.yheight = float(2.4 * kHeight * std::tan(0.5 * degrees * kDegree) / kPixels);
  c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(0, 1, 0, 1));
  m.scene.cameras.assign(1, c);
  return m.finish();
}
/// x over the penumbra's half width, of element i.
double place(const ShadowRun& r, size_t i, double degrees) { return double(r.at("P", i).x) / (kHeight * std::tan(0.5 * degrees * kDegree)); }

TEST(SoftSunShadows, RaysGiveTheSegmentOfADisk) {
  for (const double degrees : {0.53, 4.0}) {
    v1::ShadowTechnique t;
    t.mutable_ray_traced()->set_samples(1024);
    const ShadowRun r = runShadow(edgeScene(degrees), t, {kPixels, 1});
    ASSERT_TRUE(r.ok()) << r.status.toString();
    double worst = 0;
    for (size_t i = 0; i < r.size(); ++i) worst = std::max(worst, std::fabs(double(r.V()[i]) - segment(place(r, i, degrees))));
    std::printf("ray_traced, %.2f degrees: largest error %.5f\n", degrees, worst);
    EXPECT_LT(worst, 4e-3);  // 1024 stratified points, an edge through 32 rows of them: 1e-3 of spread
    EXPECT_GT(r.raysOf("visibility"), 1000u * kPixels / 2) << "one ray would do for a point";
  }
}

TEST(SoftSunShadows, OneRayIsEnoughForASunWithoutSize) {
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(64);
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(3.0f), m.material(Vec3(0.5f))));
  m.light(sun(0));
  m.camera(Vec3(0, 3, 1), Vec3(0));
  EXPECT_LE(runShadow(m.finish(), t, {8, 8}).raysOf("visibility"), 64u);
}

// Equal solid angle: the square's by its closed form against the cap's.
TEST(SoftSunShadows, TheSquareHasTheDisksSolidAngle) {
  for (const double degrees : {1e-3, 0.53, 10.0, 90.0}) {
    const SoftLight l = softLight(sun(degrees));
    EXPECT_EQ(l.size.x, l.size.y);
    const double h = 0.5 * double(l.size.x), square = 4 * std::asin(h * h / (1 + h * h)), cap = 4 * M_PI * sqr(std::sin(0.25 * degrees * kDegree));
    EXPECT_NEAR(square / cap, 1.0, 1e-5) << degrees;
    EXPECT_EQ(l.shape, SoftLight::Disk);
    EXPECT_NEAR(double(l.half.x), std::tan(0.5 * degrees * kDegree), 1e-6 * double(l.half.x));
  }
}

TEST(SoftSunShadows, MapsGiveTheRampOfThatSquare) {
  const double degrees = 10.0, side = double(softLight(sun(degrees)).size.x) * kHeight;
  for (const NamedTechnique& named : mapTechniques()) {
    if (named.name.find("soft") == std::string::npos) continue;
    v1::ShadowTechnique t = named.technique;
    t.mutable_map()->set_resolution(1024);
    const ShadowRun r = runShadow(edgeScene(degrees), t, {kPixels, 1});
    ASSERT_TRUE(r.ok()) << named.name << ": " << r.status.toString();
    double sum = 0, disk = 0;
    for (size_t i = 0; i < r.size(); ++i) {
      const double v = r.V()[i];
      ASSERT_TRUE(v >= 0 && v <= 1) << named.name;
      sum += sqr(v - std::clamp(0.5 + double(r.at("P", i).x) / side, 0.0, 1.0));
      disk += sqr(v - segment(place(r, i, degrees)));
    }
    const double ramp = std::sqrt(sum / double(r.size())), round = std::sqrt(disk / double(r.size()));
    std::printf("%-24s rms of the ramp %.4f, of the segment %.4f\n", named.name.c_str(), ramp, round);
    // One blocker depth over a plane, where all but this one are nearly exact (SoftShadowRamp).
    EXPECT_LT(ramp, named.name == "exponential_variance_soft" ? 0.15 : 0.03) << named.name;
    EXPECT_LT(round, named.name == "exponential_variance_soft" ? 0.15 : 0.018) << named.name << ": a ramp for the segment is 0.014 off";
    const ShadowRun square = runShadow(edgeScene(degrees, true), t, {kPixels, 1});
    for (size_t i = 0; i < r.size(); ++i) ASSERT_EQ(r.V()[i], square.V()[i]) << named.name << ": far from any horizon the square is all that counts";
  }
}

}  // namespace
}  // namespace gobo::test
