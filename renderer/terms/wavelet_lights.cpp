// SPDX-License-Identifier: Apache-2.0
#include "terms/wavelet_lights.h"

#include <algorithm>
#include <unordered_set>

#include "base/sobol.h"

namespace gobo {
inline namespace terms {
namespace {

constexpr uint32_t kMostPoints = 1u << 20;  // whatever the lights asked for: a list must not depend on how long it is

/// Chooses the second of two parts by where `u` lies, and stretches that part of [0,1) over all of it.
bool inSecond(double first, double second, double& u) {
  const double share = first / (first + second);
  if (u < share) {
    u = std::min(u / share, 0x1.fffffffffffffp-1);
    return false;
  }
  u = std::clamp((u - share) / (1.0 - share), 0.0, 0x1.fffffffffffffp-1);
  return true;
}

}  // namespace

LuminancePyramid::LuminancePyramid(const Environment& map, const StopToken& stop) {
  const EnvironmentTents tents(map.width, map.height);
  Level texels{map.width, map.height, std::vector<double>(size_t(map.width) * size_t(map.height), 0.0)};
  for (int y = 0; y < map.height && !stop.stopRequested(); ++y)
    for (int x = 0; x < map.width; ++x) {
      const size_t t = size_t(y) * size_t(map.width) + size_t(x);
      const DVec3 c(map.texels[t]);
      texels.sums[t] = (0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z) * tents.weight(y);
      lit_ += texels.sums[t] > 0.0;
    }
  levels_.push_back(std::move(texels));
  while (levels_.back().width > 1 || levels_.back().height > 1) {
    const Level& fine = levels_.back();
    Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}};
    coarse.sums.resize(size_t(coarse.width) * size_t(coarse.height));
    for (int y = 0; y < coarse.height && !stop.stopRequested(); ++y)
      for (int x = 0; x < coarse.width; ++x)
        coarse.sums[size_t(y) * size_t(coarse.width) + size_t(x)] =
            (fine.at(2 * x, 2 * y) + fine.at(2 * x + 1, 2 * y)) + (fine.at(2 * x, 2 * y + 1) + fine.at(2 * x + 1, 2 * y + 1));
    levels_.push_back(std::move(coarse));
  }
}

uint32_t LuminancePyramid::warp(double u, double v) const {
  int x = 0, y = 0;
  for (size_t k = levels_.size() - 1; k-- > 0;) {
    const Level& l = levels_[k];
    x *= 2;
    y *= 2;
    if (inSecond(l.at(x, y) + l.at(x + 1, y), l.at(x, y + 1) + l.at(x + 1, y + 1), v)) ++y;
    if (inSecond(l.at(x, y), l.at(x + 1, y), u)) ++x;
  }
  return uint32_t(y) * uint32_t(levels_[0].width) + uint32_t(x);
}

std::vector<MapLight> waveletLights(const Environment& map, int lights, const TaskArena* arena, const StopToken& stop) {
  TexelCells cells(map, arena);
  const LuminancePyramid pyramid(map, stop);
  if (stop.stopRequested() || !(pyramid.total() > 0.0)) return {};
  std::unordered_set<uint32_t> met;
  const size_t most = std::min(size_t(std::max(lights, 0)), pyramid.lit());
  for (uint32_t i = 0; i < kMostPoints && met.size() < most; ++i) {
    if (i % 1024 == 0 && stop.stopRequested()) return {};
    // Half a square further than Sobol's own points, whose first is a corner: the first light is at the median. Nets stay nets.
    const uint32_t half = 0x80000000u;
    const uint32_t texel = pyramid.warp(double(sobolBits(i, 0) ^ half) * 0x1p-32, double(sobolBits(i, 1) ^ half) * 0x1p-32);
    if (met.insert(texel).second) cells.add(texel, stop);
  }
  return cells.lights(stop);
}

}  // namespace terms
}  // namespace gobo
