// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>

#include "base/check.h"
#include "measure/display.h"
#include "measure/perceptual.h"

namespace gobo {
inline namespace measure {
namespace {

constexpr int kTaps = 11;

struct Moments {
  double a = 0, b = 0, aa = 0, bb = 0, ab = 0;
};

void add(Moments& m, double weight, const Moments& o) {
  m.a += weight * o.a, m.b += weight * o.b, m.aa += weight * o.aa, m.bb += weight * o.bb, m.ab += weight * o.ab;
}

double similarity(const Moments& m) {
  constexpr double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
  const double varianceA = m.aa - m.a * m.a, varianceB = m.bb - m.b * m.b, covariance = m.ab - m.a * m.b;
  return (2 * m.a * m.b + c1) * (2 * covariance + c2) / ((m.a * m.a + m.b * m.b + c1) * (varianceA + varianceB + c2));
}

std::array<double, kTaps> window() {
  std::array<double, kTaps> g;
  double sum = 0;
  for (int i = 0; i < kTaps; ++i) sum += g[i] = std::exp(-(i - 5) * (i - 5) / (2 * 1.5 * 1.5));
  for (double& w : g) w /= sum;
  return g;
}

}  // namespace

double structuralSimilarity(const Image& a, const Image& b) {
  GOBO_CHECK(a.width == b.width && a.height == b.height && a.pixels() > 0);
  const int w = a.width, h = a.height;
  std::vector<Moments> pixels(a.pixels());
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const double p = displayLuma(a.rgb(x, y)), q = displayLuma(b.rgb(x, y));
      pixels[size_t(y) * w + x] = {p, q, p * p, q * q, p * q};
    }
  if (w < kTaps || h < kTaps) {
    Moments all;
    for (const Moments& m : pixels) add(all, 1.0 / double(pixels.size()), m);
    return similarity(all);
  }
  const auto g = window();
  const int columns = w - kTaps + 1, rows = h - kTaps + 1;
  std::vector<Moments> across(size_t(columns) * h);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < columns; ++x)
      for (int k = 0; k < kTaps; ++k) add(across[size_t(y) * columns + x], g[k], pixels[size_t(y) * w + x + k]);
  double sum = 0;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      Moments m;
      for (int k = 0; k < kTaps; ++k) add(m, g[k], across[size_t(y + k) * columns + x]);
      sum += similarity(m);
    }
  return sum / (double(columns) * rows);
}

}  // namespace measure
}  // namespace gobo
