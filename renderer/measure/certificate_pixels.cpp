// SPDX-License-Identifier: Apache-2.0
#include "measure/certificate_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/check.h"
#include "base/sobol.h"

namespace gobo {
inline namespace measure {

namespace {

constexpr int kReach = 2;  // of a window, pixels
constexpr int kNeighbours = (2 * kReach + 1) * (2 * kReach + 1) - 1;

constexpr size_t kPoll = 1 << 16;  // pixels between two looks at a stop token, in plain sums

/// In [0, 1), from a hash.
double uniform(uint64_t hash) { return double(hash >> 11) * 0x1p-53; }

/// The k-th of several independent draws of a seed.
struct Draws {
  uint64_t seed, count = 0;
  double next() { return uniform(hash64(seed, count++)); }
};

}  // namespace

std::vector<float> forecastError(std::span<const float> rgb, int width, int height, const StopToken& stop) {
  GOBO_CHECK(rgb.size() == size_t(width) * height * 3);
  const size_t all = size_t(width) * height;
  // Grown row by row, not cleared at once: first touches of tens of MB take longer than what is computed.
  std::vector<float> grey, outlier, rows, forecast;
  for (std::vector<float>* v : {&grey, &outlier, &rows, &forecast}) v->reserve(all);
  for (size_t i = 0; i < all; ++i) {
    if (i % kPoll == 0 && stop.stopRequested()) return {};
    grey.push_back((rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) / 3.0f);
  }
  const auto at = [&](int x, int y) { return size_t(std::clamp(y, 0, height - 1)) * width + std::clamp(x, 0, width - 1); };
  for (int y = 0; y < height && !stop.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) {
      std::array<float, kNeighbours> around;
      int n = 0;
      for (int v = -kReach; v <= kReach; ++v)
        for (int u = -kReach; u <= kReach; ++u)
          if (u != 0 || v != 0) {
            const float g = grey[at(x + u, y + v)];
            around[n++] = std::isfinite(g) ? g : 0.0f;  // an order needs numbers
          }
      std::nth_element(around.begin(), around.begin() + kNeighbours / 2, around.end());
      const float d = grey[at(x, y)] - around[kNeighbours / 2], square = d * d;
      outlier.push_back(std::isfinite(square) ? square : 0.0f);
    }
  for (int y = 0; y < height && !stop.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) {
      float sum = 0;
      for (int u = -kReach; u <= kReach; ++u) sum += outlier[at(x + u, y)] / (2 * kReach + 1);
      rows.push_back(sum);
    }
  for (int y = 0; y < height && !stop.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) {
      float sum = 0;
      for (int v = -kReach; v <= kReach; ++v) sum += rows[at(x, y + v)] / (2 * kReach + 1);
      forecast.push_back(0.5f * outlier[at(x, y)] + 0.5f * sum);
    }
  return forecast;
}

std::vector<float> drawingChances(std::span<const float> forecast, double wanted, const StopToken& stop) {
  const double all = double(forecast.size());
  GOBO_CHECK(wanted >= 0 && wanted <= all);
  std::vector<float> chances(forecast.size(), forecast.empty() ? 0.0f : float(wanted / all));
  double largest = 0;
  for (float f : forecast) largest = std::max(largest, double(f));
  if (wanted >= all || wanted == 0 || !(largest > 0) || !std::isfinite(largest)) return chances;
  const double least = kEvenShare * wanted / all;
  const auto total = [&](double scale) {
    double sum = 0;
    for (size_t i = 0; i < forecast.size(); ++i) {
      if (i % kPoll == 0 && stop.stopRequested()) break;
      sum += std::clamp(scale * double(forecast[i]), least, 1.0);
    }
    return sum;
  };
  // total() grows with the scale from below `wanted` to the number of pixels with a forecast (the others keep the least).
  double low = least / largest, high = low;
  while (high < 1e280 && !stop.stopRequested() && total(high) < wanted) low = high, high *= 8;
  if (total(high) < wanted) {  // too few pixels have a forecast: they for certain, the rest evenly
    size_t certain = 0;
    for (float f : forecast) certain += f > 0;
    for (size_t i = 0; i < forecast.size(); ++i) chances[i] = forecast[i] > 0 ? 1.0f : float((wanted - double(certain)) / (all - double(certain)));
    return chances;
  }
  for (int i = 0; i < 60 && !stop.stopRequested(); ++i) {
    const double middle = std::sqrt(low * high), sum = total(middle);
    if (std::fabs(sum - wanted) <= 1e-6 * wanted) {
      high = middle;
      break;
    }
    (sum < wanted ? low : high) = middle;
  }
  for (size_t i = 0; i < forecast.size(); ++i) chances[i] = float(std::clamp(high * double(forecast[i]), least, 1.0));
  return chances;
}

std::vector<uint32_t> drawPixels(int width, int height, std::span<const float> chances, uint64_t seed, const StopToken& stop) {
  const uint64_t w = uint64_t(width), h = uint64_t(height), all = w * h;
  GOBO_CHECK(chances.size() == all && all <= UINT32_MAX);
  double sum = 0;
  for (float c : chances) sum += double(c);
  std::vector<uint32_t> pixels;
  if (!(sum > 0)) return pixels;
  // Bands as high as a pixel's share of the picture is wide; along a band column by column, bands in alternating directions.
  const uint64_t bands = std::clamp<uint64_t>(uint64_t(std::lround(double(h) / std::sqrt(double(all) / sum))), 1, h);
  Draws draws{hash64(seed, 0x7069766f74616cull)};
  // Pivotal sampling: one pixel with an undecided chance meets the next; their chances become (0, a + b) or, where that is above
  // 1, (1, a + b - 1), in either order so that each keeps its chance on the average.
  double open = 0;
  uint32_t holder = 0;
  const auto meet = [&](uint32_t pixel, double chance) {
    if (chance >= 1) {
      pixels.push_back(pixel);
      return;
    }
    const double both = open + chance;
    if (both <= 0) return;
    if (both < 1) {
      if (draws.next() * both < chance) holder = pixel;
      open = both;
    } else {
      // One is drawn; the other goes on with the rest. The holder is drawn with chance (1 - chance) / (2 - both).
      const bool keep = draws.next() * (2 - both) < 1 - chance;
      pixels.push_back(keep ? holder : pixel);
      if (keep) holder = pixel;
      open = both - 1;
    }
  };
  for (uint64_t band = 0; band < bands && !stop.stopRequested(); ++band) {
    const uint64_t top = band * h / bands, end = (band + 1) * h / bands;
    for (uint64_t c = 0; c < w; ++c)
      for (uint64_t y = top; y < end; ++y) {
        const uint32_t pixel = uint32_t(y * w + (band % 2 ? w - 1 - c : c));
        meet(pixel, double(chances[pixel]));
      }
  }
  if (draws.next() < open) pixels.push_back(holder);  // what rounding leaves of the sum
  std::sort(pixels.begin(), pixels.end());
  return pixels;
}

}  // namespace measure
}  // namespace gobo
