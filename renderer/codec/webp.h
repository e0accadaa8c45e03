// SPDX-License-Identifier: Apache-2.0
// WebP by libwebp itself: OpenImageIO 2.4 gives colours multiplied by alpha, whatever it is asked for.
#pragma once

#include "base/image_codec.h"

namespace gobo {
inline namespace base {

/// As ImageCodec::decode: R G B, and A where the picture has it, apart from each other. Animated ones are refused.
Result<Image> decodeWebp(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits, ImageCodec::SizeCheck check);

}  // namespace base
}  // namespace gobo
