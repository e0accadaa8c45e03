// SPDX-License-Identifier: Apache-2.0
// Prefiltered maps against closed forms and sums over everything.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "base/sobol.h"
#include "scene/environment_tents.h"
#include "support/map_of.h"
#include "techniques/prefilter/environment_sums.h"
#include "techniques/prefilter/irradiance_matrix.h"
#include "techniques/prefilter/phong_map.h"
#include "techniques/prefilter/radiance_cache.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/harmonics.h"

namespace gobo::prefilter::prefilter_test {
namespace {

constexpr double kPi2 = std::numbers::pi;

DVec3 centreOf(int x, int y, int width, int height) {
  const double theta = (y + 0.5) / height * kPi2, phi = ((x + 0.5) / width * 2 - 1) * kPi2;
  return {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)};
}
using tests::mapOf;
Vec3 noiseAt(int x, int y, uint64_t seed) {
  const uint64_t h = hash64(seed, uint64_t(y) * 100000 + uint64_t(x));
  return std::exp(5.0f * toUnit(hash32(h, 1))) * Vec3(toUnit(hash32(h, 2)), toUnit(hash32(h, 3)), toUnit(hash32(h, 4)));
}
EnvironmentPtr noise(int width, int height, uint64_t seed) {
  return mapOf(width, height, [&](int x, int y) { return noiseAt(x, y, seed); });
}
DVec3 someDirection(int i) {
  const double z = 1 - 2 * (i + 0.5) / 40, phi = i * 2.399963;
  return {std::sqrt(1 - z * z) * std::cos(phi), z, std::sqrt(1 - z * z) * std::sin(phi)};
}
/// 0 at and below -20 dB of nothing: relative to the larger.
double apart(const DVec3& a, const DVec3& b) { return glm::length(a - b) / std::max({glm::length(a), glm::length(b), 1e-300}); }

TEST(IrradianceMatrix, OfAConstantMapIsPi) {
  const TaskArena arena(2);
  const EnvironmentPtr map = mapOf(16, 8, [](int, int) { return Vec3(1.0f, 0.5f, 2.0f); });
  const IrradianceMatrix m = irradianceMatrix(transfer::environmentHarmonics(*map, 3, arena));
  for (int i = 0; i < 40; ++i) EXPECT_LT(apart(m.at(someDirection(i)), kPi2 * DVec3(1, 0.5, 2)), 1e-12) << i;
}

// A light of one direction and irradiance 1: (0.375 + 2 x + 1.875 x^2) / 4; its peak, its sides, its least and its back as figures.
TEST(IrradianceMatrix, OfOneDirectionIsAParabolaOfTheCosine) {
  for (int k = 0; k < 40; ++k) {
    const DVec3 to = someDirection(k);
    double y[9];
    transfer::harmonics(to, 3, y);
    std::vector<double> coefficients;
    for (const double v : y)
      for (const double channel : {1.0, 3.0, 0.0}) coefficients.push_back(channel * v);
    const IrradianceMatrix m = irradianceMatrix(coefficients);
    for (int i = 0; i < 40; ++i) {
      const double x = glm::dot(to, someDirection(i)), expected = 0.25 * (0.375 + 2 * x + 1.875 * x * x);
      const DVec3 found = m.at(someDirection(i));
      EXPECT_NEAR(found.x, expected, 1e-12);
      EXPECT_NEAR(found.y, 3 * expected, 3e-12);
      EXPECT_EQ(found.z, 0.0);
    }
    EXPECT_NEAR(m.at(to).x, 1.0625, 1e-12);
    EXPECT_NEAR(m.at(-to).x, 0.0625, 1e-12);
    const DVec3 side = glm::normalize(glm::cross(to, DVec3(0.3, 0.5, -0.7)));
    EXPECT_NEAR(m.at(side).x, 0.09375, 1e-12);
    EXPECT_NEAR(m.at(to * -8.0 / 15.0 + side * std::sqrt(1 - 64.0 / 225.0)).x, -0.0396, 1e-4);
  }
}

// The same nine harmonics by convolution, band by band; and the map's irradiance, which is smooth.
TEST(IrradianceMatrix, IsTheConvolutionOfThreeBands) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(32, 16, 3);
  const std::vector<double> c = transfer::environmentHarmonics(*map, 5, arena);
  const IrradianceMatrix m = irradianceMatrix(c);
  for (int i = 0; i < 40; ++i) {
    double y[9];
    transfer::harmonics(someDirection(i), 3, y);
    DVec3 sum(0.0), truth(0.0);
    for (int l = 0; l < 3; ++l)
      for (int j = l * l; j < (l + 1) * (l + 1); ++j)
        for (int k = 0; k < 3; ++k) sum[k] += transfer::cosineCoefficient(l) * y[j] * c[size_t(3 * j + k)];
    EXPECT_LT(apart(m.at(someDirection(i)), sum), 1e-12);
    const EnvironmentTents tents(32, 16);
    for (int t = 0; t < 512; ++t)
      truth += std::max(glm::dot(centreOf(t % 32, t / 32, 32, 16), someDirection(i)), 0.0) * tents.weight(t / 32) * DVec3(map->texels[size_t(t)]);
    EXPECT_LT(apart(m.at(someDirection(i)), truth), 0.04) << i;
  }
}

