// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/radiance_cache.h"

#include <algorithm>
#include <cmath>

#include "base/to_index.h"
#include "techniques/prefilter/map_pieces.h"

namespace gobo::prefilter {

RadianceCache::RadianceCache(const Environment& map, const DVec3& towardsEye, const IsotropicBrdf& brdf, int side, double piece, const TaskArena& arena,
                             const StopToken& stop)
    : side_(side), z_(glm::normalize(towardsEye)) {
  x_ = glm::normalize(glm::cross(std::fabs(z_.y) < 0.9 ? DVec3(0, 1, 0) : DVec3(1, 0, 0), z_));
  y_ = glm::cross(z_, x_);
  const MapPieces pieces(map, blockOf(map, piece), stop);
  if (stop.stopRequested()) return;
  std::vector<DVec3> out(size_t(side) * size_t(side));
  const auto reflected = [&](const DVec3& n) {
    DVec3 sum(0.0);
    for (int y = 0; y < pieces.height; ++y)
      for (int x = 0; x < pieces.width; ++x) {
        const size_t row = size_t(y), column = size_t(x);
        const DVec3 w(pieces.sinPolar[row] * pieces.cosAzimuth[column], pieces.cosPolar[row], pieces.sinPolar[row] * pieces.sinAzimuth[column]);
        const double cosine = glm::dot(n, w);
        if (cosine > 0.0) sum += (brdf ? brdf(w, n, z_) : 1.0) * cosine * pieces.solidAngle[row] * pieces.radiance[row * size_t(pieces.width) + column];
      }
    return sum;
  };
  const bool whole = arena.parallelFor(
      out.size(), 64,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end && !stop.stopRequested(); ++i) out[i] = reflected(normal(int(i) % side_, int(i) / side_));
      },
      stop);
  if (whole && !stop.stopRequested()) radiance_ = std::move(out);
}

DVec3 RadianceCache::normal(int x, int y) const {
  const double u = (x + 0.5) / side_ * 2.0 - 1.0, v = (y + 0.5) / side_ * 2.0 - 1.0, square = u * u + v * v;
  const double along = 1.0 - square, across = std::sqrt(std::max(2.0 - square, 0.0));  // sin / radius: (1 - along^2) / square = 2 - square
  return along * z_ + across * (u * x_ + v * y_);
}

DVec3 RadianceCache::at(const DVec3& normal) const {
  const double along = glm::dot(normal, z_), a = glm::dot(normal, x_), b = glm::dot(normal, y_);
  const double length = std::hypot(a, b), scale = length > 0.0 ? std::sqrt(std::max(1.0 - along, 0.0)) / length : 0.0;
  const auto place = [&](double v) { return std::clamp((v * scale + 1.0) * 0.5 * side_ - 0.5, 0.0, double(side_ - 1)); };
  const double u = place(a), v = place(b);
  const int x0 = toIndex(u, side_), y0 = toIndex(v, side_), x1 = std::min(x0 + 1, side_ - 1), y1 = std::min(y0 + 1, side_ - 1);
  const double s = u - x0, t = v - y0;
  const auto texel = [&](int x, int y) { return radiance_[size_t(y) * size_t(side_) + size_t(x)]; };
  return (texel(x0, y0) * (1 - s) + texel(x1, y0) * s) * (1 - t) + (texel(x0, y1) * (1 - s) + texel(x1, y1) * s) * t;
}

}  // namespace gobo::prefilter
