// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/phong_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene/environment_tents.h"

namespace gobo::prefilter {
namespace {

/// Blocks of texels, rows by rows: mean radiance by the texels' tents, so that the flux is the map's.
struct Pieces {
  int width = 0, height = 0;
  std::vector<DVec3> radiance;
  std::vector<double> solidAngle;              // of a row's
  std::vector<double> cosPolar, sinPolar;      // of rows
  std::vector<double> cosAzimuth, sinAzimuth;  // of columns

  Pieces(const Environment& map, int block, const StopToken& stop) : width(map.width / block), height(map.height / block) {
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

  DVec3 filter(const DVec3& towards, double exponent) const {
    // Relative to the piece that is nearest: powers of what is far from 1 vanish, and their sum must not.
    double nearest = 0.0;
    for (int y = 0; y < height; ++y) {
      const double row = cosPolar[size_t(y)] * towards.y, level = sinPolar[size_t(y)];
      if (row + level * std::hypot(towards.x, towards.z) <= nearest) continue;
      for (int x = 0; x < width; ++x) nearest = std::max(nearest, row + level * (cosAzimuth[size_t(x)] * towards.x + sinAzimuth[size_t(x)] * towards.z));
    }
    if (!(nearest > 0.0)) return DVec3(0.0);
    const double least = nearest * std::exp(-40.0 / exponent);  // e^-40 of the peak: nothing in double
    DVec3 sum(0.0);
    double all = 0;
    for (int y = 0; y < height; ++y) {
      const double row = cosPolar[size_t(y)] * towards.y, level = sinPolar[size_t(y)];
      if (row + level * std::hypot(towards.x, towards.z) < least - 1e-12) continue;
      for (int x = 0; x < width; ++x) {
        const double cosine = row + level * (cosAzimuth[size_t(x)] * towards.x + sinAzimuth[size_t(x)] * towards.z);
        if (!(cosine > 0.0) || cosine < least) continue;
        const double weight = solidAngle[size_t(y)] * std::exp(exponent * std::log(cosine / nearest));
        sum += weight * radiance[size_t(y) * size_t(width) + size_t(x)];
        all += weight;
      }
    }
    return sum / all;
  }
};

}  // namespace

PhongMap phongMap(const Environment& map, double exponent, int width, int height, const TaskArena& arena, const StopToken& stop) {
  const double eighth = std::sqrt(1.0 / (exponent + 1.0)) / 8.0;  // of a lobe cos^s, nearly a Gaussian of variance 1 / s on each axis
  int block = 1;
  while (map.width % (2 * block) == 0 && map.height % (2 * block) == 0 && std::numbers::pi / map.height * (2 * block) < eighth &&
         2.0 * std::numbers::pi / map.width * (2 * block) < eighth)
    block *= 2;
  const Pieces pieces(map, block, stop);
  if (stop.stopRequested()) return {};
  PhongMap out{width, height, std::vector<DVec3>(size_t(width) * size_t(height))};
  const bool whole = arena.parallelFor(
      size_t(height), 1,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (size_t x = 0; x < size_t(width) && !stop.stopRequested(); ++x) {
            const double theta = (double(y) + 0.5) / height * std::numbers::pi, phi = ((double(x) + 0.5) / width * 2.0 - 1.0) * std::numbers::pi;
            out.radiance[y * size_t(width) + x] = pieces.filter({std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}, exponent);
          }
      },
      stop);
  if (!whole || stop.stopRequested()) return {};
  return out;
}

}  // namespace gobo::prefilter
