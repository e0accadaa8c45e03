// SPDX-License-Identifier: Apache-2.0
// Internal to base/: the headers of an EXR file, walked before OpenEXR sees them. It allocates by what a header says (an attribute's
// bytes, tiles, lines of a chunk, chunk tables) and reads attributes of known types without regard to their stated size, so two readers
// may disagree on where the next one begins.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/status.h"

namespace gobo {
inline namespace base {

inline constexpr int kMaxExrParts = 1024;

/// Refuses a file whose headers do not fit it: attributes longer than what is left, of a size that is not their type's, or whose
/// contents have another length; more than kMaxExrParts parts; chunk tables that the file cannot hold. O(headers); thread-safe.
/// Errors: InvalidArgument placed at `name`, with the attribute and its byte.
Status checkExrHeaders(const uint8_t* bytes, size_t size, const std::string& name);

/// Bytes that OpenEXR may hold for one chunk or one row of tiles of a file of `fileBytes`: what deflate could have packed, 64 MiB for any.
uint64_t mostExrBuffer(uint64_t fileBytes);

/// Lines in a chunk by the compression's number, 0 for numbers that do not exist.
int exrLinesPerChunk(int compression);

}  // namespace base
}  // namespace gobo
