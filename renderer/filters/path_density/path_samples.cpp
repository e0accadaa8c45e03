// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/path_samples.h"

#include <algorithm>
#include <cmath>

namespace gobo::pathdensity {

Status PathSamples::reserve(size_t samples) {
  const size_t most = limit_ / kBytesOfSample;
  if (size() > most || samples > most - size())
    return {Code::ResourceExhausted, "path samples: " + std::to_string(size() + samples) + " of " + std::to_string(kBytesOfSample) +
                                         " bytes are more than the limit of " + std::to_string(limit_) + " bytes holds (" + std::to_string(most) + ")"};
  // Twice as much whenever it is full, but never beyond the limit.
  const size_t need = size() + samples, now = film_.capacity() / 2;
  if (need <= now) return {};
  const size_t room = std::min(most, std::max(need, 2 * now));
  film_.reserve(2 * room);
  direct_.reserve(3 * room);
  indirect_.reserve(3 * room);
  return {};
}

Status PathSamples::add(int x, int y, const Vec2& film, const Vec3& direct, const Vec3& indirect) {
  // Finite parts may have an infinite sum.
  if (!isFinite(direct) || !isFinite(indirect) || !isFinite(direct + indirect) || !std::isfinite(film.x) || !std::isfinite(film.y)) {
    ++dropped_;
    return {};
  }
  GOBO_TRY(reserve(1));
  const auto inside = [](float v, int pixel) { return std::clamp(v, float(pixel), std::nextafter(float(pixel + 1), 0.0f)); };
  film_.insert(film_.end(), {inside(film.x, x), inside(film.y, y)});
  direct_.insert(direct_.end(), {direct.x, direct.y, direct.z});
  indirect_.insert(indirect_.end(), {indirect.x, indirect.y, indirect.z});
  return {};
}

}  // namespace gobo::pathdensity
