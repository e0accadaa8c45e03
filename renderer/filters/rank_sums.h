// SPDX-License-Identifier: Apache-2.0
// Pairs (id, coverage) of many slices, pixel by pixel (terms/cryptomatte.h). Sums are whole numbers of 2^-23, so that their order does not matter and 256
// slices lose nothing that a float holds. A pixel keeps kKept ids: of more the one of the least coverage so far goes. Different pixels: any thread.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace gobo {
inline namespace filters {

class RankSums {
 public:
  static constexpr int kKept = 12;
  static constexpr size_t kBytesAPixel = kKept * 2 * sizeof(uint32_t);

  explicit RankSums(size_t pixels) : entries_(pixels) {}
  /// `ranks`: pairs; those of no coverage are none.
  void add(size_t pixel, std::span<const float> ranks) {
    for (size_t k = 0; k + 1 < ranks.size(); k += 2)
      if (ranks[k + 1] > 0.0f) addOne(entries_[pixel], std::bit_cast<uint32_t>(ranks[k]), uint32_t(std::lround(std::min(ranks[k + 1], 1.0f) * kOne)));
  }
  /// The largest as pairs of their mean over so many slices, in order; (0, 0) where there are no more.
  void write(size_t pixel, int slices, std::span<float> ranks) {
    std::array<Entry, kKept>& all = entries_[pixel];
    std::sort(all.begin(), all.end(), [](const Entry& a, const Entry& b) { return a.sum != b.sum ? a.sum > b.sum : a.id < b.id; });
    for (size_t k = 0; k + 1 < ranks.size(); k += 2) {
      const Entry e = k / 2 < all.size() ? all[k / 2] : Entry{};
      ranks[k] = e.sum ? std::bit_cast<float>(e.id) : 0.0f;
      ranks[k + 1] = float(double(e.sum) / (double(kOne) * slices));
    }
  }

 private:
  struct Entry {
    uint32_t id = 0, sum = 0;
  };
  static constexpr float kOne = 0x1p23f;

  static void addOne(std::array<Entry, kKept>& all, uint32_t id, uint32_t coverage) {
    Entry* least = &all[0];
    for (Entry& e : all) {
      if (e.sum && e.id == id) {
        e.sum += coverage;
        return;
      }
      if (e.sum < least->sum || (e.sum == least->sum && e.id > least->id)) least = &e;
    }
    if (coverage > least->sum || (coverage == least->sum && id < least->id)) *least = {id, coverage};
  }

  std::vector<std::array<Entry, kKept>> entries_;
};

}  // namespace filters
}  // namespace gobo
