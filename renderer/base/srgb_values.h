// SPDX-License-Identifier: Apache-2.0
// What readImage leaves to its callers: values of PNG and JPEG files are of a transfer curve.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/image.h"
#include "base/stop.h"

namespace gobo {
inline namespace base {

/// The bytes of a PNG that does not say that its gamma is 1 (gAMA, as encodePng writes it for Transfer::Linear), or of a JPEG.
bool holdsSrgbValues(const uint8_t* bytes, size_t size);
/// sRGB code values of 8 or 16 bits, as shares of the greatest, to linear ones; alpha stays. False if `stop` fired first.
bool decodeSrgbValues(Image& image, const StopToken& stop = {});

}  // namespace base
}  // namespace gobo
