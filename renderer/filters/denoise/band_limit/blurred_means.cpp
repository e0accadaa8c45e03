// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/band_limit/blurred_means.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include "filters/denoise/band_limit/blurred_means_kernels.h"
#include "filters/denoise/band_limit/lens_blur.h"
#include "filters/denoise/non_local_means/weighted_rows.h"

namespace gobo::denoise {

namespace {

constexpr int kBandRows = 8;  // of a task
constexpr float kMostExponent = 0.5f * kBandReach * kBandReach;

}  // namespace

int bandRadius(float share) { return int(std::floor(kBandReach * share * kMostBlur)); }

bool bandLimitedMeans(std::span<const float> blur, float share, int width, int height, std::span<const float* const> from, std::span<float* const> to,
                      const TaskArena& arena, const StopToken& stop) {
  const int radius = bandRadius(share);
  const size_t w = size_t(width), channels = from.size();
  // 1 / (2 s^2), and of each row the smallest.
  std::vector<float> inverse(blur.size()), widest(static_cast<size_t>(height));
  if (!arena.parallelFor(
          size_t(height), 16,
          [&](size_t begin, size_t end) {
            for (size_t y = begin; y < end; ++y) {
              float least = 1e30f;
              for (size_t i = y * w; i < (y + 1) * w; ++i) {
                const float s = share * blur[i];
                inverse[i] = 1.0f / std::max(2.0f * s * s, 1e-30f);
                least = std::min(least, inverse[i]);
              }
              widest[y] = least;
            }
          },
          stop))
    return false;
  std::atomic<bool> stopped{false};
  const bool complete = arena.parallelFor(
      size_t(height + kBandRows - 1) / kBandRows, 1,
      [&](size_t tile, size_t) {
        std::vector<float> weights(w), sums((channels + 1) * w);
        for (int y = int(tile) * kBandRows; y < std::min(int(tile + 1) * kBandRows, height); ++y) {
          if (stop.stopRequested()) {
            stopped = true;
            return;
          }
          std::fill(sums.begin(), sums.end(), 0.0f);
          for (int dy = -radius; dy <= radius; ++dy) {
            const int v = y + dy;
            if (v < 0 || v >= height) continue;
            const float narrower = std::max(widest[size_t(y)], widest[size_t(v)]);
            if (float(dy * dy) * narrower > kMostExponent) continue;
            for (int dx = -radius; dx <= radius; ++dx) {
              const float square = float(dx * dx + dy * dy);
              if (square * narrower > kMostExponent) continue;
              const int left = std::max(0, -dx), count = std::min(width, width - dx) - left;
              if (count <= 0) continue;
              const size_t at = size_t(left), there = size_t(v) * w + size_t(left + dx);
              bandWeights(&inverse[size_t(y) * w + at], &inverse[there], square, kMostExponent, count, weights.data());
              for (size_t c = 0; c < channels; ++c) addWeightedRow(weights.data(), from[c] + there, count, &sums[c * w + at]);
              addRow(weights.data(), count, &sums[channels * w + at]);
            }
          }
          for (size_t c = 0; c < channels; ++c)
            for (size_t x = 0; x < w; ++x) to[c][size_t(y) * w + x] = sums[c * w + x] / sums[channels * w + x];
        }
      },
      stop);
  return complete && !stopped;
}

}  // namespace gobo::denoise
