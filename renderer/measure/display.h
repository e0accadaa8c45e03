// SPDX-License-Identifier: Apache-2.0
// The display mapping that the picture-quality metrics (SSIM, FLIP) are defined on here: exposure 0, each channel of the linear
// Rec.709 radiance clamped to [0,1] (NaN to 0), then the sRGB curve of IEC 61966-2-1. Pure; any thread.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/transfer.h"
#include "base/vec.h"

namespace gobo {
inline namespace measure {

inline double displayLinear(float radiance) { return radiance > 0 ? std::min(double(radiance), 1.0) : 0.0; }
inline double srgbEncode(double linear) { return encodeTransfer(Transfer::Srgb, linear); }
/// Luma of the mapped colour, 0..1: Rec.709 weights of the encoded channels.
inline double displayLuma(const Vec3& radiance) {
  return 0.2126 * srgbEncode(displayLinear(radiance.x)) + 0.7152 * srgbEncode(displayLinear(radiance.y)) + 0.0722 * srgbEncode(displayLinear(radiance.z));
}

}  // namespace measure
}  // namespace gobo
