// SPDX-License-Identifier: Apache-2.0
// Lights in an environment map's place: no flux is lost, lists are nested, and more lights light as the map does.
#include "terms/extract_lights.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <set>

#include "base/sobol.h"
#include "scene/environment_tents.h"
#include "support/map_of.h"
#include "terms/structured_lights.h"
#include "terms/wavelet_lights.h"

namespace gobo::extract_lights_test {
namespace {

constexpr ExtractBy kAll[] = {ExtractBy::MedianCut, ExtractBy::Structured, ExtractBy::Wavelet};
constexpr ExtractBy kNested[] = {ExtractBy::Structured, ExtractBy::Wavelet};

using tests::mapOf;
/// Of any contrast and colour: no two texels alike.
Vec3 noiseAt(int x, int y, uint64_t seed) {
  const uint64_t h = hash64(seed, uint64_t(y) * 100000 + uint64_t(x));
  const float level = std::exp(6.0f * toUnit(hash32(h, 1)) - 3.0f);
  return level * Vec3(0.2f + toUnit(hash32(h, 2)), 0.2f + toUnit(hash32(h, 3)), 0.2f + toUnit(hash32(h, 4)));
}
EnvironmentPtr noise(int width, int height, uint64_t seed = 5) {
  return mapOf(width, height, [&](int x, int y) { return noiseAt(x, y, seed); });
}
DVec3 centreOf(int x, int y, int width, int height) {
  const double theta = (y + 0.5) / height * std::numbers::pi, phi = (x + 0.5) / width * 2 * std::numbers::pi - std::numbers::pi;
  return {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)};
}
DVec3 fluxOf(const Environment& map) {
  const EnvironmentTents tents(map.width, map.height);
  DVec3 sum(0.0);
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) sum += tents.weight(y) * DVec3(map.texels[size_t(y * map.width + x)]);
  return sum;
}
bool sameBits(const std::vector<MapLight>& a, const std::vector<MapLight>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(MapLight)) == 0);
}

struct Case {
  const char* name;
  EnvironmentPtr map;
};
std::vector<Case> cases() {
  const auto black = Vec3(0.0f);
  return {
      {"noise", noise(64, 32)},
      {"odd sizes", noise(33, 17)},
      {"one texel", mapOf(1, 1, [](int, int) { return Vec3(1, 2, 3); })},
      {"a row", noise(4, 1)},
      {"a column", noise(1, 5)},
      {"four texels", noise(2, 2)},
      {"constant", mapOf(32, 16, [](int, int) { return Vec3(0.5f, 0.25f, 2.0f); })},
      {"a sun of one texel", mapOf(64, 32, [](int x, int y) { return x == 40 && y == 9 ? Vec3(1e6f, 9e5f, 8e5f) : Vec3(1.0f, 1.1f, 1.2f); })},
      {"a texel in the dark", mapOf(64, 32, [&](int x, int y) { return x == 0 && y == 31 ? Vec3(0, 7, 0) : black; })},
      {"the poles", mapOf(64, 32, [&](int x, int y) { return y == 0 || y == 31 ? noiseAt(x, y, 3) : black; })},
      {"half of it black", mapOf(32, 16, [&](int x, int y) { return (x + y) % 2 ? noiseAt(x, y, 4) : black; })},
      {"next to nothing", mapOf(32, 16, [](int x, int y) { return 1e-36f * noiseAt(x, y, 6); })},
      {"as much as there is", mapOf(32, 16, [](int x, int y) { return 1e34f * noiseAt(x, y, 7); })},
  };
}

TEST(ExtractLights, TheirFluxIsTheMaps) {
  for (const auto& [name, map] : cases()) {
    const DVec3 flux = fluxOf(*map);
    for (const ExtractBy by : kAll)
      for (const int n : {1, 2, 3, 7, 64, 256}) {
        SCOPED_TRACE(std::string(name) + ", way " + std::to_string(int(by)) + ", lights " + std::to_string(n));
        const std::vector<MapLight> lights = extractLights(*map, n, by);
        ASSERT_FALSE(lights.empty());
        EXPECT_LE(lights.size(), size_t(n));
        DVec3 sum(0.0);
        for (const MapLight& l : lights) {
          EXPECT_NEAR(glm::length(l.direction), 1.0, 1e-12);
          for (int k = 0; k < 3; ++k) {
            EXPECT_GE(l.flux[k], 0.0);
            sum[k] += double(float(l.flux[k]));  // as it leaves the node
          }
        }
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(sum[k], flux[k], 1e-6 * flux[k]);
      }
  }
}

