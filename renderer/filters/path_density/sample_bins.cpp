// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/sample_bins.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace gobo::pathdensity {

namespace {

constexpr double kSamplesOfCell = 8;

}  // namespace

SampleBins binSamples(const SampleView& s, const StopToken& stop) {
  SampleBins b;
  b.width = s.width;
  b.height = s.height;
  const size_t n = s.size();
  GOBO_CHECK(n < 0xffffffffu);
  const double perPixel = double(n) / std::max(1.0, double(s.width) * double(s.height));
  b.cell = std::clamp(int(std::ceil(std::sqrt(kSamplesOfCell / std::max(perPixel, 1e-3)))), 1, std::max(1, std::max(s.width, s.height)));
  b.cellsX = (s.width + b.cell - 1) / b.cell;
  b.cellsY = (s.height + b.cell - 1) / b.cell;
  b.slotStart.assign(size_t(b.cellsX) * size_t(b.cellsY) * size_t(b.cell) * size_t(b.cell) + 1, 0);
  const auto slotOf = [&](size_t i) {
    const int x = std::clamp(int(s.film[2 * i]), 0, s.width - 1), y = std::clamp(int(s.film[2 * i + 1]), 0, s.height - 1);
    return b.slot(x, y);
  };
  const auto stopped = [&](size_t i) { return (i & 0xffff) == 0 && stop.stopRequested(); };
  for (size_t i = 0; i < n && !stopped(i); ++i) ++b.slotStart[slotOf(i) + 1];
  for (size_t k = 1; k < b.slotStart.size(); ++k) b.slotStart[k] += b.slotStart[k - 1];
  b.order.resize(n);
  std::vector<uint32_t> next(b.slotStart.begin(), b.slotStart.end() - 1);
  if (stop.stopRequested()) return b;  // starts and samples belong together
  for (size_t i = 0; i < n && !stopped(i); ++i) b.order[next[slotOf(i)]++] = uint32_t(i);
  return b;
}

}  // namespace gobo::pathdensity
