// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/mean_shift.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/vec.h"
#include "filters/path_density/metric.h"

namespace gobo::outliers {

namespace {

struct ShiftedPicture {
  int width, height;
  std::vector<DVec3> light, lab;
  std::vector<char> counts;  // finite, in Lab too
};

ShiftedPicture shiftedPictureOf(const std::vector<float>& rgb, int width, int height, float white) {
  const size_t pixels = size_t(width) * size_t(height);
  ShiftedPicture p{width, height, std::vector<DVec3>(pixels), std::vector<DVec3>(pixels), std::vector<char>(pixels, 0)};
  std::vector<float> plane[3];
  for (size_t c = 0; c < 3; ++c)
    for (size_t i = 0; i < pixels; ++i) plane[c].push_back(std::isfinite(rgb[3 * i + c]) ? rgb[3 * i + c] / white : 0.0f);
  pathdensity::labOf(plane[0].data(), plane[1].data(), plane[2].data(), int(pixels));
  for (size_t i = 0; i < pixels; ++i) {
    p.light[i] = DVec3(double(rgb[3 * i]), double(rgb[3 * i + 1]), double(rgb[3 * i + 2]));
    p.lab[i] = DVec3(double(plane[0][i]), double(plane[1][i]), double(plane[2][i]));
    p.counts[i] = 1;
    for (int c = 0; c < 3; ++c) p.counts[i] = p.counts[i] && std::isfinite(p.light[i][c]) && std::isfinite(p.lab[i][c]);
  }
  return p;
}

/// The mean light where the walk of pixel (x, y) ends.
DVec3 endOfWalk(const ShiftedPicture& p, int x, int y, const MeanShift& s) {
  const size_t start = size_t(y) * size_t(p.width) + size_t(x);
  double atX = x, atY = y;
  DVec3 colour = p.lab[start], light = p.light[start];
  for (int step = 0; step < s.most; ++step) {
    double sumX = 0, sumY = 0, n = 0;
    DVec3 sumColour(0.0), sumLight(0.0);
    for (int v = std::max(int(std::ceil(atY - s.space)), 0); v <= std::min(int(std::floor(atY + s.space)), p.height - 1); ++v)
      for (int u = std::max(int(std::ceil(atX - s.space)), 0); u <= std::min(int(std::floor(atX + s.space)), p.width - 1); ++u) {
        const size_t q = size_t(v) * size_t(p.width) + size_t(u);
        const DVec3 apart = p.lab[q] - colour;
        if (!p.counts[q] || (u - atX) * (u - atX) + (v - atY) * (v - atY) > s.space * s.space || glm::dot(apart, apart) > s.range * s.range) continue;
        sumX += u;
        sumY += v;
        sumColour += p.lab[q];
        sumLight += p.light[q];
        ++n;
      }
    if (n == 0) break;  // by rounding: the density never falls on the way
    light = sumLight / n;
    const DVec3 moved = sumColour / n - colour;
    const double far = (sumX / n - atX) * (sumX / n - atX) + (sumY / n - atY) * (sumY / n - atY) + glm::dot(moved, moved);
    atX = sumX / n;
    atY = sumY / n;
    colour = sumColour / n;
    if (far < 1e-12) break;
  }
  return light;
}

}  // namespace

std::vector<float> meanShift(const std::vector<float>& rgb, int width, int height, const MeanShift& s, const Rows& rows) {
  GOBO_CHECK_LT(0.0, s.space);
  GOBO_CHECK_LT(0.0, s.range);
  GOBO_CHECK_LT(0.0f, s.white);
  GOBO_CHECK_LE(1, s.most);
  const ShiftedPicture p = shiftedPictureOf(rgb, width, height, s.white);
  std::vector<float> out = rgb;
  const auto some = [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end && !rows.stop.stopRequested(); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t i = y * size_t(width) + size_t(x);
        if (!p.counts[i]) continue;
        const DVec3 light = endOfWalk(p, x, int(y), s);
        for (int c = 0; c < 3; ++c) out[3 * i + size_t(c)] = float(std::clamp(light[c], -3.4e38, 3.4e38));
      }
  };
  if (rows.arena) rows.arena->parallelFor(size_t(height), 1, some, rows.stop);
  else some(0, size_t(height));
  return out;
}

}  // namespace gobo::outliers