TEST(ExtractLights, BlackMapsHaveNone) {
  for (const ExtractBy by : kAll) EXPECT_TRUE(extractLights(*mapOf(16, 8, [](int, int) { return Vec3(0.0f); }), 8, by).empty()) << int(by);
}

TEST(ExtractLights, ListsAreNested) {
  for (const auto& [name, map] : cases())
    for (const ExtractBy by : kNested) {
      const std::vector<MapLight> all = extractLights(*map, 64, by);
      for (int n = 1; n < 64; n = n < 8 ? n + 1 : 2 * n) {
        const std::vector<MapLight> some = extractLights(*map, n, by);
        ASSERT_EQ(some.size(), std::min(all.size(), size_t(n))) << name << " " << int(by);
        for (size_t i = 0; i < some.size(); ++i) {
          EXPECT_EQ(some[i].direction, all[i].direction) << name << " " << int(by) << " light " << i << " of " << n;
          for (int k = 0; k < 3; ++k) EXPECT_GE(some[i].flux[k], all[i].flux[k]) << name << ": more lights, less for each";
        }
      }
    }
}

// A list of as many lights as there are lit texels is the map itself; a longer one is not longer. Maps of fewer than 32 texels are made finer.
TEST(ExtractLights, EveryLitTexelIsALightAtMost) {
  for (const auto& [name, map] : cases()) {
    if (map->width * map->height > 512 || map->width * map->height < 32) continue;
    for (const ExtractBy by : kNested) {
      std::set<std::pair<int, int>> seen;
      const EnvironmentTents tents(map->width, map->height);
      const std::vector<MapLight> lights = extractLights(*map, 600, by);
      for (const MapLight& l : lights) {
        const int y = int(std::acos(std::clamp(l.direction.y, -1.0, 1.0)) / std::numbers::pi * map->height);
        const int x = std::min(int((std::atan2(l.direction.z, l.direction.x) / (2 * std::numbers::pi) + 0.5) * map->width), map->width - 1);
        EXPECT_TRUE(seen.insert({x, y}).second) << name << ": two lights in a texel";
        const Vec3 texel = map->texels[size_t(y * map->width + x)];
        EXPECT_GT(luminance(texel), 0.0f) << name << ": a light in the dark";
        for (int k = 0; k < 3 && by == ExtractBy::Structured; ++k) {
          EXPECT_NEAR(l.flux[k], tents.weight(y) * texel[k], 1e-9 * tents.weight(y) * texel[k]) << name;
        }
      }
      const size_t lit = size_t(std::count_if(map->texels.begin(), map->texels.end(), [](const Vec3& c) { return luminance(c) > 0; }));
      EXPECT_LE(lights.size(), lit) << name;
      if (by == ExtractBy::Structured) { EXPECT_EQ(lights.size(), lit) << name; }
    }
  }
}

// A constant environment is a map of one texel: its lights are all around, not one of them at +X.
TEST(ExtractLights, OfOneTexelAreAllAround) {
  for (const ExtractBy by : kAll) {
    const std::vector<MapLight> lights = extractLights(*constantEnvironment(Vec3(1, 2, 3)), 64, by);
    EXPECT_GT(lights.size(), 32u) << int(by);
    DVec3 sum(0.0);
    double flux = 0;
    for (const MapLight& l : lights) {
      sum += l.flux.y * l.direction;
      flux += l.flux.y;
      EXPECT_NEAR(l.flux.x, 0.5 * l.flux.y, 1e-6 * l.flux.y);
      EXPECT_NEAR(l.flux.z, 1.5 * l.flux.y, 1e-6 * l.flux.y);
    }
    EXPECT_NEAR(flux, 8 * std::numbers::pi, 1e-5) << int(by);
    EXPECT_LT(glm::length(sum), 0.1 * flux) << int(by);
    // As a plane of any normal sees it: pi times the radiance, but for what 64 lights are too few for.
    for (int k = 0; k < 6; ++k) {
      DVec3 normal(0.0);
      normal[k % 3] = k < 3 ? 1.0 : -1.0;
      double irradiance = 0;
      for (const MapLight& l : lights) irradiance += l.flux.y * std::max(glm::dot(normal, l.direction), 0.0);
      EXPECT_NEAR(irradiance, 2 * std::numbers::pi, 0.15 * 2 * std::numbers::pi) << int(by) << " " << k;
    }
  }
}

