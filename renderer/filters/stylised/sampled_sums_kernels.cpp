// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/sobol.h"
#include "filters/stylised/sampled_sums.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr uint32_t kBatchOfPoints = 64;

/// ratio^(p/2), for ratios of squares.
inline double halfPower(double ratio, int p) {
  double power = p % 2 ? std::sqrt(ratio) : 1.0;
  for (int n = p / 2; n > 0; n /= 2, ratio *= ratio)
    if (n % 2) power *= ratio;
  return power;
}

}  // namespace

ContourPoints::ContourPoints(std::span<const ContourSegment> contour) {
  lines_.reserve(contour.size() + 1);
  for (const ContourSegment& s : contour) {
    const double length = glm::length(DVec3(s.b) - DVec3(s.a));
    lines_.push_back({s.a, s.b, s.normal, length_, 1.0 / length});  // of no length: the next begins there too, and it is never drawn
    length_ += length;
  }
  guide_.resize(lines_.size());
  lines_.push_back({});  // after the last: where nothing begins
  lines_.back().begin = HUGE_VAL;
  uint32_t line = 0;
  for (size_t cell = 0; cell < guide_.size(); ++cell) {
    const double from = length_ * double(cell) / double(guide_.size());
    while (lines_[line + 1].begin <= from) ++line;
    guide_[cell] = line;
  }
}

SampledSum ContourPoints::sum(const Vec3& x, const Vec3& n, int p, float cosine, uint64_t seed, uint32_t samples) const {
  const DVec3 at(x);
  SampledSum out;
  for (uint32_t first = 0; first < samples; first += kBatchOfPoints) {
    const uint32_t count = std::min(samples - first, kBatchOfPoints);
    double square[kBatchOfPoints], nearest = HUGE_VAL;
    for (uint32_t k = 0; k < count; ++k) {
      const double u = double(hash64(seed, first + k) >> 11) * 0x1p-53, from = u * length_;
      size_t i = guide_[std::min(size_t(u * double(guide_.size())), guide_.size() - 1)];
      i += lines_[i + 1].begin <= from;  // mostly enough, and no branch to be guessed wrongly
      i += lines_[i + 1].begin <= from;
      while (lines_[i + 1].begin <= from) ++i;
      const Line& line = lines_[i];
      const DVec3 a(line.a), step = a + std::clamp((from - line.begin) * line.perLength, 0.0, 1.0) * (DVec3(line.b) - a) - at;
      const bool seen = glm::dot(line.normal, n) >= cosine;
      square[k] = seen ? glm::dot(step, step) : HUGE_VAL;
      nearest = std::min(nearest, square[k]);
      out.seen += seen;
    }
    if (nearest == HUGE_VAL) continue;
    if (!(nearest > 0)) return {0, 0, out.seen};
    if (out.unit2 == 0) out.unit2 = nearest;
    if (nearest < out.unit2) {
      out.sum *= halfPower(nearest / out.unit2, p);
      out.unit2 = nearest;
    }
    double sum = 0;
    if (p == 8) {
      for (uint32_t k = 0; k < count; ++k) {
        const double q = out.unit2 / square[k], q2 = q * q;
        sum += q2 * q2;
      }
    } else {
      for (uint32_t k = 0; k < count; ++k) sum += halfPower(out.unit2 / square[k], p);
    }
    out.sum += sum;
  }
  return out;
}

}  // namespace filters
}  // namespace gobo
