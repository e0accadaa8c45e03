// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/radiance_cache.h"

#include "techniques/prefilter/map_pieces.h"

namespace gobo::prefilter {

RadianceCache::RadianceCache(const Environment& map, const DVec3& towardsEye, const IsotropicBrdf& brdf, int side, double piece, const TaskArena& arena,
                             const StopToken& stop)
    : picture_(side, towardsEye) {
  const MapPieces pieces(map, blockOf(map, piece), stop);
  if (stop.stopRequested()) return;
  std::vector<DVec3> out(picture_.texels());
  const auto reflected = [&](const DVec3& n) {
    DVec3 sum(0.0);
    for (int y = 0; y < pieces.height; ++y)
      for (int x = 0; x < pieces.width; ++x) {
        const size_t row = size_t(y), column = size_t(x);
        const DVec3 w(pieces.sinPolar[row] * pieces.cosAzimuth[column], pieces.cosPolar[row], pieces.sinPolar[row] * pieces.sinAzimuth[column]);
        const double cosine = glm::dot(n, w);
        if (cosine > 0.0)
          sum += (brdf ? brdf(w, n, picture_.towards()) : 1.0) * cosine * pieces.solidAngle[row] * pieces.radiance[row * size_t(pieces.width) + column];
      }
    return sum;
  };
  const bool whole = arena.parallelFor(
      out.size(), 64,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end && !stop.stopRequested(); ++i) out[i] = reflected(normal(int(i) % side, int(i) / side));
      },
      stop);
  if (whole && !stop.stopRequested()) radiance_ = std::move(out);
}

DVec3 RadianceCache::at(const DVec3& normal) const {
  return picture_.at(normal).blend([&](size_t texel) { return radiance_[texel]; });
}

}  // namespace gobo::prefilter
