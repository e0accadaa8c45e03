// SPDX-License-Identifier: Apache-2.0
#include "base/murmur3.h"

#include <bit>
#include <cstring>

namespace gobo {
inline namespace base {

namespace {

uint32_t murmurScrambled(uint32_t block) { return std::rotl(block * 0xcc9e2d51u, 15) * 0x1b873593u; }

}  // namespace

uint32_t murmurHash3(std::string_view bytes, uint32_t seed) {
  static_assert(std::endian::native == std::endian::little);  // blocks are little endian
  uint32_t h = seed;
  const size_t whole = bytes.size() / 4 * 4;
  for (size_t at = 0; at < whole; at += 4) {
    uint32_t block;
    std::memcpy(&block, bytes.data() + at, 4);
    h = std::rotl(h ^ murmurScrambled(block), 13) * 5u + 0xe6546b64u;
  }
  if (whole < bytes.size()) {
    uint32_t rest = 0;
    std::memcpy(&rest, bytes.data() + whole, bytes.size() - whole);
    h ^= murmurScrambled(rest);
  }
  h ^= uint32_t(bytes.size());
  h = (h ^ h >> 16) * 0x85ebca6bu;
  h = (h ^ h >> 13) * 0xc2b2ae35u;
  return h ^ h >> 16;
}

}  // namespace base
}  // namespace gobo
