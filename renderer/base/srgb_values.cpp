// SPDX-License-Identifier: Apache-2.0
#include "base/srgb_values.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include "base/transfer.h"

namespace gobo {
inline namespace base {

namespace {

uint32_t bigEndian(std::string_view four) {
  uint32_t value = 0;
  for (const char c : four) value = value << 8 | uint8_t(c);
  return value;
}

/// gAMA is in units of 1e-5 and before the pixels.
bool saysGammaOne(std::string_view png) {
  for (size_t at = 8; at + 12 <= png.size();) {
    const uint32_t length = bigEndian(png.substr(at, 4));
    const std::string_view type = png.substr(at + 4, 4);
    if (type == "IDAT" || length > png.size() - at - 12) return false;
    if (type == "gAMA" && length == 4) return bigEndian(png.substr(at + 8, 4)) == 100000;
    at += 12 + size_t(length);
  }
  return false;
}

}  // namespace

bool holdsSrgbValues(const uint8_t* bytes, size_t size) {
  const std::string_view file(reinterpret_cast<const char*>(bytes), size);
  if (file.substr(0, 8) == std::string_view("\x89PNG\r\n\x1a\n", 8)) return !saysGammaOne(file);
  return file.substr(0, 3) == "\xff\xd8\xff";
}

bool decodeSrgbValues(Image& image, const StopToken& stop) {
  constexpr int kMost = 65535;  // a code value k of 8 bits is 257 k of 16
  std::vector<float> decoded(kMost + 1);
  for (int k = 0; k <= kMost; ++k) decoded[size_t(k)] = float(decodeTransfer(Transfer::Srgb, double(k) / kMost));
  const size_t channels = size_t(image.channels), colours = channels >= 3 ? 3 : 1, row = size_t(image.width) * channels;
  for (size_t y = 0; y < size_t(image.height); ++y) {
    if (stop.stopRequested()) return false;
    for (size_t i = y * row; i < (y + 1) * row; i += channels)
      for (size_t c = i; c < i + colours; ++c) image.data[c] = decoded[size_t(std::clamp(std::lround(double(image.data[c]) * kMost), 0l, long(kMost)))];
  }
  return true;
}

}  // namespace base
}  // namespace gobo
