// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/published_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace gobo::transfer::published {

PublishedReport reportPublished(const Environment& map, const PublishedSettings& settings, const TaskArena& arena, const StopToken& stop) {
  PublishedReport out;
  out.split = publishedSplit(map, settings, arena, stop);
  if (out.split.full.empty()) return {};
  out.pictures = reportEnvironment(map, settings.bands, 0, 1.0, arena, stop);
  if (out.pictures.split.full.empty()) return {};
  const EnvironmentReport::Part& whole = out.pictures.whole;
  EnvironmentReport::Part& rest = out.pictures.rest;
  const int width = whole.radiance.width, height = whole.radiance.height;
  double missed = 0, all = 0;
  rest.least = std::numeric_limits<double>::infinity();
  for (int y = 0; y < height; ++y) {
    const double theta = (y + 0.5) * std::numbers::pi / height, s = std::sin(theta);
    for (int x = 0; x < width; ++x) {
      const double phi = ((x + 0.5) / width - 0.5) * 2 * std::numbers::pi;
      const DVec3 d(s * std::cos(phi), std::cos(theta), s * std::sin(phi));
      const DVec3 smooth = radianceOf(out.split.used, settings.bands, d);
      DVec3 model = smooth;
      for (const PublishedLight& light : out.split.lights)
        if (glm::dot(light.direction, d) >= std::cos(light.radius)) model += light.radiance;
      const float* own = whole.radiance.at(x, y);
      for (int c = 0; c < 3; ++c) {
        rest.harmonics.at(x, y)[c] = float(smooth[c]);
        rest.radiance.at(x, y)[c] = float(model[c]);
      }
      const double there = luminanceOf(DVec3(own[0], own[1], own[2])), difference = luminanceOf(model) - there;
      missed += s * difference * difference;
      all += s * there * there;
      rest.least = std::min(rest.least, luminanceOf(smooth));
    }
  }
  rest.error = all > 0 ? std::sqrt(missed / all) : 0.0;
  const double flux = luminanceOf(out.split.flux);
  double inLights = 0;
  for (const PublishedLight& light : out.split.lights) {
    out.pictures.split.lights.push_back({light.direction, light.irradiance, light.irradiance, light.radius});
    inLights += luminanceOf(light.irradiance);
  }
  out.pictures.lightShare = flux > 0 ? inLights / flux : 0.0;
  return out;
}

double harmonicsError(const EnvironmentCells& cells, const std::vector<double>& coefficients, int bands) {
  double missed = 0, all = 0;
  for (size_t i = 0; i < cells.cells.size(); ++i) {
    const EnvironmentCell& cell = cells.cells[i];
    if (!(cell.solidAngle > 0)) continue;
    const double own = cell.weight / cell.solidAngle, difference = luminanceOf(radianceOf(coefficients, bands, cellDirections()[i])) - own;
    missed += cell.solidAngle * difference * difference;
    all += cell.solidAngle * own * own;
  }
  return all > 0 ? std::sqrt(missed / all) : 0.0;
}

}  // namespace gobo::transfer::published
