// SPDX-License-Identifier: Apache-2.0
#include "terms/texel_cells.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/check.h"

namespace gobo {
inline namespace terms {

TexelCells::TexelCells(const Environment& map, const TaskArena* arena)
    : map_(map),
      arena_(arena),
      tents_(map.width, map.height),
      nearest_(size_t(map.width) * size_t(map.height), -2.0),
      rowFarthest_(size_t(map.height), -2.0),
      owner_(nearest_.size(), 0) {
  for (int x = 0; x < map.width; ++x) {
    const double phi = (x + 0.5) / map.width * 2.0 * std::numbers::pi - std::numbers::pi;
    cosAzimuth_.push_back(std::cos(phi));
    sinAzimuth_.push_back(std::sin(phi));
  }
  for (int y = 0; y < map.height; ++y) {
    const double theta = (y + 0.5) / map.height * std::numbers::pi;
    cosPolar_.push_back(std::cos(theta));
    sinPolar_.push_back(std::sin(theta));
  }
}

DVec3 TexelCells::direction(size_t texel) const {
  const size_t y = texel / size_t(map_.width), x = texel % size_t(map_.width);
  return {sinPolar_[y] * cosAzimuth_[x], cosPolar_[y], sinPolar_[y] * sinAzimuth_[x]};
}

double TexelCells::weight(size_t texel) const {
  const DVec3 c(map_.texels[texel]);
  return (0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z) * solidAngle(texel);
}

void TexelCells::add(uint32_t texel, const StopToken& stop) {
  GOBO_CHECK(texels_.size() < std::numeric_limits<uint16_t>::max());
  const uint16_t light = uint16_t(texels_.size());
  texels_.push_back(texel);
  const DVec3 to = direction(texel);
  const size_t width = size_t(map_.width), here = texel / width;
  const auto rows = [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end; ++y) {
      // The row's nearest place: of the light's azimuth. The guard is rounding's.
      if (sinPolar_[y] * sinPolar_[here] + cosPolar_[y] * cosPolar_[here] < rowFarthest_[y] - kEqual) continue;
      const double a = sinPolar_[y] * to.x, b = sinPolar_[y] * to.z, c = cosPolar_[y] * to.y;
      double* nearest = nearest_.data() + y * width;
      uint16_t* owner = owner_.data() + y * width;
      double farthest = 2.0;
      for (size_t x = 0; x < width; ++x) {
        const double cosine = a * cosAzimuth_[x] + b * sinAzimuth_[x] + c;
        owner[x] = cosine > nearest[x] + kEqual ? light : owner[x];
        nearest[x] = std::max(cosine, nearest[x]);
        farthest = std::min(farthest, nearest[x]);
      }
      rowFarthest_[y] = farthest;
    }
  };
  const size_t grain = std::max<size_t>(1, 65536 / width), height = size_t(map_.height);
  if (arena_) {
    arena_->parallelFor(height, grain, rows, stop);
  } else {
    for (size_t y = 0; y < height && !stop.stopRequested(); y += grain) rows(y, std::min(y + grain, height));
  }
}

std::vector<MapLight> TexelCells::lights(const StopToken& stop) const {
  std::vector<MapLight> out(texels_.size());
  for (size_t i = 0; i < out.size(); ++i) out[i].direction = direction(texels_[i]);
  if (out.empty()) return out;
  const size_t width = size_t(map_.width);
  for (size_t y = 0; y < size_t(map_.height) && !stop.stopRequested(); ++y) {
    const double solid = tents_.weight(int(y));
    for (size_t t = y * width; t < (y + 1) * width; ++t) out[owner_[t]].flux += solid * DVec3(map_.texels[t]);
  }
  return out;
}

}  // namespace terms
}  // namespace gobo