TEST(ExtractLights, MapsOfFewTexelsCountTheFinerOne) {
  for (const ExtractBy by : kAll) EXPECT_GT(makeExtractLightsNode(4, by, 1)->workingBytes(), size_t(64) * 32 * sizeof(Vec3)) << int(by);
}

// The sun is 1 / 2000 of the sphere and most of the light: it is the first light, where it is, with its own flux and a little sky.
TEST(ExtractLights, ASunOfOneTexelIsALightThere) {
  const EnvironmentPtr map = cases()[7].map;
  const DVec3 sun = EnvironmentTents(64, 32).weight(9) * DVec3(map->texels[9 * 64 + 40]);
  for (const ExtractBy by : kNested)
    for (const int n : {1, 2, 16, 200}) {
      const std::vector<MapLight> lights = extractLights(*map, n, by);
      ASSERT_EQ(lights.size(), size_t(n)) << int(by);
      EXPECT_LT(glm::length(lights[0].direction - centreOf(40, 9, 64, 32)), 1e-12) << int(by);
      for (int k = 0; k < 3; ++k) {
        EXPECT_GE(lights[0].flux[k], sun[k]);
        if (n > 1) { EXPECT_LE(lights[0].flux[k], 1.01 * sun[k]); }
      }
    }
}

TEST(ExtractLights, AreTheSameForAnyThreads) {
  const EnvironmentPtr map = noise(512, 256);
  const TaskArena one(1), three(3);
  for (const ExtractBy by : kAll) {
    const std::vector<MapLight> alone = extractLights(*map, 40, by);
    EXPECT_EQ(alone.size(), 40u);
    for (const TaskArena* arena : {&one, &three}) EXPECT_TRUE(sameBits(alone, extractLights(*map, 40, by, arena))) << int(by);
  }
}

TEST(ExtractLights, TurnWithTheMap) {
  const int w = 64, h = 32, by = 17;  // texels
  const double turn = 2 * std::numbers::pi * by / w;
  Environment turned = *noise(w, h);
  turned.rotation = 1.25f;
  const EnvironmentPtr rolled = mapOf(w, h, [&](int x, int y) { return noiseAt((x + w - by) % w, y, 5); });
  for (const ExtractBy way : kAll) {
    const std::vector<MapLight> lights = extractLights(*noise(w, h), 50, way);
    EXPECT_TRUE(sameBits(lights, extractLights(turned, 50, way))) << "map axes";
    if (way != ExtractBy::Structured) continue;  // a grid has an edge; places on a sphere have none
    const std::vector<MapLight> other = extractLights(*rolled, 50, way);
    ASSERT_EQ(other.size(), lights.size());
    for (size_t i = 0; i < lights.size(); ++i) {
      const DVec3 d = lights[i].direction;
      const DVec3 expected(d.x * std::cos(turn) - d.z * std::sin(turn), d.y, d.x * std::sin(turn) + d.z * std::cos(turn));
      EXPECT_LT(glm::length(other[i].direction - expected), 1e-9) << i;
      EXPECT_LT(glm::length(other[i].flux - lights[i].flux), 1e-9 * glm::length(lights[i].flux)) << i;
    }
  }
}

TEST(ExtractLights, StopAnywhere) {
  const EnvironmentPtr map = noise(64, 32);
  const TaskArena arena(1);
  for (const ExtractBy by : kAll) {
    StopSource source;
    source.stopAtPoll(1 << 20);
    extractLights(*map, 12, by, &arena, source.token());
    const int polls = (1 << 20) - source.pollsLeft();
    EXPECT_GT(polls, 30) << int(by);
    for (int at = 1; at <= polls; ++at) {
      StopSource stop;
      stop.stopAtPoll(at);
      EXPECT_LE(extractLights(*map, 12, by, &arena, stop.token()).size(), 12u);
      EXPECT_TRUE(stop.token().stopRequested());
    }
  }
}

