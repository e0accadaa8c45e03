// SPDX-License-Identifier: Apache-2.0
#include "base/animated_png.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <string_view>

namespace gobo {
inline namespace base {

namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);

uint32_t bigEndian(std::string_view at) {
  return uint32_t(uint8_t(at[0])) << 24 | uint32_t(uint8_t(at[1])) << 16 | uint32_t(uint8_t(at[2])) << 8 | uint8_t(at[3]);
}
void put32(std::string& out, uint32_t v) {
  for (int shift = 24; shift >= 0; shift -= 8) out += char(v >> shift);
}
void put16(std::string& out, uint32_t v) {
  out += char(v >> 8);
  out += char(v);
}
void putChunk(std::string& out, std::string_view type, std::string_view data) {
  put32(out, uint32_t(data.size()));
  const size_t from = out.size();
  out += type;
  out += data;
  put32(out, uint32_t(crc32(0, reinterpret_cast<const Bytef*>(out.data() + from), uInt(out.size() - from))));
}

/// Calls visit(type, data) for each chunk. False: not a PNG, or cut short.
template <typename Visit>
bool forEachChunk(std::string_view png, Visit&& visit) {
  if (png.substr(0, kSignature.size()) != kSignature) return false;
  png.remove_prefix(kSignature.size());
  while (png.size() >= 12) {
    const uint32_t size = bigEndian(png);
    if (size > png.size() - 12) return false;
    const std::string_view type = png.substr(4, 4);
    visit(type, png.substr(8, size));
    if (type == "IEND") return true;
    png.remove_prefix(12 + size_t(size));
  }
  return false;
}

}  // namespace

Result<std::vector<uint8_t>> animatedPng(std::span<const std::string> frames, uint32_t milliseconds) {
  if (frames.empty()) return invalidArgument("an animation has at least one picture");
  std::string out(kSignature), header;
  uint32_t sequence = 0;
  for (size_t i = 0; i < frames.size(); ++i) {
    std::string_view own;
    std::string before, data;  // chunks that stand before the pixels; these
    const bool whole = forEachChunk(frames[i], [&](std::string_view type, std::string_view chunk) {
      if (type == "IHDR") own = chunk;
      else if (type == "IDAT") data += chunk;
      else if (type != "IEND" && data.empty()) putChunk(before, type, chunk);
    });
    if (!whole || own.size() != 13 || data.empty()) return invalidArgument("picture " + std::to_string(i) + " of an animation is not a PNG");
    if (i == 0) {
      header = own;
      putChunk(out, "IHDR", header);
      std::string control;
      put32(control, uint32_t(frames.size()));
      put32(control, 0);  // for ever
      putChunk(out, "acTL", control);
      out += before;
    } else if (own != header) {
      return invalidArgument("picture " + std::to_string(i) + " of an animation has another size or kind of pixels than the first");
    }
    std::string control;
    put32(control, sequence++);
    control += header.substr(0, 8);  // width, height
    put32(control, 0);
    put32(control, 0);
    put16(control, std::min(milliseconds, 65535u));
    put16(control, 1000);
    control += '\0';  // leave it there;
    control += '\0';  // the next one replaces it
    putChunk(out, "fcTL", control);
    if (i == 0) {
      putChunk(out, "IDAT", data);
    } else {
      std::string numbered;
      put32(numbered, sequence++);
      putChunk(out, "fdAT", numbered + data);
    }
  }
  putChunk(out, "IEND", {});
  return std::vector<uint8_t>(out.begin(), out.end());
}

}  // namespace base
}  // namespace gobo
