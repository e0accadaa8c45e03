// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/white.h"

#include <algorithm>
#include <array>
#include <vector>

#include "base/vec.h"

namespace gobo::outliers {

namespace {

constexpr float kGrey = 0.18f;
constexpr float kLeastWhite = 1e-12f, kMostWhite = 1e12f;  // what path density takes

}  // namespace

Result<float> whiteOf(std::span<const float> rgb, int width, int height, const TaskArena& arena, const StopToken& stop) {
  std::vector<float> light(size_t(width) * size_t(height));
  const bool complete = arena.parallelFor(
      size_t(height), 4,
      [&](size_t begin, size_t end) {
        for (int y = int(begin); y < int(end) && !stop.stopRequested(); ++y)
          for (int x = 0; x < width; ++x) {
            Vec3 calm(0.0f);
            for (int c = 0; c < 3; ++c) {
              std::array<float, 9> window;
              int n = 0;
              for (int v = std::max(y - 1, 0); v <= std::min(y + 1, height - 1); ++v)
                for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width - 1); ++u)
                  window[size_t(n++)] = rgb[3 * (size_t(v) * size_t(width) + size_t(u)) + size_t(c)];
              std::partial_sort(window.begin(), window.begin() + n / 2 + 1, window.begin() + n);
              calm[c] = 0.5f * window[size_t(n - 1) / 2] + 0.5f * window[size_t(n) / 2];
            }
            light[size_t(y) * size_t(width) + size_t(x)] = luminance(calm);
          }
      },
      stop);
  if (!complete || stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  light.erase(std::remove_if(light.begin(), light.end(), [](float l) { return !(l > 0.0f); }), light.end());
  if (light.empty()) return 1.0f;
  const auto middle = light.begin() + ptrdiff_t(light.size() / 2);
  std::nth_element(light.begin(), middle, light.end());
  return std::clamp(*middle / kGrey, kLeastWhite, kMostWhite);
}

}  // namespace gobo::outliers