TEST(PhongMap, AConstantStaysConstant) {
  const TaskArena arena(2);
  for (const auto& [w, h] : {std::pair{64, 32}, std::pair{33, 17}, std::pair{1, 1}, std::pair{4, 1}}) {
    const EnvironmentPtr map = mapOf(w, h, [](int, int) { return Vec3(0.25f, 3.0f, 1e30f); });
    for (const double s : {0.01, 1.0, 37.5, 1e4, 1e9}) {
      const PhongMap p = phongMap(*map, s, 12, 6, arena);
      ASSERT_EQ(p.radiance.size(), 72u);
      for (const DVec3& c : p.radiance) {
        if (w * h > 4) {
          for (int k = 0; k < 3; ++k) EXPECT_NEAR(c[k], double(map->texels[0][k]), 1e-12 * double(map->texels[0][k])) << w << " " << s;
        }
        for (int k = 0; k < 3; ++k) EXPECT_TRUE(std::isfinite(c[k]) && c[k] >= 0.0);
      }
    }
  }
}

TEST(PhongMap, ToInfinityIsTheMap) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(32, 16, 9);
  const PhongMap p = phongMap(*map, 1e7, 32, 16, arena);
  for (size_t t = 0; t < p.radiance.size(); ++t) EXPECT_LT(apart(p.radiance[t], DVec3(map->texels[t])), 1e-6) << t;
}

// The mean cosine of the lobe is (s + 1) / (s + 2): what is linear in the direction keeps that much of its slope.
TEST(PhongMap, ASlopeShrinksByTheMeanCosine) {
  const TaskArena arena(2);
  const DVec3 slope(0.3, -0.5, 0.4);
  const EnvironmentPtr map = mapOf(256, 128, [&](int x, int y) { return Vec3(float(1 + glm::dot(slope, centreOf(x, y, 256, 128))), 1, 0); });
  for (const double s : {0.5, 1.0, 8.0, 60.0, 700.0}) {
    const PhongMap p = phongMap(*map, s, 16, 8, arena);
    for (int t = 0; t < 128; ++t) EXPECT_NEAR(p.radiance[size_t(t)].x, 1 + (s + 1) / (s + 2) * glm::dot(slope, centreOf(t % 16, t / 16, 16, 8)), 1e-3) << s;
  }
}

