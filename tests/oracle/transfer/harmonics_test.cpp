// SPDX-License-Identifier: Apache-2.0
// Harmonics against their own theory, an environment's coefficients against brute force over its bilinear look-up.
#include "techniques/transfer/harmonics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "base/sobol.h"
#include "techniques/transfer/environment_harmonics.h"

namespace gobo::transfer::harmonics_test {
namespace {

constexpr int kBands = kMaxBands, kCount = kMaxHarmonics;
const double kOne = std::sqrt(4 * std::numbers::pi);  // the coefficient of radiance 1

/// Sum over the sphere of f(direction) times solid angle, by midpoints.
template <typename F>
void overSphere(int rows, F&& f) {
  const double d = std::numbers::pi / rows;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < 2 * rows; ++x) {
      const double theta = (y + 0.5) * d, phi = (x + 0.5) * d, s = std::sin(theta);
      f(DVec3(s * std::cos(phi), std::cos(theta), s * std::sin(phi)), 2.0 * s * std::sin(0.5 * d) * d);
    }
}

DVec3 randomDirection(uint64_t i) {
  const double y = 2.0 * toUnit(hash32(7, 2 * i)) - 1.0, a = 2 * std::numbers::pi * toUnit(hash32(7, 2 * i + 1)), s = std::sqrt(1 - y * y);
  return {s * std::cos(a), y, s * std::sin(a)};
}

TEST(TransferHarmonics, AreOrthonormal) {
  std::vector<double> gram(size_t(kCount) * kCount), Y(kCount);
  overSphere(256, [&](const DVec3& d, double w) {
    harmonics(d, kBands, Y.data());
    for (size_t i = 0; i < kCount; ++i)
      for (size_t j = 0; j <= i; ++j) gram[i * kCount + j] += w * Y[i] * Y[j];
  });
  for (size_t i = 0; i < kCount; ++i)
    for (size_t j = 0; j <= i; ++j) EXPECT_NEAR(gram[i * kCount + j], i == j ? 1.0 : 0.0, 5e-4) << i << " " << j;
}

TEST(TransferHarmonics, SatisfyTheAdditionTheorem) {
  // sum over m of Y_lm(a) Y_lm(b) = (2 l + 1) / (4 pi) P_l(a.b), whatever the axes.
  std::vector<double> A(kCount), B(kCount);
  for (uint64_t i = 0; i < 200; ++i) {
    const DVec3 a = randomDirection(2 * i), b = randomDirection(2 * i + 1);
    harmonics(a, kBands, A.data());
    harmonics(b, kBands, B.data());
    double last = 0, now = 1;
    const double t = glm::dot(a, b);
    for (int l = 0; l < kBands; ++l) {
      double sum = 0;
      for (int k = l * l; k < (l + 1) * (l + 1); ++k) sum += A[size_t(k)] * B[size_t(k)];
      EXPECT_NEAR(sum, (2 * l + 1) / (4 * std::numbers::pi) * now, 1e-12) << l;
      const double next = ((2 * l + 1) * t * now - l * last) / (l + 1);
      last = now;
      now = next;
    }
  }
}

TEST(TransferHarmonics, SingleIsDoubleRounded) {
  std::vector<double> one(kCount);
  std::vector<float> many(size_t(kCount) * kLanes);
  float x[kLanes], y[kLanes], z[kLanes];
  for (int bands = 1; bands <= kBands; ++bands) {
    for (int k = 0; k < kLanes; ++k) {
      const DVec3 d = k == 0 ? DVec3(0, 1, 0) : k == 1 ? DVec3(0, -1, 0) : randomDirection(uint64_t(100 + k));
      x[k] = float(d.x);
      y[k] = float(d.y);
      z[k] = float(d.z);
    }
    harmonics16(x, y, z, bands, many.data());
    for (int k = 0; k < kLanes; ++k) {
      harmonics(DVec3(x[k], y[k], z[k]), bands, one.data());
      for (int i = 0; i < bands * bands; ++i) EXPECT_NEAR(many[size_t(i * kLanes + k)], one[size_t(i)], 4e-6) << bands << " " << i;
    }
  }
}

TEST(TransferHarmonics, CosineCoefficientsAreThoseOfTheLiterature) {
  const double pi = std::numbers::pi, known[] = {pi, 2 * pi / 3, pi / 4, 0, -pi / 24, 0, pi / 64};
  for (int l = 0; l < 7; ++l) EXPECT_NEAR(cosineCoefficient(l), known[l], 1e-12) << l;
  // and of the definition: 2 pi times the integral of t P_l(t) over [0, 1]
  for (int l = 0; l < kBands; ++l) {
    double sum = 0;
    for (int i = 0; i < 20000; ++i) {
      const double t = (i + 0.5) / 20000;
      double last = 0, now = 1;
      for (int k = 0; k < l; ++k) {
        const double next = ((2 * k + 1) * t * now - k * last) / (k + 1);
        last = now;
        now = next;
      }
      sum += t * now / 20000;
    }
    EXPECT_NEAR(2 * pi * sum, cosineCoefficient(l), 1e-7) << l;
  }
}

TEST(TransferHarmonics, TurnedCoefficientsAreOfTheTurnedMap) {
  Environment map;
  map.rotation = 0.7f;
  std::vector<float> c(kCount);
  for (size_t i = 0; i < kCount; ++i) c[i] = toUnit(hash32(3, i)) - 0.5f;
  std::vector<double> world(kCount), Y(kCount), inMap(kCount);
  turn(c, kBands, 1, double(map.rotation), world);
  for (uint64_t i = 0; i < 50; ++i) {
    const DVec3 d = randomDirection(i);
    harmonics(d, kBands, Y.data());
    const Vec2 uv = map.toUv(Vec3(d));  // where the renderer itself looks the map up
    const double phi = (double(uv.x) - 0.5) * 2 * std::numbers::pi, theta = double(uv.y) * std::numbers::pi, s = std::sin(theta);
    harmonics(DVec3(s * std::cos(phi), std::cos(theta), s * std::sin(phi)), kBands, inMap.data());
    double a = 0, b = 0;
    for (size_t k = 0; k < kCount; ++k) {
      a += world[k] * Y[k];
      b += double(c[k]) * inMap[k];
    }
    EXPECT_NEAR(a, b, 2e-5);
  }
}

TEST(EnvironmentHarmonics, AConstantIsItsMeanAlone) {
  const TaskArena arena(2);
  for (const int width : {1, 2, 5, 64}) {
    const EnvironmentPtr map = makeEnvironment("constant", [&] {
      Image image(width, std::max(1, width / 2), 3);
      for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = i % 3 == 0 ? 2.0f : 0.5f;
      return image;
    }());
    const std::vector<double> c = environmentHarmonics(*map, kBands, arena);
    ASSERT_EQ(c.size(), size_t(3 * kCount));
    for (size_t i = 0; i < c.size(); ++i) EXPECT_NEAR(c[i], i == 0 ? 2 * kOne : i < 3 ? 0.5 * kOne : 0.0, 2e-6) << width << " " << i;
  }
}

TEST(EnvironmentHarmonics, AreIntegralsOfTheLookUp) {
  const TaskArena arena(2);
  for (const auto& [width, height] : {std::pair(1, 3), std::pair(3, 1), std::pair(4, 2), std::pair(7, 5), std::pair(32, 16)}) {
    Image image(width, height, 3);
    for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = toUnit(hash32(uint64_t(width), i));
    const EnvironmentPtr map = makeEnvironment("noise", std::move(image));
    const std::vector<double> c = environmentHarmonics(*map, 6, arena);
    std::vector<double> sum(36 * 3), Y(36);
    overSphere(420, [&](const DVec3& d, double w) {
      harmonics(d, 6, Y.data());
      const Vec3 radiance = map->eval(Vec3(d));
      for (size_t i = 0; i < 36; ++i)
        for (int k = 0; k < 3; ++k) sum[3 * i + size_t(k)] += w * Y[i] * double(radiance[k]);
    });
    for (size_t i = 0; i < sum.size(); ++i) EXPECT_NEAR(c[i], sum[i], 1e-3) << width << "x" << height << " " << i;
  }
}

TEST(EnvironmentHarmonics, OneTexelOfAMillionKeepsItsFlux) {
  const TaskArena arena(2);
  for (const int row : {0, 1, 255, 511}) {
    Image image(1024, 512, 3);
    for (float& v : image.data) v = 1.0f;
    image.data[3 * (size_t(row) * 1024 + 3)] = 1e6f;
    const EnvironmentPtr map = makeEnvironment("sun", std::move(image));
    const std::vector<double> c = environmentHarmonics(*map, 4, arena), again = environmentHarmonics(*map, 4, TaskArena(1));
    EXPECT_EQ(c, again);
    const double omega =
        (std::cos(std::numbers::pi * std::max(row - 0.0, 0.0) / 512) - std::cos(std::numbers::pi * (row + 1.0) / 512)) * 2 * std::numbers::pi / 1024;
    EXPECT_NEAR((c[0] / kOne - 1.0) * 4 * std::numbers::pi / (1e6 * omega), 1.0, row % 511 ? 0.01 : 0.6) << row;  // poles: the tent is wider than the texel
    EXPECT_NEAR(c[1], kOne, 1e-3);
  }
}

}  // namespace
}  // namespace gobo::transfer::harmonics_test
