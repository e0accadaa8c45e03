// SPDX-License-Identifier: Apache-2.0
// PNG and JPEG out of code values, by libpng and libjpeg themselves: what every reply needs must not wait for OpenImageIO's libraries.
#pragma once

#include <cstdint>
#include <vector>

#include "base/status.h"
#include "base/transfer.h"

namespace gobo {
inline namespace base {

/// Rows of code values, top first, channels interleaved; width, height > 0.
struct CodedPixels {
  const uint8_t* values = nullptr;  ///< width * height * channels, of uint8_t, or of uint16_t if `wide`
  int width = 0, height = 0, channels = 0;
  bool wide = false;   ///< PNG
  bool plain = false;  ///< PNG: the header names no transfer function
  Transfer transfer = Transfer::Srgb;
  int quality = 90;  ///< JPEG: 1 .. 100
};

/// 1 to 4 channels; alpha is not premultiplied. ResourceExhausted, Internal.
Result<std::vector<uint8_t>> writePng(const CodedPixels& pixels);
/// 1 or 3 channels.
Result<std::vector<uint8_t>> writeJpeg(const CodedPixels& pixels);

}  // namespace base
}  // namespace gobo
