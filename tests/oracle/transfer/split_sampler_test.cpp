// SPDX-License-Identifier: Apache-2.0
// The split of a map as a sampler: densities are those of what is drawn, irradiance is the map's own, and how far from it a few samples are beside the map's
// own sampler.
#include "techniques/transfer/split_sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/sobol.h"
#include "trace/environment_distribution.h"

namespace gobo::transfer::split_sampler_test {
namespace {

/// A sun, a softbox and a bright horizon, over six orders of magnitude.
EnvironmentPtr skyOf() {
  Image image(512, 256, 3);
  const DVec3 sun = glm::normalize(DVec3(0.3, 0.8, -0.4)), box = glm::normalize(DVec3(-0.9, 0.2, 0.5));
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 512; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / 256, phi = (x + 0.5) * std::numbers::pi / 256 - std::numbers::pi;
      const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
      const double v = 0.02 + std::exp(-20 * d.y * d.y) + (glm::dot(d, box) > std::cos(0.25) ? 12.0 : 0.0) + (glm::dot(d, sun) > std::cos(0.015) ? 9e3 : 0.0);
      for (size_t k = 0; k < 3; ++k) image.data[3 * size_t(y * 512 + x) + k] = float(v * (k == 0 ? 0.8 : 1.0));
    }
  return makeEnvironment("sky", std::move(image));
}

TEST(SplitSampler, ItsDensityIntegratesToOne) {
  const EnvironmentPtr map = skyOf();
  const SplitSampler sampler(splitEnvironment(*map, 5, 16, 0.02, TaskArena(2)), *map);
  double all = 0;
  constexpr int n = 1200;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < 2 * n; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / n, phi = (x + 0.5) * std::numbers::pi / n;
      all += sampler.density({std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}) * std::sin(theta);
    }
  EXPECT_NEAR(all * std::numbers::pi / n * std::numbers::pi / n, 1.0, 2e-3);
}

TEST(SplitSampler, IrradianceIsTheMapsWhateverTheLightsMiss) {
  const EnvironmentPtr map = skyOf();
  const EnvironmentDistribution own(map);
  std::vector<std::pair<DVec3, double>> places;  // two by two of each texel, and the radiance there times what is around it
  for (int v = 0; v < 512; ++v)
    for (int h = 0; h < 1024; ++h) {
      const double theta = (v + 0.5) * std::numbers::pi / 512, azimuth = (h + 0.5) * std::numbers::pi / 512 - std::numbers::pi;
      const DVec3 d(std::sin(theta) * std::cos(azimuth), std::cos(theta), std::sin(theta) * std::sin(azimuth));
      places.emplace_back(d, double(map->eval(Vec3(d)).y) * std::sin(theta) * (std::numbers::pi / 512) * (std::numbers::pi / 512));
    }
  std::vector<double> truths;  // by normal
  for (const int lights : {0, 1, 16}) {
    const SplitSampler sampler(splitEnvironment(*map, 5, lights, 0.02, TaskArena(2)), *map);
    double byOwn = 0, bySplit = 0, truthSquared = 0;
    for (uint32_t k = 0; k < 24; ++k) {
      const Vec2 q = SobolSampler(21, k).next2D();
      const double y = 1 - 2 * double(q.x), r = std::sqrt(1 - y * y), phi = 2 * std::numbers::pi * double(q.y);
      const DVec3 normal(r * std::cos(phi), y, r * std::sin(phi));
      if (truths.size() <= k) {
        double sum = 0;
        for (const auto& [d, radiance] : places) sum += radiance * std::max(d.x * normal.x + d.y * normal.y + d.z * normal.z, 0.0);
        truths.push_back(sum);
      }
      const double truth = truths[k];
      // Blocks of 64 samples, whose spread bounds the error of their mean.
      constexpr int kBlocks = 64, kSamples = 64;
      double sum = 0, squares = 0, ownSquares = 0;
      for (uint32_t b = 0; b < kBlocks; ++b) {
        double mean = 0, ownMean = 0;
        for (uint32_t i = 0; i < kSamples; ++i) {
          const Vec2 u = SobolSampler(hash64(k, b), i).next2D();
          DVec3 d;
          double density;
          if (sampler.sample(u, d, density)) mean += double(map->eval(Vec3(d)).y) * std::max(glm::dot(d, normal), 0.0) / density / kSamples;
          Vec3 direction, radiance;
          float pdf;
          if (own.sample(u, direction, radiance, pdf))
            ownMean += double(radiance.y) * std::max(glm::dot(DVec3(direction), normal), 0.0) / double(pdf) / kSamples;
        }
        sum += mean / kBlocks;
        squares += (mean - truth) * (mean - truth) / kBlocks;
        ownSquares += (ownMean - truth) * (ownMean - truth) / kBlocks;
      }
      EXPECT_LT(std::fabs(sum - truth), 4.5 * std::sqrt(squares / kBlocks) + 2e-3 * truth) << lights << " lights, normal " << k;
      bySplit += squares;
      byOwn += ownSquares;
      truthSquared += truth * truth;
    }
    std::printf("  %2d lights: RMSE of 64 samples %.4f of the irradiance, the map's own sampler %.4f\n", lights, std::sqrt(bySplit / truthSquared),
                std::sqrt(byOwn / truthSquared));
  }
  const SplitSampler black(splitEnvironment(*constantEnvironment(Vec3(0.0f)), 5, 16, 0.02, TaskArena(2)), *constantEnvironment(Vec3(0.0f)));
  DVec3 d;
  double density;
  EXPECT_FALSE(black.sample(Vec2(0.3f, 0.6f), d, density));
}

}  // namespace
}  // namespace gobo::transfer::split_sampler_test
