// SPDX-License-Identifier: Apache-2.0
// An environment map as N square area lights: flux, irradiance without occlusion against the map's own integral in double (digest eq. 2.13),
// single sources, uniform light, broken maps, steadiness under turns, and the ambient remainder.
#include "terms/fit_area_lights.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <limits>
#include <numbers>

#include "scene/environment_tents.h"

namespace gobo {
namespace {

Environment mapOf(int width, int height, const std::function<Vec3(const DVec3& direction)>& radiance) {
  Environment e;
  e.width = width;
  e.height = height;
  std::vector<Vec3> texels;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) texels.push_back(radiance(DVec3(e.toDirection(Vec2((x + 0.5f) / width, (y + 0.5f) / height)))));
  e.texels = Array<Vec3>(std::move(texels));
  return e;
}
/// What the bilinear look-up makes of texels, by row.
std::vector<double> texelWeights(const Environment& e) {
  const EnvironmentTents tents(e.width, e.height);
  std::vector<double> out;
  for (int y = 0; y < e.height; ++y) out.push_back(tents.weight(y));
  return out;
}

DVec3 fluxOf(const Environment& e) {
  DVec3 sum(0.0);
  const std::vector<double> weight = texelWeights(e);
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x) sum += weight[size_t(y)] * DVec3(e.texels[size_t(y) * e.width + x]);
  return sum;
}
/// E(n) of the map: every texel at its middle, which is within 1e-4 for the smooth and the small maps here.
std::vector<DVec3> irradiancesOf(const Environment& e, const std::vector<DVec3>& normals) {
  std::vector<DVec3> sums(normals.size(), DVec3(0.0));
  const std::vector<double> weight = texelWeights(e);
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x) {
      const DVec3 d(e.toDirection(Vec2((x + 0.5f) / e.width, (y + 0.5f) / e.height))), light = weight[size_t(y)] * DVec3(e.texels[size_t(y) * e.width + x]);
      for (size_t i = 0; i < normals.size(); ++i)
        if (const double c = normals[i].x * d.x + normals[i].y * d.y + normals[i].z * d.z; c > 0) sums[i] += c * light;
    }
  return sums;
}
DVec3 irradianceOf(const Environment& e, const DVec3& n) { return irradiancesOf(e, {n})[0]; }
DVec3 irradianceOf(const AreaLightFit& fit, const DVec3& n) {
  DVec3 sum = fit.remainderIrradiance(n);
  for (const AreaLight& l : fit.lights) sum += l.irradiance * std::max(glm::dot(n, l.direction), 0.0);
  return sum;
}
std::vector<DVec3> normals(int count) {
  std::vector<DVec3> out;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / count, phi = i * 2.399963229728653, r = std::sqrt(1.0 - z * z);
    out.push_back(DVec3(r * std::cos(phi), z, r * std::sin(phi)));
  }
  return out;
}
double degrees(const DVec3& a, const DVec3& b) { return std::acos(std::min(glm::dot(a, b), 1.0)) * 180.0 / std::numbers::pi; }

/// RMS over normals and channels, by the RMS of the truth.
double relativeError(const Environment& e, const AreaLightFit& fit, int count = 200) {
  double error = 0, size = 0;
  const std::vector<DVec3> at = normals(count), truths = irradiancesOf(e, at);
  for (size_t i = 0; i < at.size(); ++i) {
    const DVec3 truth = truths[i], d = irradianceOf(fit, at[i]) - truth;
    error += glm::dot(d, d);
    size += glm::dot(truth, truth);
  }
  return std::sqrt(error / size);
}

Environment sky() {
  SkyParameters p;
  p.sunDirection = glm::normalize(Vec3(0.4f, 0.5f, 0.3f));
  return *skyEnvironment(p, 256);
}
/// A dim room with two windows of different colour, a lamp, and a floor that reflects.
Environment room() {
  return mapOf(256, 128, [](const DVec3& d) {
    Vec3 c(0.05f, 0.06f, 0.07f);
    if (d.y < -0.3) c = Vec3(0.3f, 0.2f, 0.1f) * float(0.7 + 0.3 * std::sin(7 * d.x) * std::cos(5 * d.z));
    if (d.x > 0.6 && std::fabs(d.y - 0.2) < 0.25 && std::fabs(d.z) < 0.5) c = Vec3(6, 7, 9);
    if (d.z < -0.8 && std::fabs(d.y) < 0.2 && std::fabs(d.x + 0.2) < 0.2) c = Vec3(3, 2, 1);
    if (d.y > 0.99) c = Vec3(20, 18, 12);
    return c;
  });
}
Environment squarePatch(const DVec3& axis, double half, const Vec3& inside, const Vec3& outside) {
  const double across = std::hypot(axis.x, axis.z);
  const DVec3 right(axis.z / across, 0, -axis.x / across), up = glm::cross(axis, right);
  return mapOf(512, 256, [=](const DVec3& d) {
    const double z = glm::dot(d, axis);
    return z > 0 && std::fabs(glm::dot(d, right)) < half * z && std::fabs(glm::dot(d, up)) < half * z ? inside : outside;
  });
}

