// SPDX-License-Identifier: Apache-2.0
// Pictures in a row as one APNG (PNG third edition, W3C 2025): browsers play it, anything else that reads PNG shows its first picture.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace base {

/// `frames`: bytes of PNGs of one size and kind of pixels, which are taken as they are. Shown for `milliseconds` each (at most 65 535), over and over.
/// Errors: InvalidArgument where there is none, one is no PNG, or its header is another than the first one's.
Result<std::vector<uint8_t>> animatedPng(std::span<const std::string> frames, uint32_t milliseconds);

}  // namespace base
}  // namespace gobo
