// SPDX-License-Identifier: Apache-2.0
// An environment as harmonics and disks: maps of known content give their lights back, and no flux is lost or made.
#include "techniques/transfer/environment_split.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/sobol.h"
#include "scene/environment_tents.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/icosphere.h"
#include "terms/environment_cells.h"

namespace gobo::transfer::environment_split_test {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
const double kOne = std::sqrt(4 * std::numbers::pi);

struct Sun {
  DVec3 towards;
  double radius, radiance;  // half angle in degrees
};
DVec3 towards(double elevation, double azimuth) {
  return {std::cos(elevation * kDegree) * std::cos(azimuth * kDegree), std::sin(elevation * kDegree),
          std::cos(elevation * kDegree) * std::sin(azimuth * kDegree)};
}
/// 1 everywhere, and suns: texels by 4 x 4 places.
EnvironmentPtr skyOf(const std::vector<Sun>& suns, int width = 1024, double sky = 1.0) {
  const int height = width / 2;
  Image image(width, height, 3);
  const double texel = std::numbers::pi / height;  // no place of one is farther from its middle
  std::vector<double> inside, near;
  for (const Sun& s : suns) {
    inside.push_back(std::cos(s.radius * kDegree));
    near.push_back(std::cos(s.radius * kDegree + texel));
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double value = sky;
      const double polar = (y + 0.5) * texel, azimuth = (x + 0.5) * texel - std::numbers::pi;
      const DVec3 middle(std::sin(polar) * std::cos(azimuth), std::cos(polar), std::sin(polar) * std::sin(azimuth));
      bool touched = false;
      for (size_t s = 0; s < suns.size(); ++s) touched = touched || glm::dot(middle, suns[s].towards) > near[s];
      for (int k = 0; touched && k < 16; ++k) {
        const double theta = (y + (k / 4 + 0.5) / 4) * std::numbers::pi / height,
                     phi = (x + (k % 4 + 0.5) / 4) * 2 * std::numbers::pi / width - std::numbers::pi;
        const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
        for (size_t s = 0; s < suns.size(); ++s)
          if (glm::dot(d, suns[s].towards) > inside[s]) value += suns[s].radiance / 16;
      }
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * width + x) + c] = float(value * (c == 2 ? 0.5 : 1.0));
    }
  return makeEnvironment("sky", std::move(image));
}
DVec3 fluxOf(const Environment& map) {
  const EnvironmentTents tents(map.width, map.height);
  DVec3 sum(0.0);
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) sum += tents.weight(y) * DVec3(map.texels[size_t(y) * size_t(map.width) + size_t(x)]);
  return sum;
}
double angle(const DVec3& a, const DVec3& b) { return std::acos(std::clamp(glm::dot(a, b), -1.0, 1.0)) / kDegree; }

TEST(Icosphere, HasAsManyVerticesAndNeighboursAsItShould) {
  for (int level = 0; level <= 5; ++level) {
    const Icosphere& s = icosphere(level);
    ASSERT_EQ(s.vertices.size(), size_t(10 * (1 << (2 * level)) + 2));
    int five = 0;
    double least = 1e9, most = 0;
    for (size_t v = 0; v < s.vertices.size(); ++v) {
      EXPECT_NEAR(glm::length(s.vertices[v]), 1.0, 1e-12);
      five += s.neighbours[v][5] < 0;
      for (const int n : s.neighbours[v])
        if (n >= 0) {
          EXPECT_NE(std::find(s.neighbours[size_t(n)].begin(), s.neighbours[size_t(n)].end(), int(v)), s.neighbours[size_t(n)].end());
          least = std::min(least, angle(s.vertices[v], s.vertices[size_t(n)]));
          most = std::max(most, angle(s.vertices[v], s.vertices[size_t(n)]));
        }
    }
    EXPECT_EQ(five, 12);
    if (level == 5) {
      EXPECT_NEAR(least, 1.98, 0.02);
      EXPECT_NEAR(most, 2.37, 0.02);
    }
  }
}

