// SPDX-License-Identifier: Apache-2.0
// MurmurHash3_x86_32 (Austin Appleby, public domain): the hash of names that Cryptomatte files are made with. For nothing else; keys are base/hash.h's.
// Pure; O(bytes), about 1 ns a byte.
#pragma once

#include <cstdint>
#include <string_view>

namespace gobo {
inline namespace base {

uint32_t murmurHash3(std::string_view bytes, uint32_t seed = 0);

}  // namespace base
}  // namespace gobo
