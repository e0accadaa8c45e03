// SPDX-License-Identifier: Apache-2.0
// Terms that denoisers read, made by hand: one plane that faces the viewer, with whatever light.
#pragma once

#include <functional>
#include <memory>

#include "base/sobol.h"
#include "terms/term.h"

namespace gobo::tests {

/// Features of a floor of albedo `albedo` whose pixels are 1 m wide.
inline std::shared_ptr<Term> flatFeatures(int width, int height, float albedo = 0.5f) {
  auto t = std::make_shared<Term>("denoise_features", Domain::Pixel, Extent{width, height, 1});
  const auto a = t->addPlane<float>("albedo", 3), n = t->addPlane<float>("normal", 3), x = t->addPlane<float>("position", 3);
  const auto m = t->addPlane<float>("modulation", 3);
  const auto d = t->addPlane<float>("depth"), f = t->addPlane<float>("footprint"), c = t->addPlane<float>("coverage");
  for (int p = 0; p < width * height; ++p) {
    for (int k = 0; k < 3; ++k) {
      a[size_t(3 * p + k)] = albedo;
      m[size_t(3 * p + k)] = albedo + 0.04f;
    }
    n[size_t(3 * p + 2)] = 1;
    x[size_t(3 * p)] = float(p % width);
    x[size_t(3 * p + 1)] = float(p / width);
    d[size_t(p)] = 10;
    f[size_t(p)] = 1;
    c[size_t(p)] = 1;
  }
  return t;
}

inline std::shared_ptr<Term> picture(int width, int height, const std::function<float(int x, int y, int channel)>& value) {
  auto t = std::make_shared<Term>("picture", Domain::Pixel, Extent{width, height, 1});
  const auto rgb = t->addPlane<float>("rgb", 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) rgb[size_t(3 * (y * width + x) + c)] = value(x, y, c);
  return t;
}

/// Standard normal, by counters.
inline double gaussian(uint64_t a, uint64_t b) {
  double sum = -6;  // of twelve uniform numbers
  for (uint64_t i = 0; i < 12; ++i) sum += double(hash64(a * 12 + i, b) >> 11) * 0x1p-53;
  return sum;
}

}  // namespace gobo::tests