TEST(EnvironmentSplit, ASunIsFoundWhereItIsWhateverItsSizeAndPlace) {
  const TaskArena arena(2);
  // Radii and places that nothing was tuned on; at the zenith, near the cube's edges and corners, across the map's seam.
  for (const double radius : {0.27, 1.0, 3.0, 6.0})
    for (const DVec3& d : {towards(90, 0), towards(35.264, 45), towards(0.5, 45), towards(45, 0), towards(20, 179.9), towards(-63, 12)}) {
      const double omega = 2 * std::numbers::pi * (1 - std::cos(radius * kDegree)), radiance = 8.0 / omega;  // of 8 W/m^2 beside the sky's 4 pi
      const EnvironmentPtr map = skyOf({{d, radius, radiance}});
      const EnvironmentSplit split = splitEnvironment(*map, 5, 16, 0.02, arena);
      const DVec3 flux = fluxOf(*map);
      ASSERT_EQ(split.lights.size(), 1u) << radius << " " << d.x << " " << d.y << " " << d.z;
      const SkyDisk& sun = split.lights[0];
      const double own = flux.x - 4 * std::numbers::pi;
      EXPECT_NEAR(sun.flux.x / own, 1.0, 0.01) << radius;
      EXPECT_NEAR(sun.flux.z / sun.flux.x, 0.5, 1e-3);
      EXPECT_LT(angle(sun.direction, d), 0.05) << radius;
      EXPECT_NEAR(sun.radius / kDegree, radius, 0.05 * radius + 0.25) << radius;
      EXPECT_NEAR(sun.irradiance.x / sun.flux.x, 0.5 * (1 + std::cos(radius * kDegree)), 2e-4) << radius;  // of a disk of that size
      // Flux is kept, and what is left is the sky.
      EXPECT_NEAR(kOne * split.rest[0] + sun.flux.x, flux.x, 1e-4 * flux.x);
      EXPECT_NEAR(kOne * split.full[0], flux.x, 1e-5 * flux.x);
      for (size_t h = 1; h < 25; ++h) EXPECT_NEAR(split.rest[3 * h], 0.0, 0.01 * own) << h;
      // What cells keep, which highlights are made of, is the sky too.
      const EnvironmentCells cells(*map);
      DVec3 left(0.0);
      for (size_t i = 0; i < cells.cells.size(); ++i) left += split.left[i] * cells.cells[i].flux;
      EXPECT_NEAR(left.x + sun.flux.x, flux.x, 1e-4 * flux.x);
    }
}

TEST(EnvironmentSplit, EqualLampsAreAllFoundOrNone) {
  const TaskArena arena(2);
  for (const int count : {2, 9, 40}) {
    std::vector<Sun> suns;
    for (int i = 0; i < count; ++i) {  // a spiral: at least 20 degrees apart
      const double y = 1 - 2 * (i + 0.5) / count;
      suns.push_back({towards(std::asin(y) / kDegree, i * 137.508), 1.0, 500.0});
    }
    const EnvironmentSplit split = splitEnvironment(*skyOf(suns, 1024, 0.01), 5, 64, 0.04, arena);
    EXPECT_EQ(split.lights.size(), count == 40 ? 0u : size_t(count));
    for (const SkyDisk& l : split.lights) {
      double nearest = 180;
      for (const Sun& s : suns) nearest = std::min(nearest, angle(l.direction, s.towards));
      EXPECT_LT(nearest, 0.1);
    }
  }
}

TEST(EnvironmentSplit, WhatHasNoPeakKeepsItsHarmonics) {
  const TaskArena arena(2);
  std::vector<EnvironmentPtr> maps{skyOf({}), constantEnvironment(Vec3(0.0f)), constantEnvironment(Vec3(1e20f))};
  Image broad(256, 128, 3);  // overcast with a bright side of 30 degrees
  for (int y = 0; y < 128; ++y)
    for (int x = 0; x < 256; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / 128, phi = (x + 0.5) * std::numbers::pi / 128 - std::numbers::pi;
      const double t = angle(DVec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)), towards(50, 30)) / 30;
      for (size_t c = 0; c < 3; ++c) broad.data[3 * size_t(y * 256 + x) + c] = float(1 + 2 * std::exp(-0.5 * t * t));
    }
  maps.push_back(makeEnvironment("overcast", std::move(broad)));
  for (const EnvironmentPtr& map : maps) {
    const EnvironmentSplit split = splitEnvironment(*map, 5, 16, 0.02, arena);
    EXPECT_TRUE(split.lights.empty());
    EXPECT_EQ(split.rest, split.full);
    for (const double c : split.full) EXPECT_TRUE(std::isfinite(c));
  }
}