TEST(ExtractLights, WhatNoCameraCanHaveSeenIsRepairedBefore) {
  const auto bad = [](int x, int y) { return x == 3 && y == 2 ? Vec3(NAN, -1, INFINITY) : x == 9 ? Vec3(-1.0f) : noiseAt(x, y, 8); };
  const EnvironmentPtr map = mapOf(16, 8, bad);
  EXPECT_GT(map->repairedTexels, 0);
  for (const ExtractBy by : kAll)
    for (const MapLight& l : extractLights(*map, 30, by))
      for (int k = 0; k < 3; ++k) EXPECT_TRUE(std::isfinite(l.flux[k]) && l.flux[k] >= 0 && std::isfinite(l.direction[k]));
}

/// Faces, edges and corners of a cube.
std::vector<DVec3> normals() {
  std::vector<DVec3> out;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x || y || z) out.push_back(glm::normalize(DVec3(x, y, z)));
  return out;
}
/// Irradiance of planes, of the bilinear look-up: k x k places a texel.
std::vector<DVec3> irradiance(const Environment& map, int k) {
  std::vector<DVec3> out(26, DVec3(0.0));
  const std::vector<DVec3> n = normals();
  for (int y = 0; y < map.height * k; ++y) {
    const double step = std::numbers::pi / (map.height * k), top = std::cos(y * step), bottom = std::cos((y + 1) * step);
    const double solid = (top - bottom) * 2 * std::numbers::pi / (map.width * k);
    for (int x = 0; x < map.width * k; ++x) {
      const DVec3 flux = solid * DVec3(interpolateTexels(map, (x + 0.5) / k, (y + 0.5) / k)), d = centreOf(x, y, map.width * k, map.height * k);
      for (size_t i = 0; i < n.size(); ++i) out[i] += flux * std::max(glm::dot(n[i], d), 0.0);
    }
  }
  return out;
}
/// Root mean square over normals and channels, by the mean.
double irradianceError(const std::vector<MapLight>& lights, const std::vector<DVec3>& truth) {
  const std::vector<DVec3> n = normals();
  double square = 0, mean = 0;
  for (size_t i = 0; i < n.size(); ++i) {
    DVec3 sum(0.0);
    for (const MapLight& l : lights) sum += l.flux * std::max(glm::dot(n[i], l.direction), 0.0);
    square += glm::dot(sum - truth[i], sum - truth[i]) / (3.0 * double(n.size()));
    mean += (truth[i].x + truth[i].y + truth[i].z) / (3.0 * double(n.size()));
  }
  return std::sqrt(square) / mean;
}

TEST(ExtractLights, MoreOfThemLightAsTheMapDoes) {
  // A sky with a gradient, a lamp of 12 degrees and a coloured wall.
  const auto room = [](int x, int y) {
    const DVec3 d = centreOf(x, y, 96, 48);
    Vec3 c = Vec3(0.3f, 0.4f, 0.6f) * float(1.2 + d.y);
    if (glm::dot(d, glm::normalize(DVec3(1, 1, 0.5))) > std::cos(0.1)) c += Vec3(60, 50, 40);
    if (d.y < 0 && d.x < -0.3) c += Vec3(1.5f, 0.2f, 0.1f);
    return c;
  };
  for (const auto& [name, map] : {Case{"room", mapOf(96, 48, room)}, Case{"noise", noise(96, 48, 11)}}) {
    const std::vector<DVec3> truth = irradiance(*map, 6);
    for (const ExtractBy by : kAll) {
      double before = 1e9;
      for (const int n : {1, 4, 16, 64, 256}) {
        const double error = irradianceError(extractLights(*map, n, by), truth);
        std::printf("%s, way %d, %3d lights: irradiance of 26 planes, RMS error %.4f of the mean\n", name, int(by), n, error);
        EXPECT_LT(error, before) << name << " " << int(by) << " " << n;
        before = error;
      }
      EXPECT_LT(before, 0.02) << name << " " << int(by);
    }
  }
}

