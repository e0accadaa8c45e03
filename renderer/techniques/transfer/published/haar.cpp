// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/haar.h"

#include <algorithm>
#include <cmath>

#include "techniques/transfer/environment_split.h"

namespace gobo::transfer::published {

namespace {

constexpr size_t kSide = EnvironmentCells::kSide, kFace = kSide * kSide;

/// Calls turn(first, second, cosine, sine) for every pair of one level and axis of a face whose sides are `size` terms; differences of rows are paired along
/// columns too, as 2D wavelets are. `angle`, by term, becomes that of the pairs.
template <typename Turn>
void pairs(std::vector<double>& angle, size_t face, size_t size, bool rows, const Turn& turn) {
  const size_t step = kSide / size, along = rows ? step : step * kSide, across = rows ? step * kSide : step;
  for (size_t line = 0; line < size; ++line)
    for (size_t k = 0; k < size; k += 2) {
      const size_t first = face * kFace + line * across + k * along, second = first + along;
      const double both = angle[first] + angle[second];
      if (both > 0) turn(first, second, std::sqrt(angle[first] / both), std::sqrt(angle[second] / both));
      angle[first] = angle[second] = both;
    }
}

}  // namespace

CubeHaar::CubeHaar(const EnvironmentCells& cells) {
  std::vector<DVec3> value;
  for (const EnvironmentCell& cell : cells.cells) {
    angles_.push_back(cell.solidAngle);
    value.push_back(cell.solidAngle > 0 ? cell.flux / std::sqrt(cell.solidAngle) : DVec3(0.0));
  }
  std::vector<double> angle = angles_;
  for (size_t face = 0; face < 6; ++face)
    for (size_t size = kSide; size > 1; size /= 2)
      for (const bool rows : {true, false})
        pairs(angle, face, size, rows, [&](size_t a, size_t b, double c, double s) {
          const DVec3 mean = c * value[a] + s * value[b];
          value[b] = s * value[a] - c * value[b];
          value[a] = mean;
        });
  for (size_t i = 0; i < value.size(); ++i) terms_.push_back({uint32_t(i), value[i]});
  std::stable_sort(terms_.begin(), terms_.end(),
                   [](const HaarTerm& a, const HaarTerm& b) { return std::fabs(luminanceOf(a.value)) > std::fabs(luminanceOf(b.value)); });
  left_.assign(terms_.size() + 1, 0.0);
  for (size_t k = terms_.size(); k-- > 0;) left_[k] = left_[k + 1] + luminanceOf(terms_[k].value) * luminanceOf(terms_[k].value);
}

double CubeHaar::error(size_t count) const { return left_[0] > 0 ? std::sqrt(left_[std::min(count, terms_.size())] / left_[0]) : 0.0; }

std::vector<DVec3> CubeHaar::radiance(size_t count) const {
  std::vector<DVec3> value(terms_.size(), DVec3(0.0));
  for (size_t k = 0; k < std::min(count, terms_.size()); ++k) value[terms_[k].index] = terms_[k].value;
  // Backwards; the angles of each level have to be made first.
  for (size_t face = 0; face < 6; ++face) {
    struct Pair {
      size_t a, b;
      double c, s;
    };
    std::vector<Pair> all;
    std::vector<double> angle = angles_;
    for (size_t size = kSide; size > 1; size /= 2)
      for (const bool rows : {true, false}) pairs(angle, face, size, rows, [&](size_t a, size_t b, double c, double s) { all.push_back({a, b, c, s}); });
    for (size_t k = all.size(); k-- > 0;) {
      const Pair& p = all[k];
      const DVec3 mean = value[p.a], difference = value[p.b];
      value[p.a] = p.c * mean + p.s * difference;
      value[p.b] = p.s * mean - p.c * difference;
    }
  }
  for (size_t i = 0; i < value.size(); ++i) value[i] = angles_[i] > 0 ? value[i] / std::sqrt(angles_[i]) : DVec3(0.0);
  return value;
}

}  // namespace gobo::transfer::published
