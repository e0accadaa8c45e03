// SPDX-License-Identifier: Apache-2.0
// How large a small file's picture may become: a bound of the process, as picture libraries have, because it guards the process. A
// picture of up to 256 MiB, or of up to 64 times its file, is read whatever the bound.
#pragma once

#include <cstdint>

namespace gobo {
inline namespace base {

inline constexpr uint64_t kMostDecodedBytes = 1ull << 30, kLeastDecodedBytes = 256ull << 20, kDecodedPerByte = 64;

/// Bytes of one decoded picture, as floats; kMostDecodedBytes until it is set. gobo-ingest sets it to ingest.texture_bytes. Thread-safe.
void setMostDecodedBytes(uint64_t bytes);
uint64_t mostDecodedBytes();

}  // namespace base
}  // namespace gobo