TEST(BrightnessStrata, CloseInAzimuthAndOverThePoles) {
  const auto strataOf = [](const auto& texel, int layers) {
    std::set<uint32_t> found;
    for (const uint32_t s : brightnessStrata(*mapOf(16, 8, texel), layers)) found.insert(s);
    found.erase(kNoStratum);
    return found.size();
  };
  const auto lit = [](bool on) { return on ? Vec3(1.0f) : Vec3(0.0f); };
  EXPECT_EQ(strataOf([&](int x, int y) { return lit(y == 4 && (x < 2 || x > 13)); }, 6), 1u) << "over the seam";
  EXPECT_EQ(strataOf([&](int x, int y) { return lit(y < 3 && (x == 2 || x == 10)); }, 6), 1u) << "over the upper pole";
  EXPECT_EQ(strataOf([&](int x, int y) { return lit(y > 4 && (x == 2 || x == 10)); }, 6), 1u) << "over the lower pole";
  EXPECT_EQ(strataOf([&](int x, int y) { return lit(y < 3 && (x == 2 || x == 9)); }, 6), 2u) << "they do not meet";
  EXPECT_EQ(strataOf([&](int x, int y) { return lit(y > 1 && y < 6 && x % 4 == 0); }, 6), 4u);
  EXPECT_EQ(strataOf([&](int x, int y) { return lit((x + y) % 2 == 0 && y > 0 && y < 7); }, 6), 48u) << "corners do not touch";
  EXPECT_EQ(strataOf([&](int, int) { return Vec3(3.0f); }, 6), 1u);
  const auto steps = [](int x, int) { return Vec3(x < 8 ? 1.0f : 9.0f); };  // deviation 4
  EXPECT_EQ(strataOf(steps, 6), 2u);
  EXPECT_EQ(strataOf(steps, 1), 1u);
}

/// Lights of a map of two lamps in the dark, by lamp: rows and columns of their own of a map of 128 x 64.
std::pair<int, int> sharesOf(float radianceA, int sideA, float radianceB, int sideB, int n) {
  const EnvironmentPtr map = mapOf(128, 64, [&](int x, int y) {
    const bool a = std::abs(x - 32) < sideA && std::abs(y - 32) < sideA, b = std::abs(x - 96) < sideB && std::abs(y - 32) < sideB;
    return Vec3(a ? radianceA : b ? radianceB : 0.0f);
  });
  std::pair<int, int> out;
  for (const MapLight& l : structuredLights(*map, n)) ++(l.direction.z < 0 ? out.first : out.second);
  return out;
}

TEST(StructuredLights, AreSharedOutByFluxAndTheFourthRootOfSmallSolidAngles) {
  EXPECT_EQ(sharesOf(3, 6, 1, 6, 40), (std::pair{30, 10})) << "by flux";
  EXPECT_EQ(sharesOf(1, 6, 1, 6, 41), (std::pair{21, 20})) << "of equal ones the first";
  EXPECT_EQ(sharesOf(2.5f, 6, 1, 6, 2), (std::pair{1, 1})) << "to the nearest share, not to the larger: 5/7 and 2/7 of two are one each";
  // One texel is 0.0024 sr, the saturated solid angle 0.01: (0.24)^(1/4) = 0.70. 121 texels are more.
  const double texel = EnvironmentTents(128, 64).weight(32), importance = std::pow(texel / 0.01, 0.25);
  ASSERT_LT(importance, 0.75);
  const auto [large, small] = sharesOf(1, 6, 121, 1, 2);
  EXPECT_EQ(large, 1);
  EXPECT_EQ(small, 1) << "a texel has one light at most";
  // Nine texels in the layer of the brighter, 0.02 sr: as much as any.
  EXPECT_EQ(sharesOf(1, 6, 121.0f / 9, 2, 10), (std::pair{5, 5}));
  // Flux alone would give the texel's lamp every second of the first lights; so it comes second, and would be first without the root.
  const EnvironmentPtr map = mapOf(128, 64, [&](int x, int y) {
    return Vec3(std::abs(x - 32) < 6 && std::abs(y - 32) < 6 ? 1.0f : x == 96 && y == 32 ? 140.0f : 0.0f);
  });
  EXPECT_LT(structuredLights(*map, 1)[0].direction.z, 0.0);
  StructuredSettings byFlux;
  byFlux.solidAnglePower = 0;
  EXPECT_GT(structuredLights(*map, 1, nullptr, {}, byFlux)[0].direction.z, 0.0);
}

