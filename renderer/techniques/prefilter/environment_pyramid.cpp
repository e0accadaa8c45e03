// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/environment_pyramid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/to_index.h"
#include "scene/environment_tents.h"

namespace gobo::prefilter {

namespace {

/// Sum of the components' magnitudes: 1 towards an axis, sqrt(3) between them.
float octahedral(const Vec3& d) { return std::fabs(d.x) + std::fabs(d.y) + std::fabs(d.z); }

/// In 0 .. 1. The upper half of the sphere is the square on its corner in the middle, the lower half its four corners.
Vec2 placeOf(const Vec3& d) {
  const float scale = 1.0f / octahedral(d);
  Vec2 p(d.x * scale, d.z * scale);
  if (d.y < 0.0f) p = Vec2(std::copysign(1.0f - std::fabs(p.y), p.x), std::copysign(1.0f - std::fabs(p.x), p.y));
  return 0.5f * (p + 1.0f);
}

/// Beyond an edge lies the same edge, mirrored about its middle.
size_t texelOf(int x, int y, int side) {
  if (x < 0 || x >= side) x = x < 0 ? -1 - x : 2 * side - 1 - x, y = side - 1 - y;
  if (y < 0 || y >= side) y = y < 0 ? -1 - y : 2 * side - 1 - y, x = side - 1 - x;
  return size_t(y) * size_t(side) + size_t(x);
}

constexpr int kFinest = 5;  // parts of a texel of the map across, at least

}  // namespace

EnvironmentPyramid::EnvironmentPyramid(const Environment& map, const StopToken& stop) {
  // Every part of every texel goes where its middle lies: parts are less than half a texel of level 0 across.
  const int perX = std::max(kFinest, 2560 / map.width + 1), perY = std::max(kFinest, 1280 / map.height + 1);
  const int columns = perX * map.width, rows = perY * map.height;
  std::vector<float> cosine(static_cast<size_t>(columns)), sine(static_cast<size_t>(columns));
  for (int x = 0; x < columns; ++x) {
    const double phi = ((x + 0.5) / columns * 2.0 - 1.0) * std::numbers::pi;
    cosine[size_t(x)] = float(std::cos(phi));
    sine[size_t(x)] = float(std::sin(phi));
  }
  const size_t finest = size_t(kSide) * kSide;
  std::vector<DVec3> flux(finest, DVec3(0.0));
  std::vector<double> solid(finest, 0.0);
  for (int y = 0; y < rows; ++y) {
    if (stop.stopRequested()) return;
    const double above = std::cos(y * std::numbers::pi / rows), below = std::cos((y + 1) * std::numbers::pi / rows);
    const double part = (above - below) * 2.0 * std::numbers::pi / columns, up = 0.5 * (above + below), out = std::sqrt(std::max(1.0 - up * up, 0.0));
    for (int x = 0; x < columns; ++x) {
      const Vec2 at = placeOf(Vec3(float(out) * cosine[size_t(x)], float(up), float(out) * sine[size_t(x)]));
      const size_t i = size_t(toIndex(at.y * float(kSide), kSide)) * kSide + size_t(toIndex(at.x * float(kSide), kSide));
      flux[i] += part * DVec3(interpolateTexels(map, (x + 0.5) / perX, (y + 0.5) / perY));
      solid[i] += part;
    }
  }
  std::vector<Level> levels(kLevels);
  for (int k = 0; k < kLevels; ++k) {
    Level& level = levels[size_t(k)];
    level.side = kSide >> k;
    if (k > 0) {  // four to one
      const size_t wide = size_t(2 * level.side);
      for (size_t y = 0; y < size_t(level.side); ++y)
        for (size_t x = 0; x < size_t(level.side); ++x) {
          const size_t to = y * size_t(level.side) + x, from = 2 * y * wide + 2 * x;
          flux[to] = (flux[from] + flux[from + 1]) + (flux[from + wide] + flux[from + wide + 1]);
          solid[to] = (solid[from] + solid[from + 1]) + (solid[from + wide] + solid[from + wide + 1]);
        }
    }
    const size_t texels = size_t(level.side) * size_t(level.side);
    for (size_t i = 0; i < texels; ++i) {
      level.radiance.push_back(solid[i] > 0.0 ? Vec3(flux[i] / solid[i]) : Vec3(0.0f));
      level.solidAngle.push_back(float(solid[i]));
    }
  }
  levels_ = std::move(levels);
}

Vec3 EnvironmentPyramid::lookUp(const Level& level, const Vec2& at) {
  const float u = at.x * float(level.side) - 0.5f, v = at.y * float(level.side) - 0.5f;
  const int x = toInteger(std::floor(u), -1, level.side - 1), y = toInteger(std::floor(v), -1, level.side - 1);
  const float s = u - float(x), t = v - float(y);
  const auto texel = [&](int i, int j) { return level.radiance[texelOf(x + i, y + j, level.side)]; };
  return (texel(0, 0) * (1.0f - s) + texel(1, 0) * s) * (1.0f - t) + (texel(0, 1) * (1.0f - s) + texel(1, 1) * s) * t;
}

Vec3 EnvironmentPyramid::mean(const Vec3& direction, float solidAngle) const {
  const float wide = octahedral(direction), finest = 4.0f * wide * wide * wide / (float(kSide) * float(kSide));  // a texel of level 0 there
  const float level = std::clamp(solidAngle > finest ? 0.5f * std::log2(solidAngle / finest) : 0.0f, 0.0f, float(kLevels - 1));
  const int k = std::min(int(level), kLevels - 2);
  const float t = level - float(k);
  const Vec2 at = placeOf(direction);
  const Vec3 sharp = lookUp(levels_[size_t(k)], at);
  return t > 0.0f ? sharp * (1.0f - t) + lookUp(levels_[size_t(k) + 1], at) * t : sharp;
}

DVec3 EnvironmentPyramid::flux(int level) const {
  const Level& from = levels_.at(size_t(level));
  DVec3 sum(0.0);
  for (size_t i = 0; i < from.radiance.size(); ++i) sum += double(from.solidAngle[i]) * DVec3(from.radiance[i]);
  return sum;
}

}  // namespace gobo::prefilter