TEST(FitAreaLights, FluxIsTheMaps) {
  for (const Environment& e : {sky(), room(), *constantEnvironment(Vec3(0.2f, 1, 3))})
    for (const int n : {1, 7, 45, 128}) {
      const AreaLightFit fit = fitAreaLights(e, n);
      ASSERT_LE(int(fit.lights.size()), n);
      DVec3 sum = fit.remainderFlux();
      for (const AreaLight& l : fit.lights) {
        sum += l.irradiance;
        EXPECT_NEAR(glm::length(l.direction), 1.0, 1e-12);
        EXPECT_NEAR(glm::dot(l.direction, l.right), 0.0, 1e-12);
        EXPECT_NEAR(glm::length(l.right), 1.0, 1e-12);
        EXPECT_GT(l.angularSize, 0.0);
        for (int k = 0; k < 3; ++k) EXPECT_GE(l.irradiance[k], 0.0);
      }
      const DVec3 truth = fluxOf(e);
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(sum[k], truth[k], 1e-5 * truth[k]) << n;  // asked for: 0.1 %; by construction but for rounding
    }
}

TEST(FitAreaLights, IrradianceComesNearerWithEveryLight) {
  const struct {
    const char* name;
    Environment map;
    double bound[4];
  } cases[] = {// About twice what this fit measures.
               {"sky", sky(), {0.045, 0.012, 0.008, 0.006}},
               {"room", room(), {0.045, 0.016, 0.016, 0.01}}};
  for (const auto& c : cases) {
    double errors[4];
    const int counts[4] = {10, 30, 45, 60};
    for (int i = 0; i < 4; ++i) {
      errors[i] = relativeError(c.map, fitAreaLights(c.map, counts[i]));
      EXPECT_LT(errors[i], c.bound[i]) << c.name << " " << counts[i];
    }
    std::printf("%s: irradiance error of 10, 30, 45, 60 lights: %.4f %.4f %.4f %.4f\n", c.name, errors[0], errors[1], errors[2], errors[3]);
    EXPECT_LT(errors[3], errors[1]) << c.name;
    EXPECT_LT(errors[1], errors[0]) << c.name;
  }
}

TEST(FitAreaLights, UniformLightIsUniform) {
  const Environment white = *constantEnvironment(Vec3(1.0f));
  for (const auto& [count, worst] : {std::pair{30, 0.06}, std::pair{45, 0.05}, std::pair{128, 0.02}}) {
    const AreaLightFit fit = fitAreaLights(white, count);
    EXPECT_EQ(int(fit.lights.size()), count) << "the sphere is shared out among all lights";
    double squares = 0;
    for (const DVec3& n : normals(500)) {
      const double e = irradianceOf(fit, n).x;
      squares += (e - std::numbers::pi) * (e - std::numbers::pi) / 500;
      EXPECT_NEAR(e, std::numbers::pi, worst * std::numbers::pi);
    }
    EXPECT_LT(std::sqrt(squares), 0.012 * std::numbers::pi) << count;
  }
}

