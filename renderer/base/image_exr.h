// SPDX-License-Identifier: Apache-2.0
// Internal to base/: EXR decoding and the size check that every decoder makes before it allocates.
#pragma once

#include "base/image_io.h"

namespace gobo {
inline namespace base {

/// Refuses empty sizes, sizes above the limits, and sizes that `fileBytes` bytes cannot hold in any format.
Status checkImageSize(int64_t width, int64_t height, int64_t channels, size_t fileBytes, const ReadLimits& limits);

/// First part of an EXR file, its data window; channels of a layer together, R G B A (X Y Z) first. May throw.
Result<Image> readExr(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits);

}  // namespace base
}  // namespace gobo
