// SPDX-License-Identifier: Apache-2.0
// Clouds of path samples by counters, for tests of path density.
#pragma once

#include <functional>

#include "base/sobol.h"
#include "filters/path_density/path_samples.h"

namespace gobo::pathdensitytest {

/// Number k of sample i, in [0, 1).
inline double unit(uint64_t seed, uint64_t i, uint64_t k) { return double(hash64(seed * 1000003 + k, i) >> 11) * 0x1p-53; }

/// n samples a pixel at random places of it; `light` of the sample's number and its place.
inline pathdensity::PathSamples evenSamples(int width, int height, int n, uint64_t seed, const std::function<Vec3(uint64_t i, const Vec2& film)>& light) {
  pathdensity::PathSamples s(width, height);
  uint64_t i = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int k = 0; k < n; ++k, ++i) {
        const Vec2 film(float(x) + float(unit(seed, i, 0)), float(y) + float(unit(seed, i, 1)));
        EXPECT_TRUE(s.add(x, y, film, light(i, film), Vec3(0.0f)).ok());
      }
  return s;
}

/// As many, anywhere in the picture.
inline pathdensity::PathSamples uniformSamples(int width, int height, int n, uint64_t seed, const std::function<Vec3(uint64_t i, const Vec2& film)>& light) {
  pathdensity::PathSamples s(width, height);
  for (uint64_t i = 0; i < uint64_t(width) * uint64_t(height) * uint64_t(n); ++i) {
    const Vec2 film(float(width * unit(seed, i, 0)), float(height * unit(seed, i, 1)));
    EXPECT_TRUE(s.add(std::min(int(film.x), width - 1), std::min(int(film.y), height - 1), film, light(i, film), Vec3(0.0f)).ok());
  }
  return s;
}

/// The mean of each pixel's samples, in double.
inline std::vector<double> meansOf(const pathdensity::SampleView& v) {
  std::vector<double> sum(size_t(v.width) * size_t(v.height) * 3, 0.0), n(sum.size() / 3, 0.0);
  for (size_t i = 0; i < v.size(); ++i) {
    const size_t p = size_t(v.film[2 * i + 1]) * size_t(v.width) + size_t(v.film[2 * i]);
    n[p] += 1;
    for (size_t c = 0; c < 3; ++c) sum[3 * p + c] += double(v.direct[3 * i + c]) + double(v.indirect[3 * i + c]);
  }
  for (size_t k = 0; k < sum.size(); ++k) sum[k] /= std::max(n[k / 3], 1.0);
  return sum;
}

}  // namespace gobo::pathdensitytest