TEST(FitAreaLights, OneTexelIsOneLightInItsPlace) {
  for (const auto& [x, y] : {std::pair{0, 100}, std::pair{700, 1}, std::pair{512, 256}, std::pair{1023, 400}, std::pair{640, 320}}) {
    Environment e;
    e.width = 1024;
    e.height = 512;
    std::vector<Vec3> texels(size_t(1024) * 512, Vec3(0.0f));
    texels[size_t(y) * 1024 + x] = Vec3(1000, 900, 800);
    e.texels = Array<Vec3>(std::move(texels));
    const AreaLightFit fit = fitAreaLights(e, 45);
    ASSERT_EQ(fit.lights.size(), 1u) << x << " " << y;
    EXPECT_LT(degrees(fit.lights[0].direction, DVec3(e.toDirection(Vec2((x + 0.5f) / 1024, (y + 0.5f) / 512)))), 0.02);
    EXPECT_LT(fit.lights[0].angularSize, 1.5 * std::numbers::pi / 512) << "no larger than the texel's tent";
    EXPECT_GT(fit.lights[0].angularSize, 0.5 * std::numbers::pi / 512 * std::max(0.4, std::sin(std::numbers::pi * (y + 0.5) / 512)));
    EXPECT_NEAR(fit.lights[0].irradiance.x, 1000 * texelWeights(e)[size_t(y)], 1e-6 * 1000 * texelWeights(e)[size_t(y)]);
    EXPECT_EQ(fit.remainderFlux(), DVec3(0.0));
  }
}

// A sun of 3 degrees with a quarter of the light in a uniform sky: the sky near it must not widen it. (Nearest-centre clusters give 8 degrees.)
TEST(FitAreaLights, ASunKeepsItsSizeInASky) {
  const DVec3 axis = glm::normalize(DVec3(0.5, 0.6, -0.4));
  const double half = std::tan(1.5 * std::numbers::pi / 180);
  const Environment e = squarePatch(axis, half, Vec3(1500.0f), Vec3(1.0f));
  const std::vector<double> weight = texelWeights(e);
  DVec3 centre(0.0);  // of the texels that the patch became: they are 0.7 degrees wide
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x)
      if (e.texels[size_t(y) * e.width + x].x > 1) centre += weight[size_t(y)] * DVec3(e.toDirection(Vec2((x + 0.5f) / e.width, (y + 0.5f) / e.height)));
  centre = glm::normalize(centre);
  for (const int n : {10, 45}) {
    const AreaLightFit fit = fitAreaLights(e, n);
    EXPECT_LT(degrees(fit.lights[0].direction, centre), 0.1) << n;
    EXPECT_NEAR(fit.lights[0].angularSize, 2 * half, 0.25 * 2 * half) << n;
  }
}

TEST(FitAreaLights, ASquareIsFoundAsItIs) {
  for (const double half : {0.1, 0.2, 0.5})
    for (const DVec3& axis :
         {glm::normalize(DVec3(1, 0.2, 0.1)), glm::normalize(DVec3(1, 1, 1)), glm::normalize(DVec3(-0.3, -0.7, 0.6))}) {  // across edges of the cube
      const AreaLightFit fit = fitAreaLights(squarePatch(axis, half, Vec3(2.0f), Vec3(0.0f)), 1);
      ASSERT_EQ(fit.lights.size(), 1u);
      EXPECT_LT(degrees(fit.lights[0].direction, axis), 0.3);
      EXPECT_NEAR(fit.lights[0].angularSize, 2 * half, 0.05 * 2 * half);
      EXPECT_NEAR(fit.lights[0].irradiance.x, 2.0 * fit.lights[0].solidAngle(), 0.1 * fit.lights[0].irradiance.x) << "radiance: flux by solid angle";
    }
}

TEST(FitAreaLights, NoMoreLightsThanAreOfUse) {
  EXPECT_TRUE(fitAreaLights(*constantEnvironment(Vec3(0.0f)), 45).lights.empty());
  EXPECT_EQ(fitAreaLights(*constantEnvironment(Vec3(0.0f)), 45).remainderIrradiance(DVec3(0, 1, 0)), DVec3(0.0));
  // Three texels, and a sky that is not worth shadow maps (1e-6 of the flux): it is the remainder's.
  Environment three = mapOf(1024, 512, [](const DVec3&) { return Vec3(1.0f); });
  std::vector<Vec3> texels(three.texels.begin(), three.texels.end());
  for (const size_t i : {100000u, 200345u, 300777u}) texels[i] = Vec3(1e11f);
  three.texels = Array<Vec3>(std::move(texels));
  const AreaLightFit fit = fitAreaLights(three, 64);
  EXPECT_EQ(fit.lights.size(), 3u);
  EXPECT_NEAR(fit.remainderFlux().x, 4 * std::numbers::pi, 0.02 * 4 * std::numbers::pi);  // less the sky in the lights' own places
}

