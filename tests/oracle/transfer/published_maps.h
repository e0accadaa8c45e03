// SPDX-License-Identifier: Apache-2.0
// Maps of known content for the tests of the published decomposition.
#pragma once

#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <vector>

#include "scene/environment.h"
#include "scene/environment_tents.h"

namespace gobo::transfer::published::tests {

inline constexpr double kDeg = std::numbers::pi / 180;

inline DVec3 texelDirection(double x, double y, int width) {
  const double theta = y * 2 * std::numbers::pi / width, phi = x * 2 * std::numbers::pi / width - std::numbers::pi;
  return {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)};
}
/// Of all texels' centres, row by row; kept.
inline const std::vector<DVec3>& texelDirections(int width) {
  static std::map<int, std::vector<DVec3>> made;
  std::vector<DVec3>& all = made[width];
  if (all.empty())
    for (int y = 0; y < width / 2; ++y)
      for (int x = 0; x < width; ++x) all.push_back(texelDirection(x + 0.5, y + 0.5, width));
  return all;
}
inline double angleBetween(const DVec3& a, const DVec3& b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)) / kDeg; }

struct Sun {
  DVec3 towards;
  double radius, flux;  // half angle in degrees; W/m^2
};
/// Grey: `sky` of the direction, and uniform disks, cut out of texels by 8 x 8 places and scaled to their flux.
inline EnvironmentPtr mapOf(const std::function<double(const DVec3&)>& sky, const std::vector<Sun>& suns = {}, int width = 1024) {
  const int height = width / 2;
  Image image(width, height, 3);
  const EnvironmentTents tents(width, height);
  std::vector<double> value(size_t(width) * size_t(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) value[size_t(y * width + x)] = sky(texelDirections(width)[size_t(y * width + x)]);
  for (const Sun& s : suns) {
    std::vector<std::pair<size_t, double>> covered;
    double sum = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (glm::dot(texelDirections(width)[size_t(y * width + x)], s.towards) < std::cos((s.radius + 1) * kDeg)) continue;
        int within = 0;
        for (int k = 0; k < 64; ++k)
          within += glm::dot(texelDirection(x + (k % 8 + 0.5) / 8, y + (k / 8 + 0.5) / 8, width), s.towards) > std::cos(s.radius * kDeg);
        if (within == 0) continue;
        covered.emplace_back(size_t(y * width + x), within);
        sum += within * tents.weight(y);
      }
    for (const auto& [i, within] : covered) value[i] += within * s.flux / sum;
  }
  for (size_t i = 0; i < value.size(); ++i)
    for (size_t c = 0; c < 3; ++c) image.data[3 * i + c] = float(value[i]);
  return makeEnvironment("map", std::move(image));
}
inline EnvironmentPtr mapOf(double sky, const std::vector<Sun>& suns = {}, int width = 1024) {
  return mapOf([sky](const DVec3&) { return sky; }, suns, width);
}
/// Places of a spiral over the sphere.
inline std::vector<DVec3> spiral(int count) {
  std::vector<DVec3> out;
  for (int i = 0; i < count; ++i) {
    const double y = 1 - 2 * (i + 0.5) / count, s = std::sqrt(1 - y * y), a = i * 137.508 * kDeg;
    out.emplace_back(s * std::cos(a), y, s * std::sin(a));
  }
  return out;
}

}  // namespace gobo::transfer::published::tests
