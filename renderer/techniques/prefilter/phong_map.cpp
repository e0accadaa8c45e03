// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/phong_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "techniques/prefilter/map_pieces.h"

namespace gobo::prefilter {
namespace {

DVec3 phongMean(const MapPieces& p, const DVec3& towards, double exponent) {
  // Relative to the piece that is nearest: powers of what is far from 1 vanish, and their sum must not.
  double nearest = 0.0;
  for (int y = 0; y < p.height; ++y) {
    const double row = p.cosPolar[size_t(y)] * towards.y, level = p.sinPolar[size_t(y)];
    if (row + level * std::hypot(towards.x, towards.z) <= nearest) continue;
    for (int x = 0; x < p.width; ++x) nearest = std::max(nearest, row + level * (p.cosAzimuth[size_t(x)] * towards.x + p.sinAzimuth[size_t(x)] * towards.z));
  }
  if (!(nearest > 0.0)) return DVec3(0.0);
  const double least = nearest * std::exp(-40.0 / exponent);  // e^-40 of the peak: nothing in double
  DVec3 sum(0.0);
  double all = 0;
  for (int y = 0; y < p.height; ++y) {
    const double row = p.cosPolar[size_t(y)] * towards.y, level = p.sinPolar[size_t(y)];
    if (row + level * std::hypot(towards.x, towards.z) < least - 1e-12) continue;
    for (int x = 0; x < p.width; ++x) {
      const double cosine = row + level * (p.cosAzimuth[size_t(x)] * towards.x + p.sinAzimuth[size_t(x)] * towards.z);
      if (!(cosine > 0.0) || cosine < least) continue;
      const double weight = p.solidAngle[size_t(y)] * std::exp(exponent * std::log(cosine / nearest));
      sum += weight * p.radiance[size_t(y) * size_t(p.width) + size_t(x)];
      all += weight;
    }
  }
  return sum / all;
}

}  // namespace

PhongMap phongMap(const Environment& map, double exponent, int width, int height, const TaskArena& arena, const StopToken& stop) {
  const double eighth = std::sqrt(1.0 / (exponent + 1.0)) / 8.0;  // of a lobe cos^s, nearly a Gaussian of variance 1 / s on each axis
  const MapPieces pieces(map, blockOf(map, eighth), stop);
  if (stop.stopRequested()) return {};
  PhongMap out{width, height, std::vector<DVec3>(size_t(width) * size_t(height))};
  const bool whole = arena.parallelFor(
      size_t(height), 1,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (size_t x = 0; x < size_t(width) && !stop.stopRequested(); ++x) {
            const double theta = (double(y) + 0.5) / height * std::numbers::pi, phi = ((double(x) + 0.5) / width * 2.0 - 1.0) * std::numbers::pi;
            out.radiance[y * size_t(width) + x] =
                phongMean(pieces, {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}, exponent);
          }
      },
      stop);
  if (!whole || stop.stopRequested()) return {};
  return out;
}

}  // namespace gobo::prefilter