// Farthest-point placement: no place is farther from a light than the two nearest lights are from each other (Gonzalez; Hochbaum, Shmoys).
TEST(StructuredLights, CoverAStratumAsWideAsTheyAreApart) {
  const EnvironmentPtr map = mapOf(64, 32, [](int, int) { return Vec3(1.0f); });
  for (const int n : {2, 5, 12, 40, 150}) {
    const std::vector<MapLight> lights = structuredLights(*map, n);
    double apart = -1, covered = 1;  // cosines
    for (size_t i = 0; i < lights.size(); ++i)
      for (size_t k = 0; k < i; ++k) apart = std::max(apart, glm::dot(lights[i].direction, lights[k].direction));
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 64; ++x) {
        double nearest = -1;
        for (const MapLight& l : lights) nearest = std::max(nearest, glm::dot(l.direction, centreOf(x, y, 64, 32)));
        covered = std::min(covered, nearest);
      }
    EXPECT_GE(covered, apart - 1e-12) << n;
  }
}

// Not where it is farthest from the lights of the dark around it.
TEST(StructuredLights, ALampsFirstIsInItsMiddle) {
  const DVec3 towards = glm::normalize(DVec3(0.4, -0.3, 0.7));
  const EnvironmentPtr map =
      mapOf(256, 128, [&](int x, int y) { return glm::dot(centreOf(x, y, 256, 128), towards) > std::cos(0.15) ? Vec3(3.0f) : Vec3(0.3f); });
  const std::vector<MapLight> lights = structuredLights(*map, 20);
  const auto in = std::find_if(lights.begin(), lights.end(), [&](const MapLight& l) { return glm::dot(l.direction, towards) > std::cos(0.15); });
  ASSERT_NE(in, lights.end());
  EXPECT_GT(in - lights.begin(), 4) << "the dark has more light";
  EXPECT_GT(glm::dot(in->direction, towards), std::cos(0.025)) << "a texel is 0.025 wide";
}

// Points of a regular grid: as many meet a texel as it has of the map's flux, but for the rim of its rectangle of the unit square.
TEST(LuminancePyramid, WarpsPointsAsTheMapIsBright) {
  for (const auto& [w, h] : {std::pair{8, 4}, std::pair{7, 5}, std::pair{1, 3}, std::pair{3, 1}, std::pair{1, 1}}) {
    const EnvironmentPtr map = mapOf(w, h, [](int x, int y) { return (x + 2 * y) % 5 == 3 ? Vec3(0.0f) : noiseAt(x, y, 2); });
    const LuminancePyramid pyramid(*map);
    EXPECT_NEAR(pyramid.total(), environmentFlux(map.get()), 1e-6 * pyramid.total());
    const int side = 2048;
    std::vector<int> met(size_t(w * h), 0);
    for (int v = 0; v < side; ++v)
      for (int u = 0; u < side; ++u) ++met[pyramid.warp((u + 0.5) / side, (v + 0.5) / side)];
    const EnvironmentTents tents(w, h);
    for (int t = 0; t < w * h; ++t) {
      const double share = luminance(map->texels[size_t(t)]) * tents.weight(t / w) / pyramid.total();
      EXPECT_NEAR(met[size_t(t)] / double(side * side), share, 1.5 / side) << w << "x" << h << " " << t;
      if (share == 0) { EXPECT_EQ(met[size_t(t)], 0); }
    }
    for (const double u : {0.0, 0x1.fffffffffffffp-1})
      for (const double v : {0.0, 0x1.fffffffffffffp-1}) EXPECT_GT(luminance(map->texels[pyramid.warp(u, v)]), 0.0f);
  }
}

// Of the first 256 points of Sobol's each of 16 x 16 cells of the unit square has one: of a map of four equal columns each has a quarter of the lights.
TEST(WaveletLights, AreSpreadAsEvenlyAsSobolsPoints) {
  const EnvironmentPtr map = mapOf(256, 128, [](int, int) { return Vec3(1.0f); });
  int quarter[4] = {};
  for (const MapLight& l : waveletLights(*map, 64)) ++quarter[(l.direction.x > 0 ? 1 : 0) + (l.direction.z > 0 ? 2 : 0)];
  for (const int n : quarter) EXPECT_EQ(n, 16);
}

// And begin in the middle of the light, not at a corner of the map.
TEST(WaveletLights, TheFirstIsAtTheMedian) {
  const auto first = [](bool right) {
    return waveletLights(*mapOf(256, 128, [&](int x, int) { return Vec3(!right || x >= 128 ? 1.0f : 0.0f); }), 1).at(0).direction;
  };
  EXPECT_GT(first(false).x, 0.999) << "the middle of the map";
  EXPECT_GT(first(true).z, 0.999) << "of its right half";
}

}  // namespace
}  // namespace gobo::extract_lights_test