TEST(FitAreaLights, TexelsThatAreNoNumbersCountAsBlack) {
  Environment clean = room(), broken = room();
  std::vector<Vec3> a(clean.texels.begin(), clean.texels.end()), b = a;
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const float bad[] = {nan, inf, -inf, -3.0f};
  for (size_t i = 0; i < 4; ++i) {
    a[1000 + 77 * i] = Vec3(0.0f);
    b[1000 + 77 * i] = Vec3(bad[i]);
  }
  clean.texels = Array<Vec3>(std::move(a));
  broken.texels = Array<Vec3>(std::move(b));
  const AreaLightFit x = fitAreaLights(clean, 20), y = fitAreaLights(broken, 20);
  ASSERT_EQ(x.lights.size(), y.lights.size());
  for (size_t i = 0; i < x.lights.size(); ++i) {
    EXPECT_EQ(x.lights[i].direction, y.lights[i].direction);
    EXPECT_EQ(x.lights[i].irradiance, y.lights[i].irradiance);
  }
  EXPECT_EQ(x.remainder, y.remainder);
}

// With few lights the remainder is large and its bands 1 and 2 would go below zero near what the lights took.
TEST(FitAreaLights, TheRemainderLightsNothingNegatively) {
  double largest = 0;
  for (const Environment& e : {sky(), room()})
    for (const int n : {1, 2, 3, 5, 10}) {
      const AreaLightFit fit = fitAreaLights(e, n);
      for (const DVec3& d : normals(3000)) {
        const DVec3 r = fit.remainderIrradiance(d);
        for (int k = 0; k < 3; ++k) ASSERT_GE(r[k], 0.0) << n;
        largest = std::max(largest, r.x / fit.flux.x);
      }
    }
  EXPECT_GT(largest, 0.05) << "else the maps here say nothing about it";
}

// The map's content turned by one column (0.7 degrees) at a time: the fit is made anew each time. What it changes by beyond the truth's own
// change stays below the fit's error; a light that pops on would show as a jump of its whole irradiance (5 % of the flux here).
TEST(FitAreaLights, SmallTurnsOfTheMapChangeLittle) {
  const Environment first = room();
  const auto turned = [&](int columns) {
    Environment e = first;
    std::vector<Vec3> texels(e.texels.size());
    for (int y = 0; y < e.height; ++y)
      for (int x = 0; x < e.width; ++x) texels[size_t(y) * e.width + (x + columns) % e.width] = first.texels[size_t(y) * e.width + x];
    e.texels = Array<Vec3>(std::move(texels));
    return e;
  };
  const std::vector<DVec3> at = normals(100);
  double mean = 0, worst = 0;
  std::vector<DVec3> before;
  for (int step = 0; step < 16; ++step) {
    const Environment e = turned(step);
    const AreaLightFit fit = fitAreaLights(e, 45);
    std::vector<DVec3> error;
    const std::vector<DVec3> truths = irradiancesOf(e, at);
    for (size_t i = 0; i < at.size(); ++i) {
      mean += truths[i].y / double(16 * at.size());
      error.push_back(irradianceOf(fit, at[i]) - truths[i]);
    }
    double jump = 0;
    for (size_t i = 0; i < before.size(); ++i) jump += (error[i].y - before[i].y) * (error[i].y - before[i].y) / double(at.size());
    worst = std::max(worst, std::sqrt(jump));
    before = error;
  }
  std::printf("turns by 0.7 degrees: largest RMS change beyond the truth's %.4f of the mean irradiance\n", worst / mean);
  EXPECT_LT(worst, 0.02 * mean);
}

TEST(FitAreaLights, PollsItsStopTokenAllAlong) {
  const Environment e = mapOf(64, 32, [](const DVec3& d) { return Vec3(1.0f + float(d.y)); });
  constexpr int kMany = 1 << 30;
  ASSERT_EQ(fitAreaLights(e, 16).lights.size(), 16u);  // which cells the map's texels are in is found once, and polls too
  StopSource count;
  count.stopAtPoll(kMany);
  ASSERT_EQ(fitAreaLights(e, 16, count.token()).lights.size(), 16u);
  const int polls = kMany - count.pollsLeft();
  EXPECT_GT(polls, 16 * 6 * 12) << "for each light, chart and size";
  for (const int n : {1, 10, 40, 200, polls / 2, polls - 1}) {  // in the cells, the pursuit, the refinement
    StopSource stop;
    stop.stopAtPoll(n);
    EXPECT_TRUE(fitAreaLights(e, 16, stop.token()).lights.empty()) << n;
    EXPECT_EQ(stop.token().reason(), StopReason::Cancelled) << n;
  }
}

}  // namespace
}  // namespace gobo