TEST(PhongMap, OneDirectionIsAPowerOfTheCosine) {
  const TaskArena arena(2);
  const int w = 256, h = 128, at = 40 * w + 77;
  const EnvironmentPtr map = mapOf(w, h, [&](int x, int y) { return y * w + x == at ? Vec3(1e4f, 2e4f, 0) : Vec3(0.0f); });
  const double flux = EnvironmentTents(w, h).weight(40) * 1e4;
  for (const double s : {30.0, 100.0, 400.0}) {  // from which on no block is larger than a texel: the light lies where it lies
    const PhongMap p = phongMap(*map, s, 64, 32, arena);
    const double peak = (s + 1) / (2 * kPi2) * flux;
    for (int t = 0; t < 64 * 32; ++t) {
      const double cosine = std::max(glm::dot(centreOf(t % 64, t / 64, 64, 32), centreOf(77, 40, w, h)), 0.0);
      EXPECT_NEAR(p.radiance[size_t(t)].x, peak * std::pow(cosine, s), 2e-3 * peak) << s;
      EXPECT_NEAR(p.radiance[size_t(t)].y, 2 * p.radiance[size_t(t)].x, 1e-9 * peak);
    }
  }
}

// Blocks of texels instead of texels, where the lobe is wide; rows and texels that are left out. Sums over all texels say the same.
TEST(PhongMap, BlocksAreNotSeen) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(256, 128, 21);
  const EnvironmentTents tents(256, 128);
  for (const double s : {1.0, 5.0, 20.0, 90.0}) {
    const PhongMap p = phongMap(*map, s, 8, 4, arena);
    for (int t = 0; t < 32; ++t) {
      DVec3 sum(0.0);
      double all = 0;
      for (int i = 0; i < 256 * 128; ++i) {
        const double c = glm::dot(centreOf(t % 8, t / 8, 8, 4), centreOf(i % 256, i / 256, 256, 128));
        const double weight = c > 0 ? std::pow(c, s) * tents.weight(i / 256) : 0.0;
        sum += weight * DVec3(map->texels[size_t(i)]);
        all += weight;
      }
      EXPECT_LT(apart(p.radiance[size_t(t)], sum / all), 2e-3) << s << " " << t;
    }
  }
}

TEST(PhongMap, TurnsWithTheMapAndIsTheSameForAnyThreads) {
  const TaskArena one(1), three(3);
  const EnvironmentPtr map = noise(32, 16, 4), turned = mapOf(32, 16, [](int x, int y) { return noiseAt((x + 27) % 32, y, 4); });
  for (const double s : {2.0, 50.0}) {
    const PhongMap a = phongMap(*map, s, 32, 16, one), b = phongMap(*turned, s, 32, 16, three), c = phongMap(*map, s, 32, 16, three);
    EXPECT_EQ(std::memcmp(a.radiance.data(), c.radiance.data(), a.radiance.size() * sizeof(DVec3)), 0);
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 32; ++x) EXPECT_LT(apart(a.radiance[size_t(y * 32 + x)], b.radiance[size_t(y * 32 + (x + 5) % 32)]), 1e-10);
  }
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_TRUE(phongMap(*map, 3, 32, 16, one, stop.token()).radiance.empty());
}

