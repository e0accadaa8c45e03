// SPDX-License-Identifier: Apache-2.0
// What the lights of the published decomposition give: its double count against a closed form, and its energy-exact form against the light of the map.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "oracle/transfer/published_maps.h"
#include "support/thorough.h"
#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/published/published_split.h"

namespace gobo::transfer::published::lights_test {
namespace {

using namespace tests;

PublishedSettings with(Power power, int bands = 5, Window window = Window::None) {
  PublishedSettings s;
  s.power = power;
  s.bands = bands;
  s.window = window;
  return s;
}

/// Irradiance of the map itself, texel by texel.
class MapIrradiance {
 public:
  explicit MapIrradiance(const Environment& map) : directions_(texelDirections(map.width)) {
    const EnvironmentTents tents(map.width, map.height);
    for (size_t i = 0; i < directions_.size(); ++i) flux_.push_back(tents.weight(int(i) / map.width) * double(map.texels[i].x));
  }
  double operator()(const DVec3& normal) const {
    double sum = 0;
    for (size_t i = 0; i < flux_.size(); ++i) sum += flux_[i] * std::max(glm::dot(directions_[i], normal), 0.0);
    return sum;
  }

 private:
  const std::vector<DVec3>& directions_;
  std::vector<double> flux_;
};
struct Against {
  double rms = 0, bias = 0;  // by the root mean square and by the mean of the map's irradiance, over 200 normals
};
constexpr int kNormals = 200;
std::vector<double> irradiances(const Environment& map) {
  const MapIrradiance mapIrradiance(map);
  std::vector<double> out;
  for (const DVec3& n : spiral(kNormals)) out.push_back(mapIrradiance(n));
  return out;
}
/// `truths`: irradiances of the map.
Against irradianceErrors(const std::vector<double>& truths,
                         const std::vector<std::pair<const std::vector<double>*, const std::vector<PublishedLight>*>>& models, int bands,
                         std::vector<Against>& out) {
  double square = 0, mean = 0;
  out.assign(models.size(), {});
  const std::vector<DVec3> normals = spiral(kNormals);
  for (size_t i = 0; i < normals.size(); ++i) {
    const DVec3& n = normals[i];
    const double truth = truths[i];
    square += truth * truth;
    mean += truth;
    for (size_t m = 0; m < models.size(); ++m) {
      const double error = openIrradiance(*models[m].first, bands, *models[m].second, n).x - truth;
      out[m].rms += error * error;
      out[m].bias += error;
    }
  }
  for (Against& a : out) a = {std::sqrt(a.rms / square), a.bias / mean};
  return out[0];
}

TEST(PublishedElbow, IsThatOfTheListingAndFewerThanTheWeberFractionsInverse) {
  std::mt19937_64 random(4);
  for (int i = 0; i < 500; ++i) {
    std::vector<double> values(size_t(random() % 120));
    for (double& v : values) v = std::pow(double(random() >> 11) * 0x1p-53 + 1e-6, double(i % 5));
    std::sort(values.rbegin(), values.rend());
    const double weber = 0.01 + 0.4 * double(random() >> 11) * 0x1p-53;
    // Figure 4.5 of the source, its reading of one element too many mended.
    size_t e = 0;
    if (!values.empty()) {
      double inc = values[0], tot = values[0];
      while (e < values.size() && inc / tot > weber) {
        if (++e == values.size()) break;
        inc = values[e];
        tot += inc;
      }
    }
    EXPECT_EQ(elbow(values, weber), e);
    EXPECT_LE(double(e), std::ceil(1 / weber));
  }
  // Equal ones: k + 1 of them are wanted while 1 / (k + 1) is above the fraction.
  for (const double weber : {0.03, 0.07, 0.11})
    for (const size_t count : {1u, 9u, 40u, 100u}) EXPECT_EQ(elbow(std::vector<double>(count, 2.5), weber), std::min(count, size_t(std::ceil(1 / weber)) - 1));
  EXPECT_EQ(elbow({}, 0.03), 0u);
  EXPECT_EQ(elbow({5.0}, 0.5), 1u);
  EXPECT_EQ(elbow({1.0, 1e-3}, 0.03), 1u);
}

TEST(PublishedPower, DisksHaveTheirIntegrals) {
  for (const double radius : {0.01, 0.3, 1.2, 3.0})
    for (int l = 0; l < 10; ++l) {
      double sum = 0;
      const int n = 200000;
      for (int i = 0; i < n; ++i) sum += std::legendre(unsigned(l), 1 - (1 - std::cos(radius)) * (i + 0.5) / n) / n;
      EXPECT_NEAR(diskCoefficient(l, radius), 2 * std::numbers::pi * (1 - std::cos(radius)) * sum, 1e-8) << l << " " << radius;
    }
}

// Digest B11: a sky of 1 and a sun of as much flux. The published light is the sun's flux once more, but for what the harmonics already show there,
// L^2 / (4 pi) of it: 0.68 of the irradiance and half of the mean too much. Taken out of the harmonics it is within 1 %.
TEST(PublishedPower, CountsASunTwiceAndItsResidualDoesNot) {
  const TaskArena arena(2);
  const double flux = 4 * std::numbers::pi;
  for (const double radius : {0.5, 2.0}) {
    const EnvironmentPtr map = mapOf(1.0, {{glm::normalize(DVec3(0.4, 0.7, -0.6)), radius, flux}}, 512);
    const std::vector<double> truths = irradiances(*map);
    for (const int bands : {3, 5, 6}) {
      const PublishedSplit twice = publishedSplit(*map, with(Power::Published, bands), arena), once = publishedSplit(*map, with(Power::Residual, bands), arena);
      ASSERT_EQ(twice.lights.size(), 1u);
      ASSERT_EQ(once.lights.size(), 1u);
      const double omega = twice.lights[0].solidAngle, excess = 1 - omega * bands * bands / flux;
      EXPECT_NEAR(twice.given.x / twice.flux.x, 1 + 0.5 * excess, radius < 1 ? 0.01 : 0.06);  // a wider sun's top is lower
      EXPECT_NEAR(once.given.x / once.flux.x, 1.0, 1e-5);
      EXPECT_NEAR(once.lights[0].irradiance.x / flux, 1.0, radius < 1 ? 0.01 : 0.12);
      EXPECT_EQ(twice.used, twice.full);
      std::vector<Against> found;
      const std::vector<PublishedLight> none;
      irradianceErrors(truths, {{&twice.full, &none}, {&twice.used, &twice.lights}, {&once.used, &once.lights}}, bands, found);
      EXPECT_NEAR(found[0].rms, bands == 3 ? 0.061 : 0.03, bands == 3 ? 0.006 : 0.012);
      EXPECT_NEAR(found[1].rms, 0.686 * excess, radius < 1 ? 0.02 : 0.09);  // sqrt(16 / 6) / sqrt(17 / 3): a clamped cosine of four by one plus it
      EXPECT_NEAR(found[1].bias, 0.5 * excess, radius < 1 ? 0.01 : 0.06);
      EXPECT_LT(found[2].rms, 0.01);
      EXPECT_NEAR(found[2].bias, 0.0, 1e-3);
    }
  }
}

TEST(PublishedPower, ResidualOfAnySizeRadiusAndWindowIsWithinOnePercent) {
  const TaskArena arena(2);
  for (const double size : {0.3, 4.0, 10.0}) {
    const EnvironmentPtr map = mapOf(1.0, {{glm::normalize(DVec3(-0.4, 0.5, 0.3)), size, 4 * std::numbers::pi}}, 512);
    const std::vector<double> truths = irradiances(*map);
    for (const Radius radius : {Radius::Fixed, Radius::Basin, Radius::Best, Radius::Curvature}) {
      PublishedSettings s = with(Power::Residual);
      s.peaks.radius = radius;
      const PublishedSplit split = publishedSplit(*map, s, arena);
      ASSERT_GE(split.lights.size(), 1u);
      EXPECT_NEAR(split.given.x / split.flux.x, 1.0, 1e-5);
      for (const PublishedLight& light : split.lights) EXPECT_LE(light.radiance.x, light.seen.x);
      // The digest's bound is for lights as large as the sun, up to ten degrees: what a smaller one leaves is still better off than plain harmonics are.
      // Lights are of one direction; by basin and curvature a broad sun's light is broader than it, and further off.
      std::vector<Against> found;
      const std::vector<PublishedLight> none;
      irradianceErrors(truths, {{&split.used, &split.lights}, {&split.full, &none}}, s.bands, found);
      if (split.lights[0].radius > 10.5 * kDeg) {
        EXPECT_TRUE(size > 4 && (radius == Radius::Basin || radius == Radius::Curvature)) << size << " " << int(radius);
      } else if (split.lights[0].radius < 0.7 * size * kDeg) {
        EXPECT_TRUE(size > 4 && radius == Radius::Fixed) << size << " " << int(radius);
        EXPECT_LT(found[0].rms, found[1].rms);
      } else {
        EXPECT_LE(found[0].rms, 0.01) << size << " " << int(radius);
      }
      // A point-like source's disk has its flux. Of the difference's curvature it has what the harmonics do not show there already, of its basin less.
      const double given = split.lights[0].irradiance.x / (4 * std::numbers::pi), shown = 25 * diskCoefficient(0, kernelRadius()) / (4 * std::numbers::pi);
      if (size < 1 && radius == Radius::Fixed) { EXPECT_NEAR(given, 1, 0.01); }
      if (size < 1 && radius == Radius::Curvature) { EXPECT_NEAR(given, 1 - shown, 0.01); }
      if (size < 1 && radius == Radius::Basin) { EXPECT_NEAR(given, 1 - shown, 0.05); }
    }
    for (const Window window : {Window::Hann, Window::Lanczos, Window::Least}) {
      if (size > 1) continue;  // what a small disk leaves of a broad sun a window blurs
      const PublishedSplit split = publishedSplit(*map, with(Power::Residual, 5, window), arena),
                           whole = publishedSplit(*map, with(Power::Published, 5, window), arena);
      std::vector<Against> found;
      EXPECT_LE(irradianceErrors(truths, {{&split.used, &split.lights}}, 5, found).rms, 0.01) << int(window);
      EXPECT_NEAR(split.given.x / split.flux.x, 1.0, 1e-5);
      EXPECT_GE(split.least, window == Window::Least ? -1e-6 : 0.5);
      if (window == Window::Least) {
        EXPECT_GT(whole.damping, 0);
        EXPECT_GE(whole.least, -1e-6);
        EXPECT_EQ(split.damping, 0);  // the sky that is left needs none
      }
    }
  }
}

// A sun anywhere on the cube of cells: its faces' middles, edges and corners.
TEST(PublishedPeaks, ASunIsFoundWhereverItIs) {
  const TaskArena arena(2);
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z) {
        const int ways = std::abs(x) + std::abs(y) + std::abs(z);
        if (ways == 0) continue;
        // Each face, an edge of each face, and every other corner.
        if (!testing::thorough() && ((ways == 2 && x - y != 2 && y - z != 2 && z - x != 2) || (ways == 3 && x * y * z < 0))) continue;
        const DVec3 d = glm::normalize(DVec3(x, y, z));
        const PublishedSplit split = publishedSplit(*mapOf(1.0, {{d, 0.3, 8.0}}), with(Power::Residual), arena);
        ASSERT_EQ(split.lights.size(), 1u) << x << y << z;
        EXPECT_LT(angleBetween(split.lights[0].direction, d), 0.1) << x << y << z;  // a twentieth of an edge
        EXPECT_NEAR(split.lights[0].irradiance.x / 8.0, 1.0, 0.01) << x << y << z;
        EXPECT_NEAR(split.given.x / split.flux.x, 1.0, 1e-5);
      }
}

// Tops between vertices move as the sun does; those at vertices jump.
TEST(PublishedPeaks, ALightThatMovesDoesSoEvenly) {
  const TaskArena arena(2);
  const DVec3 from = glm::normalize(DVec3(0.3, 0.4, 0.8)), side = glm::normalize(glm::cross(from, DVec3(0.9, 0.1, 0.2)));
  const int steps = testing::thoroughOr(16, 8);
  std::vector<EnvironmentPtr> maps;
  for (int k = 0; k <= steps; ++k) {
    const double a = 0.6 * k * kDeg;
    maps.push_back(mapOf(1.0, {{std::cos(a) * from + std::sin(a) * side, 0.5, 8.0}}));
  }
  const auto unevenness = [&](Refine refine) {
    DVec3 last(0.0);
    double most = 0, sum = 0;
    for (int k = 0; k <= steps; ++k) {
      PublishedSettings s = with(Power::Published);
      s.peaks.refine = refine;
      const PublishedSplit split = publishedSplit(*maps[size_t(k)], s, arena);
      if (k > 0) {
        const double step = angleBetween(split.lights[0].direction, last);
        most = std::max(most, step);
        sum += step / steps;
      }
      last = split.lights[0].direction;
    }
    return most / sum;
  };
  EXPECT_LT(unevenness(Refine::LogQuadric), 1.2);
  EXPECT_GT(unevenness(Refine::None), 2.0);
}

TEST(PublishedSplit, TheLargestDifferenceFallsWithEveryLight) {
  const TaskArena arena(2);
  std::vector<Sun> suns;
  for (const DVec3& d : spiral(7)) suns.push_back({d, 0.5, 3.0 / (1.0 + double(suns.size()))});
  PublishedSettings s = with(Power::Published);
  s.peaks.refine = Refine::None;  // the disk's radiance is the difference at its vertex then, so that is the most that it can overshoot by
  s.weber = 0.01;
  const PublishedSplit split = publishedSplit(*mapOf(1.0, suns), s, arena);
  ASSERT_EQ(split.lights.size(), 7u);
  ASSERT_EQ(split.maximum.size(), 8u);
  for (size_t k = 1; k < split.maximum.size(); ++k) EXPECT_LE(split.maximum[k], split.maximum[k - 1] * (1 + 1e-12)) << k;
  EXPECT_NEAR(split.maximum[0], split.lights[0].difference, 1e-12);
  EXPECT_LT(split.maximum.back(), 0.7 * split.maximum[0]);
}

TEST(PublishedSplit, EqualLampsAreFoundUpToTheElbow) {
  const TaskArena arena(2);
  std::vector<Sun> suns;
  for (const DVec3& d : spiral(40)) suns.push_back({d, 1.0, 1.0});
  const EnvironmentPtr map = mapOf(0.01, suns);
  for (const double weber : {0.02, 0.03}) {
    PublishedSettings s = with(Power::Residual);
    s.weber = weber;
    const PublishedSplit split = publishedSplit(*map, s, arena);
    EXPECT_EQ(split.candidates, 40u);
    EXPECT_LE(split.lights.size(), weber < 0.025 ? 40u : 33u);
    EXPECT_GE(split.lights.size(), weber < 0.025 ? 40u : 30u);
    for (const PublishedLight& l : split.lights) {
      double nearest = 180;
      for (const Sun& sun : suns) nearest = std::min(nearest, angleBetween(l.direction, sun.towards));
      EXPECT_LT(nearest, 0.1);
      EXPECT_NEAR(l.irradiance.x, 1.0, 0.06);  // lamps of a degree are a little broader than points
    }
    EXPECT_NEAR(split.given.x / split.flux.x, 1.0, 1e-5);
    s.lights = 5;
    EXPECT_EQ(publishedSplit(*map, s, arena).lights.size(), 5u);
    s.lights = 0;
    EXPECT_EQ(publishedSplit(*map, s, arena).used, split.full);  // plain harmonics
  }
}

TEST(PublishedSplit, HardMapsGiveNumbers) {
  const TaskArena arena(2);
  Image one(512, 256, 3);
  std::fill(one.data.begin(), one.data.end(), 1.0f);
  for (size_t c = 0; c < 3; ++c) one.data[3 * (70 * 512 + 300) + c] = 1e6f;
  const EnvironmentPtr sun = makeEnvironment("one texel", std::move(one));
  const EnvironmentPtr plateau = mapOf([](const DVec3&d) { return d.y > 0.8 ? 40.0 : 1.0; }, {}, 256),
                       broad = mapOf(
                           [](const DVec3&d) {
                             const double t = angleBetween(d, glm::normalize(DVec3(0.5, 0.7, 0.3))) / 30;
                             return 1 + 2 * std::exp(-0.5 * t * t);
                           },
                           {}, 256);
  const std::vector<EnvironmentPtr> maps{
      constantEnvironment(Vec3(0.0f)), constantEnvironment(Vec3(3.0f)), constantEnvironment(Vec3(1e20f)), sun, plateau, broad};
  for (size_t m = 0; m < maps.size(); ++m)
    for (const Power power : {Power::Published, Power::Residual, Power::Least, Power::NonNegative})
      for (const Window window : {Window::None, Window::Least})
        for (const Radius radius : {Radius::Fixed, Radius::Basin, Radius::Best, Radius::Curvature}) {
          if (window == Window::Least && power != Power::Published && power != Power::Residual) continue;
          if (radius != Radius::Fixed && (m < 3 || window == Window::Least)) continue;
          // Every power with every radius and every window, each of these under a share of the maps.
          const int k = int(m) + int(power) + int(radius) + int(window == Window::Least);
          if (!testing::thorough() && k % (radius == Radius::Fixed ? 2 : 3) != 0) continue;
          PublishedSettings s = with(power, 4, window);
          s.peaks.radius = radius;
          const PublishedSplit split = publishedSplit(*maps[m], s, arena);
          ASSERT_EQ(split.used.size(), 48u);
          for (const double c : split.used) ASSERT_TRUE(std::isfinite(c)) << m;
          ASSERT_TRUE(std::isfinite(split.squared) && std::isfinite(split.least));
          if (m < 3) { EXPECT_TRUE(split.lights.empty()) << m; }
          if (m == 3) { EXPECT_EQ(split.lights.size(), 1u); }
          if (m == 5) { EXPECT_LE(split.lights.size(), 1u); }
          for (const PublishedLight& l : split.lights) {
            EXPECT_TRUE(std::isfinite(l.irradiance.x) && l.radius >= kLeastRadius && l.radius <= kMostRadius);
            if (power != Power::Least) { EXPECT_GE(l.radiance.x, 0); }
          }
          if (power == Power::Residual && m > 0) { EXPECT_NEAR(split.given.x / split.flux.x, 1.0, 1e-5) << m; }
        }
  // An overcast sky with a broad bright side is what harmonics are for: no light, or one that does not harm.
  const PublishedSplit sky = publishedSplit(*broad, with(Power::Residual), arena);
  std::vector<Against> found;
  EXPECT_LE(irradianceErrors(irradiances(*broad), {{&sky.used, &sky.lights}}, 5, found).rms, 0.002);
}

TEST(PublishedSplit, ThreadsDoNotMatterAndAStopEndsIt) {
  const EnvironmentPtr map = mapOf(1.0, {{glm::normalize(DVec3(1, 2, 3)), 1.0, 4.0}, {glm::normalize(DVec3(-1, 2, -3)), 2.0, 3.0}}, 256);
  for (const Power power : {Power::Published, Power::Residual, Power::Least, Power::NonNegative}) {
    const PublishedSplit a = publishedSplit(*map, with(power), TaskArena(1)), b = publishedSplit(*map, with(power), TaskArena(3));
    EXPECT_EQ(a.used, b.used);
    ASSERT_EQ(a.lights.size(), b.lights.size());
    for (size_t i = 0; i < a.lights.size(); ++i) EXPECT_EQ(a.lights[i].irradiance, b.lights[i].irradiance);
  }
  StopSource stopped;
  stopped.stop(StopReason::Cancelled);
  EXPECT_TRUE(publishedSplit(*map, {}, TaskArena(2), stopped.token()).full.empty());
}

// Channels are the map's: a red sun over a blue sky gives a red light, none of whose channels is below 0 (its harmonics show more blue than there is).
TEST(PublishedSplit, ColoursOfLightsAreTheSources) {
  const EnvironmentPtr grey = mapOf(0.0, {{glm::normalize(DVec3(1, 2, 3)), 0.5, 1.0}}, 512);
  Image image(512, 256, 3);
  for (size_t i = 0; i < grey->texels.size(); ++i) {
    image.data[3 * i] = 8 * grey->texels[i].x;
    image.data[3 * i + 1] = 2 * grey->texels[i].x;
    image.data[3 * i + 2] = grey->texels[i].x > 0 ? 0.0f : 0.5f;
  }
  const EnvironmentPtr map = makeEnvironment("red sun", std::move(image));
  for (const Power power : {Power::Published, Power::Residual}) {
    const PublishedSplit split = publishedSplit(*map, with(power), TaskArena(2));
    ASSERT_EQ(split.lights.size(), 1u);
    EXPECT_NEAR(split.lights[0].radiance.x / split.lights[0].radiance.y, 4.0, 0.02);
    EXPECT_EQ(split.lights[0].radiance.z, 0.0);
  }
}

}  // namespace
}  // namespace gobo::transfer::published::lights_test
