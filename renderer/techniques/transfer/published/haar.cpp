// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/haar.h"

#include <algorithm>
#include <cmath>

#include "techniques/transfer/environment_split.h"

namespace gobo::transfer::published {

namespace {

std::vector<double> gatheredAngles(const EnvironmentCells& cells) {
  std::vector<double> out;
  for (const EnvironmentCell& cell : cells.cells) out.push_back(cell.solidAngle);
  return out;
}

}  // namespace

CubeHaar::CubeHaar(const EnvironmentCells& cells) : wavelets_(EnvironmentCells::kSide, gatheredAngles(cells)) {
  std::vector<DVec3> value;
  for (const EnvironmentCell& cell : cells.cells) value.push_back(cell.solidAngle > 0 ? cell.flux / std::sqrt(cell.solidAngle) : DVec3(0.0));
  wavelets_.forward(value);
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
  wavelets_.backward(value);
  const std::vector<double>& angles = wavelets_.solidAngles();
  for (size_t i = 0; i < value.size(); ++i) value[i] = angles[i] > 0 ? value[i] / std::sqrt(angles[i]) : DVec3(0.0);
  return value;
}

}  // namespace gobo::transfer::published