TEST(EnvironmentSums, AreSumsOverAnyBox) {
  for (const auto& [w, h] : {std::pair{64, 32}, std::pair{7, 5}, std::pair{1, 1}}) {
    const EnvironmentPtr map = noise(w, h, 6);
    const EnvironmentTents tents(w, h);
    const EnvironmentSums sums(*map);
    const double whole = glm::length(sums.flux(0, w, 0, h));
    EXPECT_NEAR(sums.solidAngle(w, 0, h), 4 * kPi2, 1e-12);
    for (uint64_t i = 0; i < 2000; ++i) {
      const int x0 = int(hash32(i, 1) % uint32_t(3 * w)) - w, columns = int(hash32(i, 2) % uint32_t(w + 1));
      int y0 = int(hash32(i, 3) % uint32_t(h + 1)), y1 = int(hash32(i, 4) % uint32_t(h + 1));
      if (y0 > y1) std::swap(y0, y1);
      DVec3 flux(0.0);
      double solid = 0;
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x0 + columns; ++x) {
          flux += tents.weight(y) * DVec3(map->texels[size_t(y * w + ((x % w) + w) % w)]);
          solid += tents.weight(y);
        }
      EXPECT_LT(glm::length(sums.flux(x0, columns, y0, y1) - flux), 1e-14 * whole) << w << " " << i;
      EXPECT_NEAR(sums.solidAngle(columns, y0, y1), solid, 1e-12);  // the sum above rounds
      const DVec3 mean = sums.mean(x0, columns, y0, y1);
      if (solid > 0) {
        EXPECT_LT(glm::length(mean - flux / solid), 1e-12 * whole / solid);
      } else {
        EXPECT_EQ(mean, DVec3(0.0));
      }
    }
  }
}

TEST(EnvironmentSums, ConstantsAndRampsAreExact) {
  const EnvironmentPtr constant = mapOf(512, 256, [](int, int) { return Vec3(0.3f); }), ramp = mapOf(512, 256, [](int x, int) { return Vec3(float(x)); });
  const EnvironmentSums one(*constant), rising(*ramp);
  for (int x = 0; x < 500; x += 37)
    for (int y = 0; y < 250; y += 31) {
      EXPECT_NEAR(one.mean(x, 9, y, y + 5).y, double(0.3f), 1e-9) << "a box of 45 of 131072 texels; at the pole 1e-8 of the sphere";
      EXPECT_NEAR(rising.mean(x, 9, y, y + 5).x, x + 4.0, 1e-6);
    }
}

// Light next to nothing above, and a hundred thousand times as much: the black box stays black, or nearly, and is not negative.
TEST(EnvironmentSums, AreNeverNegative) {
  const EnvironmentPtr map = mapOf(128, 64, [](int x, int y) { return y > 50 ? Vec3(0.0f) : 1e5f * noiseAt(x, y, 2); });
  const EnvironmentSums sums(*map);
  const double whole = glm::length(sums.flux(0, 128, 0, 64));
  for (int x = 0; x < 128; ++x) {
    const DVec3 flux = sums.flux(x, 3, 51, 60);
    for (int k = 0; k < 3; ++k) {
      EXPECT_GE(flux[k], 0.0);
      EXPECT_LE(flux[k], 1e-14 * whole);
    }
  }
}

/// Integral of a BRDF against all texels.
DVec3 reflected(const Environment& map, const DVec3& normal, const DVec3& out, const IsotropicBrdf& brdf) {
  const EnvironmentTents tents(map.width, map.height);
  DVec3 sum(0.0);
  for (int t = 0; t < map.width * map.height; ++t) {
    const DVec3 w = centreOf(t % map.width, t / map.width, map.width, map.height);
    const double cosine = glm::dot(normal, w);
    if (cosine > 0) sum += brdf(w, normal, out) * cosine * tents.weight(t / map.width) * DVec3(map.texels[size_t(t)]);
  }
  return sum;
}
/// Phong's, of exponent 20.
double shiny(const DVec3& in, const DVec3& normal, const DVec3& out) {
  return 22 / (2 * kPi2) * std::pow(std::max(glm::dot(2 * glm::dot(normal, out) * normal - out, in), 0.0), 20);
}
double diffuse(const DVec3&, const DVec3&, const DVec3&) { return 1 / kPi2; }
/// Root mean square over normals that face `out`, by the mean.
double cacheError(const RadianceCache& cache, const Environment& map, const DVec3& out, const IsotropicBrdf& brdf) {
  double square = 0, mean = 0;
  for (int i = 0; i < 40; ++i) {
    const DVec3 n = someDirection(i);
    if (glm::dot(n, out) < 0.1) continue;
    const DVec3 truth = reflected(map, n, out, brdf);
    square += glm::dot(cache.at(n) - truth, cache.at(n) - truth);
    mean += glm::dot(truth, truth);
  }
  return std::sqrt(square / mean);
}

