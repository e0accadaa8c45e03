// SPDX-License-Identifier: Apache-2.0
// A thin lens against its closed form: the edge of a half-plane that is out of focus is the cumulated disk of confusion.
#include <gtest/gtest.h>

#include <cmath>

#include "support/tiny_scenes.h"

namespace gobo::thin_lens_test {
namespace {

using namespace tests;

constexpr int kWidth = 48, kHeight = 12;

/// A glowing half-plane x < 0 at `distance` before a camera at the origin that looks along -z.
ScenePtr edge(float distance, float yfov) {
  SceneMaker m;
  const int lamp = m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(1.0f); });
  m.instance(m.mesh(quad(Vec3(-200.0f, -200.0f, -distance), Vec3(200.0f, 0, 0), Vec3(0, 400.0f, 0)), lamp));
  m.camera(Vec3(0.0f), Vec3(0, 0, -1), yfov);
  return m.finish();
}

/// Share of the unit disk at x > u.
double beyond(double u) {
  u = std::clamp(u, -1.0, 1.0);
  return 0.5 - (u * std::sqrt(1.0 - u * u) + std::asin(u)) / M_PI;
}

/// What a column of pixels shows: `radius` of the disk of confusion and the edge's place in pixels.
double expected(int x, double radius, double place) {
  constexpr int kSteps = 2000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double at = x + (i + 0.5) / kSteps - place;
    sum += radius > 0 ? beyond(at / radius) : double(at < 0);
  }
  return sum / kSteps;
}

std::vector<double> profile(const Traced& t, uint32_t blocks) {
  const auto tracer = t.tracer();
  std::vector<double> mean(kWidth, 0.0);
  uint64_t rays = 0, dropped = 0;
  std::vector<double> slots(3 * 16);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      std::fill(slots.begin(), slots.end(), 0.0);
      for (uint32_t b = 0; b < blocks; ++b) tracer->traceBlock(x, y, b, slots.data(), rays, dropped);
      mean[size_t(x)] += slots[0] / (double(blocks) * 16 * kHeight);
    }
  return mean;
}

struct Case {
  float distance, focus, radius;
  bool perspective;
};

TEST(ThinLens, AnEdgeIsTheCumulatedDiskOfConfusion) {
  for (const Case& k : {Case{2.0f, 4.0f, 0.3f, true}, Case{9.0f, 3.0f, 0.2f, true}, Case{3.0f, 3.0f, 0.5f, true}, Case{2.0f, 5.0f, 0.2f, false},
                        Case{6.0f, 2.0f, 0.05f, false}}) {
    const float yfov = 0.5f, yheight = 1.0f;
    Traced t(edge(k.distance, yfov), kWidth, kHeight);
    t.settings.cover = PathClass::Emission;
    Camera& c = t.settings.camera;
    c.perspective = k.perspective;
    c.yheight = yheight;
    c.optics.lensRadius = k.radius;
    c.optics.focus = k.focus;
    // Width on the edge's plane of a pixel, and of the cone of rays that meet in the plane of focus.
    const double pixel = (k.perspective ? 2.0 * std::tan(0.25) * k.distance : double(yheight)) / kHeight;
    const double disk = k.radius * std::fabs(1.0 - double(k.distance) / double(k.focus)) / pixel;
    const std::vector<double> seen = profile(t, 64);
    for (int x = 0; x < kWidth; ++x) EXPECT_NEAR(seen[size_t(x)], expected(x, disk, kWidth / 2.0), 0.006) << x << ": " << k.distance << " " << k.focus;
    // It is a blur, where it should be one.
    const double beside = seen[kWidth / 2] - seen[kWidth / 2 - 1];
    if (disk == 0) EXPECT_NEAR(beside, -1.0, 1e-3);
    else EXPECT_GT(beside, -0.9);
  }
}

TEST(ThinLens, ItIsFarFromTheOriginWhatItIsThere) {
  // The lens turns and moves with its camera: the whole scene turned about z by 90 degrees and far away shows its columns as rows.
  const double shift = 3000.0;
  SceneMaker m;
  const int lamp = m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(1.0f); });
  m.instance(m.mesh(quad(Vec3(-200.0f, -200.0f, -2.0f), Vec3(400.0f, 0, 0), Vec3(0, 200.0f, 0)), lamp), translate(Vec3(float(shift), 0, 0)));
  m.camera(Vec3(float(shift), 0, 0), Vec3(float(shift), 0, -1), 0.5f);
  Traced t(m.finish(), kHeight, kHeight);
  t.settings.cover = PathClass::Emission;
  t.settings.camera.optics.lensRadius = 0.3f;
  t.settings.camera.optics.focus = 4.0f;
  const double pixel = 2.0 * std::tan(0.25) * 2.0 / kHeight, disk = 0.15 / pixel;
  const auto tracer = t.tracer();
  uint64_t rays = 0, dropped = 0;
  for (int y = 0; y < kHeight; ++y) {
    double sum = 0;
    for (int x = 0; x < kHeight; ++x) {
      double slots[48] = {};
      for (uint32_t b = 0; b < 16; ++b) tracer->traceBlock(x, y, b, slots, rays, dropped);
      sum += slots[0] / (256.0 * kHeight);
    }
    EXPECT_NEAR(sum, 1.0 - expected(y, disk, kHeight / 2.0), 0.008) << y;  // below is bright
  }
}

}  // namespace
}  // namespace gobo::thin_lens_test
