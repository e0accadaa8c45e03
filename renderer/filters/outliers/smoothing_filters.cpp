// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/smoothing_filters.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace gobo::outliers {

namespace {

double squaredApart(const double* p, const double* q) {
  double sum = 0;
  for (int c = 0; c < 3; ++c) sum += (p[c] - q[c]) * (p[c] - q[c]);
  return sum;
}
std::vector<float> asFloats(const std::vector<double>& v) {
  std::vector<float> out(v.size());
  for (size_t i = 0; i < v.size(); ++i) out[i] = float(std::clamp(v[i], -3.4e38, 3.4e38));
  return out;
}

}  // namespace

std::vector<float> bilateralFilter(const std::vector<float>& rgb, int width, int height, double space, double range) {
  const std::vector<double> in(rgb.begin(), rgb.end());
  std::vector<double> out(in.size());
  const int reach = int(std::ceil(2 * space));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double* own = &in[3 * (size_t(y) * size_t(width) + size_t(x))];
      double sum[3] = {}, weights = 0;
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, height - 1); ++v)
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, width - 1); ++u) {
          const double* other = &in[3 * (size_t(v) * size_t(width) + size_t(u))];
          const double away = double((u - x) * (u - x) + (v - y) * (v - y)) / (space * space);
          const double w = std::exp(-0.5 * (away + squaredApart(own, other) / (range * range)));
          weights += w;
          for (int c = 0; c < 3; ++c) sum[c] += w * other[c];
        }
      for (size_t c = 0; c < 3; ++c) out[3 * (size_t(y) * size_t(width) + size_t(x)) + c] = sum[c] / weights;
    }
  return asFloats(out);
}

std::vector<float> anisotropicDiffusion(const std::vector<float>& rgb, int width, int height, int steps, double edge) {
  std::vector<double> now(rgb.begin(), rgb.end()), next;
  for (int step = 0; step < steps; ++step) {
    next = now;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const size_t p = 3 * (size_t(y) * size_t(width) + size_t(x));
        // To the right and down: what one pixel gives the other takes.
        for (const bool right : {true, false}) {
          if (right ? x + 1 >= width : y + 1 >= height) continue;
          const size_t q = p + 3 * (right ? 1 : size_t(width));
          const double w = 0.25 * std::exp(-squaredApart(&now[p], &now[q]) / (edge * edge));
          for (size_t c = 0; c < 3; ++c) {
            const double flow = w * (now[q + c] - now[p + c]);
            next[p + c] += flow;
            next[q + c] -= flow;
          }
        }
      }
    now.swap(next);
  }
  return asFloats(now);
}

}  // namespace gobo::outliers
