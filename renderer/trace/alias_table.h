// SPDX-License-Identifier: Apache-2.0
// Alias table (Walker 1977, built by Vose's method): one of n items with chance proportional to its weight, in O(1).
// Immutable after build; 8 bytes an item.
#pragma once

#include <cstdint>
#include <vector>

namespace gobo {
inline namespace trace {

class AliasTable {
 public:
  AliasTable() = default;
  /// Weights are finite and >= 0. All zero: an empty table.
  explicit AliasTable(const std::vector<double>& weights) {
    double sum = 0;
    for (double w : weights) sum += w;
    if (!(sum > 0)) return;
    const size_t n = weights.size();
    cells_.resize(n);
    std::vector<double> scaled(n);
    std::vector<uint32_t> low, high;
    for (size_t i = 0; i < n; ++i) {
      scaled[i] = weights[i] / sum * double(n);
      cells_[i] = {1.0f, uint32_t(i)};
      (scaled[i] < 1.0 ? low : high).push_back(uint32_t(i));
    }
    while (!low.empty() && !high.empty()) {
      const uint32_t l = low.back(), h = high.back();
      low.pop_back();
      cells_[l] = {float(scaled[l]), h};
      scaled[h] -= 1.0 - scaled[l];
      if (scaled[h] < 1.0) {
        high.pop_back();
        low.push_back(h);
      }
    }
    // Only rounding leaves a low item without a partner; an item of weight zero must still never come out.
    uint32_t heaviest = 0;
    for (size_t i = 1; i < n; ++i)
      if (weights[i] > weights[heaviest]) heaviest = uint32_t(i);
    for (uint32_t l : low)
      if (weights[l] == 0.0) cells_[l] = {0.0f, heaviest};
  }

  bool empty() const { return cells_.empty(); }
  size_t size() const { return cells_.size(); }
  /// u in [0,1); `u` becomes the unused part of itself, uniform in [0,1) again (with fewer bits).
  uint32_t sample(float& u) const {
    const double x = double(u) * double(cells_.size());
    const uint32_t cell = uint32_t(x) < cells_.size() ? uint32_t(x) : uint32_t(cells_.size() - 1);
    const double r = x - cell;
    const Cell& c = cells_[cell];
    const bool own = r < c.threshold;
    const float rest = float(own ? r / c.threshold : (r - c.threshold) / (1.0 - double(c.threshold)));
    u = rest < 1.0f ? rest : 0x1.fffffep-1f;
    return own ? cell : c.alias;
  }

 private:
  struct Cell {
    float threshold;
    uint32_t alias;
  };
  std::vector<Cell> cells_;
};

}  // namespace trace
}  // namespace gobo
