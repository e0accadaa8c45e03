// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/picture_filters.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace gobo::outliers {

namespace {

size_t pixelOf(int width, int x, int y) { return size_t(y) * size_t(width) + size_t(x); }

double medianOf(std::vector<double>& v) {
  const size_t middle = v.size() / 2;
  std::nth_element(v.begin(), v.begin() + ptrdiff_t(middle), v.end());
  if (v.size() % 2) return v[middle];
  return 0.5 * (v[middle] + *std::max_element(v.begin(), v.begin() + ptrdiff_t(middle)));
}
/// result(window of a channel, its own value) of every value. The window may be reordered.
template <class F>
std::vector<float> byWindow(const std::vector<float>& rgb, int width, int height, int radius, F&& result) {
  std::vector<float> out(rgb.size());
  std::vector<double> window;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (size_t c = 0; c < 3; ++c) {
        window.clear();
        for (int v = std::max(y - radius, 0); v <= std::min(y + radius, height - 1); ++v)
          for (int u = std::max(x - radius, 0); u <= std::min(x + radius, width - 1); ++u) window.push_back(double(rgb[3 * pixelOf(width, u, v) + c]));
        const size_t i = 3 * pixelOf(width, x, y) + c;
        out[i] = float(result(window, double(rgb[i])));
      }
  return out;
}
double luminanceAt(const std::vector<float>& rgb, size_t p) {
  return 0.2126 * double(rgb[3 * p]) + 0.7152 * double(rgb[3 * p + 1]) + 0.0722 * double(rgb[3 * p + 2]);
}

}  // namespace

std::vector<float> medianFilter(const std::vector<float>& rgb, int width, int height, int radius) {
  return byWindow(rgb, width, height, radius, [](std::vector<double>& window, double) { return medianOf(window); });
}

std::vector<float> medianOfOutliers(const std::vector<float>& rgb, int width, int height, int radius, double factor) {
  return byWindow(rgb, width, height, radius, [factor](std::vector<double>& window, double own) {
    const double median = medianOf(window);
    for (double& v : window) v = std::abs(v - median);
    return std::abs(own - median) > factor * medianOf(window) ? median : own;
  });
}

std::vector<float> spreadOutliers(const std::vector<float>& rgb, int width, int height, double factor, int most) {
  std::vector<double> sum(rgb.begin(), rgb.end()), window;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      window.clear();
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, height - 1); ++v)
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width - 1); ++u) window.push_back(luminanceAt(rgb, pixelOf(width, u, v)));
      const size_t p = pixelOf(width, x, y);
      const double median = medianOf(window), own = luminanceAt(rgb, p), limit = factor * std::max(median, 0.0);
      if (!(own > limit) || own <= 0) continue;
      const double share = 1 - limit / own;  // of its light
      int radius = 1;
      while (radius < most && own * share > 0.1 * median * double((2 * radius + 1) * (2 * radius + 1))) ++radius;
      const int x0 = std::max(x - radius, 0), x1 = std::min(x + radius, width - 1), y0 = std::max(y - radius, 0), y1 = std::min(y + radius, height - 1);
      const double area = double(x1 - x0 + 1) * double(y1 - y0 + 1);
      for (size_t c = 0; c < 3; ++c) {
        const double excess = share * double(rgb[3 * p + c]);
        sum[3 * p + c] -= excess;
        for (int v = y0; v <= y1; ++v)
          for (int u = x0; u <= x1; ++u) sum[3 * pixelOf(width, u, v) + c] += excess / area;
      }
    }
  std::vector<float> out(rgb.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = float(std::clamp(sum[i], -3.4e38, 3.4e38));
  return out;
}

}  // namespace gobo::outliers