TEST(EnvironmentSplit, LightsComeAndGoGradually) {
  const TaskArena arena(2);
  double last = 0;
  int steps = 0;
  for (double power = 0.1; power < 2; power += 0.02) {  // of a sky of 4 pi: from under 1 % to 13 %
    const double omega = 2 * std::numbers::pi * (1 - std::cos(1.0 * kDegree));
    const EnvironmentSplit split = splitEnvironment(*skyOf({{towards(40, 70), 1.0, power / omega}}, 512), 5, 16, 0.03, arena);
    const double taken = split.lights.empty() ? 0.0 : split.lights[0].flux.x / power;
    EXPECT_GT(taken, last - 0.01);
    EXPECT_LT(taken, last + 0.12);
    steps += taken > 0.02 && taken < 0.98;
    last = taken;
  }
  EXPECT_GT(steps, 8);
  EXPECT_GT(last, 0.97);
}

// Lamps too broad for one peak: a softbox of 20 to 34 degrees is one light, of about its size, and what is left is what harmonics hold; with a lamp in front of
// it both are.
TEST(EnvironmentSplit, ABroadLampIsOneLight) {
  const TaskArena arena(2);
  for (const auto& [radius, at] : {std::pair(10.0, towards(35, 20)), std::pair(14.0, towards(-5, 133)), std::pair(17.0, towards(80, 250))}) {
    const EnvironmentPtr map = skyOf({{at, radius, 40.0}}, 512);
    const EnvironmentSplit split = splitEnvironment(*map, 5, 16, 0.02, arena);
    const double omega = 2 * std::numbers::pi * (1 - std::cos(radius * kDegree)), flux = 40 * omega;
    ASSERT_FALSE(split.lights.empty());
    DVec3 sum(0.0), left(split.rest[0], split.rest[1], split.rest[2]);
    for (const SkyDisk& light : split.lights) sum += light.flux;
    EXPECT_NEAR(sum.x / flux, 1.0, 0.06) << radius;
    const SkyDisk& most = split.lights[0];
    EXPECT_GT(most.flux.x / flux, 0.6) << radius;  // the rest of it was taken for a peak of its own
    EXPECT_LT(angle(most.direction, at), 1.5) << radius;
    EXPECT_NEAR(most.radius / kDegree, radius, 0.35 * radius) << radius;
    const double whole = std::sqrt(4 * std::numbers::pi);  // flux is the first coefficient times it
    EXPECT_NEAR((whole * left.x + sum.x) / fluxOf(*map).x, 1.0, 1e-4);
  }
  const DVec3 middle = towards(35, 20);
  const EnvironmentSplit both = splitEnvironment(*skyOf({{middle, 15.0, 20.0}, {middle, 0.7, 20000.0}}, 1024), 5, 16, 0.02, arena);
  ASSERT_GE(both.lights.size(), 2u);
  EXPECT_NEAR(both.lights[0].radius / kDegree + both.lights[1].radius / kDegree, 15.7, 5.0);
}

TEST(EnvironmentSplit, ThreadsDoNotMatter) {
  const EnvironmentPtr map = skyOf({{towards(40, 70), 1.0, 300.0}, {towards(10, 200), 2.0, 90.0}}, 256);
  const EnvironmentSplit a = splitEnvironment(*map, 6, 16, 0.02, TaskArena(1)), b = splitEnvironment(*map, 6, 16, 0.02, TaskArena(3));
  EXPECT_EQ(a.rest, b.rest);
  ASSERT_EQ(a.lights.size(), b.lights.size());
  for (size_t i = 0; i < a.lights.size(); ++i) EXPECT_EQ(a.lights[i].direction, b.lights[i].direction);
}

}  // namespace
}  // namespace gobo::transfer::environment_split_test
