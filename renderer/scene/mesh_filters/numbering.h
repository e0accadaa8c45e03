// SPDX-License-Identifier: Apache-2.0
// What the mesh filters share and nobody else needs: numbers for triples of integers, the polling interval, the size of a normal that counts.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gobo {
inline namespace scene {

/// Steps between two looks at a stop token: about a tenth of a millisecond of the dearest of them.
inline constexpr size_t kFilterPoll = 1024;

/// Sums of angle times unit normal below this are rounding of positions: normals that cancel, as those of a sheet that lies on its own back.
inline constexpr double kLeastNormal = 1e-6;

/// Numbers triples 0, 1, 2, ... as they first occur. Open addressing: 24 bytes and one look, mostly, for each triple.
class Numbering {
 public:
  explicit Numbering(size_t expected) : slots_(std::bit_ceil(2 * expected + 16), kFree) { keys_.reserve(expected); }
  uint32_t of(uint64_t x, uint64_t y, uint64_t z) {
    if (2 * (keys_.size() + 1) > slots_.size()) grow();
    const Key key{x, y, z};
    size_t at = hashOf(key) & (slots_.size() - 1);
    for (; slots_[at] != kFree; at = (at + 1) & (slots_.size() - 1))
      if (keys_[slots_[at]] == key) return slots_[at];
    slots_[at] = uint32_t(keys_.size());
    keys_.push_back(key);
    return slots_[at];
  }
  /// kNone if it has not occurred.
  uint32_t find(uint64_t x, uint64_t y, uint64_t z) const {
    const Key key{x, y, z};
    for (size_t at = hashOf(key) & (slots_.size() - 1); slots_[at] != kFree; at = (at + 1) & (slots_.size() - 1))
      if (keys_[slots_[at]] == key) return slots_[at];
    return kNone;
  }
  size_t size() const { return keys_.size(); }
  static constexpr uint32_t kNone = ~0u;

 private:
  struct Key {
    uint64_t x, y, z;
    bool operator==(const Key&) const = default;
  };
  static constexpr uint32_t kFree = kNone;
  static size_t hashOf(const Key& k) {
    uint64_t h = 0x9e3779b97f4a7c15ull;
    for (const uint64_t part : {k.x, k.y, k.z}) {
      h = (h ^ part) * 0xff51afd7ed558ccdull;
      h ^= h >> 32;
    }
    return size_t(h);
  }
  void grow() {
    slots_.assign(2 * slots_.size(), kFree);
    for (size_t i = 0; i < keys_.size(); ++i) {
      size_t at = hashOf(keys_[i]) & (slots_.size() - 1);
      while (slots_[at] != kFree) at = (at + 1) & (slots_.size() - 1);
      slots_[at] = uint32_t(i);
    }
  }
  std::vector<uint32_t> slots_;
  std::vector<Key> keys_;
};

}  // namespace scene
}  // namespace gobo
