// SPDX-License-Identifier: Apache-2.0
// A lat-long map as pieces of the sphere for sums over all of it: texels, or blocks of texels where that is fine enough. Map axes, double.
#pragma once

#include <cmath>
#include <numbers>
#include <vector>

#include "base/stop.h"
#include "scene/environment.h"
#include "scene/environment_tents.h"

namespace gobo::prefilter {

/// Blocks of texels, rows by rows: mean radiance by the texels' tents, so that the flux is the map's.
struct MapPieces {
  int width = 0, height = 0;
  std::vector<DVec3> radiance;
  std::vector<double> solidAngle;              // of a row's
  std::vector<double> cosPolar, sinPolar;      // of rows
  std::vector<double> cosAzimuth, sinAzimuth;  // of columns

  MapPieces(const Environment& map, int block, const StopToken& stop) : width(map.width / block), height(map.height / block) {
    const EnvironmentTents tents(map.width, map.height);
    radiance.resize(size_t(width) * size_t(height));
    for (int y = 0; y < height && !stop.stopRequested(); ++y) {
      double solid = 0;
      for (int j = 0; j < block; ++j) solid += tents.weight(y * block + j) * block;
      for (int x = 0; x < width; ++x) {
        DVec3 sum(0.0);
        for (int j = 0; j < block; ++j)
          for (int i = 0; i < block; ++i)
            sum += tents.weight(y * block + j) * DVec3(map.texels[size_t(y * block + j) * size_t(map.width) + size_t(x * block + i)]);
        radiance[size_t(y) * size_t(width) + size_t(x)] = sum / solid;
      }
      const double theta = (y + 0.5) / height * std::numbers::pi;
      solidAngle.push_back(solid);
      cosPolar.push_back(std::cos(theta));
      sinPolar.push_back(std::sin(theta));
    }
    for (int x = 0; x < width; ++x) {
      const double phi = ((x + 0.5) / width * 2.0 - 1.0) * std::numbers::pi;
      cosAzimuth.push_back(std::cos(phi));
      sinAzimuth.push_back(std::sin(phi));
    }
  }
};

/// The largest power of two that divides the map and makes blocks of at most `angle` (radians) across; 1 if none does.
inline int blockOf(const Environment& map, double angle) {
  int block = 1;
  while (map.width % (2 * block) == 0 && map.height % (2 * block) == 0 && std::numbers::pi / map.height * (2 * block) < angle &&
         2.0 * std::numbers::pi / map.width * (2 * block) < angle)
    block *= 2;
  return block;
}

}  // namespace gobo::prefilter
