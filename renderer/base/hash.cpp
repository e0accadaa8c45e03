// SPDX-License-Identifier: Apache-2.0
#include "base/hash.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace gobo {
inline namespace base {

Hash128 hashBytes(const void* data, size_t bytes) {
  const XXH128_hash_t h = XXH3_128bits(data, bytes);
  return {h.low64, h.high64};
}

std::string Hash128::hex() const {
  static const char* digits = "0123456789abcdef";
  std::string text(32, '0');
  for (int i = 0; i < 16; ++i) {
    text[i] = digits[(hi >> (60 - 4 * i)) & 15];
    text[16 + i] = digits[(lo >> (60 - 4 * i)) & 15];
  }
  return text;
}

Hash128 Hash128::fromHex(std::string_view text) {
  if (text.size() != 32) return {};
  Hash128 h;
  for (int i = 0; i < 32; ++i) {
    const char c = text[i];
    int v = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
    if (v < 0) return {};
    uint64_t& word = i < 16 ? h.hi : h.lo;
    word = (word << 4) | uint64_t(v);
  }
  return h;
}

void Hasher::fold(const void* data, size_t bytes) {
  const Hash128 piece = hashBytes(data, bytes);
  const uint64_t joined[5] = {state_.lo, state_.hi, piece.lo, piece.hi, uint64_t(bytes)};
  state_ = hashBytes(joined, sizeof joined);
  folded_ = true;
}

Hasher& Hasher::raw(const void* data, size_t bytes) {
  // Small pieces gather in a buffer; the split into folds depends only on the sequence of sizes, so it is reproducible.
  if (bytes >= 4096) {
    if (!small_.empty()) {
      fold(small_.data(), small_.size());
      small_.clear();
    }
    fold(data, bytes);
    return *this;
  }
  const auto* p = static_cast<const uint8_t*>(data);
  small_.insert(small_.end(), p, p + bytes);
  if (small_.size() >= 4096) {
    fold(small_.data(), small_.size());
    small_.clear();
  }
  return *this;
}

Hash128 Hasher::digest() const {
  Hasher copy = *this;
  copy.fold(copy.small_.data(), copy.small_.size());
  return copy.state_;
}

}  // namespace base
}  // namespace gobo