TEST(RadianceCache, OfAConstantMapIsPiForEveryNormal) {
  const TaskArena arena(2);
  const EnvironmentPtr map = mapOf(64, 32, [](int, int) { return Vec3(1.0f, 2.0f, 0.0f); });
  const RadianceCache cache(*map, DVec3(0.2, 0.3, -1), nullptr, 32, 0.0, arena);
  for (int i = 0; i < 40; ++i) EXPECT_LT(apart(cache.at(someDirection(i)), kPi2 * DVec3(1, 2, 0)), 2e-3) << i;
}

TEST(RadianceCache, ItsTexelsAreIntegralsAndLieWhereTheyAreLookedUp) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(32, 16, 12);
  for (const DVec3& eye : {DVec3(0, 0, 1), DVec3(0.1, 1, 0), DVec3(0, -1, 0), glm::normalize(DVec3(-1, 0.4, 0.2))}) {
    const RadianceCache cache(*map, eye, shiny, 8, 0.0, arena);
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 8; ++x) {
        const DVec3 n = cache.normal(x, y);
        EXPECT_NEAR(glm::length(n), 1.0, 1e-12);
        EXPECT_LT(apart(cache.at(n), reflected(*map, n, glm::normalize(eye), shiny)), 1e-9) << x << " " << y;
      }
  }
}

TEST(RadianceCache, FinerPicturesAreNearer) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(32, 16, 13);
  const DVec3 eye = glm::normalize(DVec3(0.3, 0.2, 1));
  double before = 1;
  for (const int side : {16, 32, 64, 128}) {
    const double error = cacheError(RadianceCache(*map, eye, shiny, side, 0.0, arena), *map, eye, shiny);
    std::printf("radiance cache of %d x %d normals: RMS error %.5f\n", side, side, error);
    EXPECT_LT(error, before / 2);
    before = error;
  }
  EXPECT_LT(before, 2e-3);
}

// The direction to the eye is one; a pixel at the side of a picture has another.
TEST(RadianceCache, AWideViewIsWrongForWhatShines) {
  const TaskArena arena(2);
  const EnvironmentPtr map = noise(32, 16, 14);
  const RadianceCache shines(*map, DVec3(0, 0, 1), shiny, 64, 0.0, arena), dull(*map, DVec3(0, 0, 1), diffuse, 64, 0.0, arena);
  double before = 0;
  for (const double degrees : {0.0, 5.0, 10.0, 20.0, 40.0}) {
    const DVec3 out(std::sin(degrees * kPi2 / 180), 0, std::cos(degrees * kPi2 / 180));
    const double error = cacheError(shines, *map, out, shiny);
    std::printf("radiance cache, exponent 20, %2.0f degrees off its axis: RMS error %.4f\n", degrees, error);
    EXPECT_GT(error, before);
    before = error;
    EXPECT_LT(cacheError(dull, *map, out, diffuse), 0.012) << degrees;  // of 64 x 64: normals that face away lie apart
  }
  EXPECT_GT(before, 0.1);
}

TEST(RadianceCache, IsTheSameForAnyThreadsAndStops) {
  const TaskArena one(1), three(3);
  const EnvironmentPtr map = noise(32, 16, 15);
  const RadianceCache a(*map, DVec3(0, 0, 1), shiny, 32, 0.0, one), b(*map, DVec3(0, 0, 1), shiny, 32, 0.0, three);
  for (int i = 0; i < 40; ++i) EXPECT_EQ(a.at(someDirection(i)), b.at(someDirection(i)));
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_TRUE(RadianceCache(*map, DVec3(0, 0, 1), nullptr, 32, 0.0, one, stop.token()).empty());
}

}  // namespace
}  // namespace gobo::prefilter::prefilter_test
