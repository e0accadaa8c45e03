// SPDX-License-Identifier: Apache-2.0
#include "base/exr_header.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <string_view>

namespace gobo {
inline namespace base {
namespace {

/// Types that OpenEXR reads without looking at the size; 0 for lists and texts, which are measured below.
const std::map<std::string_view, uint32_t>& sizesOfTypes() {
  static const std::map<std::string_view, uint32_t> sizes{
      {"int", 4},         {"float", 4},     {"double", 8}, {"box2i", 16},         {"box2f", 16},   {"v2i", 8},      {"v2f", 8},      {"v2d", 16},
      {"v3i", 12},        {"v3f", 12},      {"v3d", 24},   {"m33f", 36},          {"m33d", 72},    {"m44f", 64},    {"m44d", 128},   {"chromaticities", 32},
      {"compression", 1}, {"lineOrder", 1}, {"envmap", 1}, {"deepImageState", 1}, {"keycode", 28}, {"rational", 8}, {"timecode", 8}, {"tiledesc", 9}};
  return sizes;
}

struct PartHeader {
  int64_t width = 0, height = 0, tileWidth = 0, tileHeight = 0, chunkCount = 0;
  int compression = 0;
};

class Walk {
 public:
  Walk(const uint8_t* bytes, size_t size, const std::string& name) : bytes_(bytes), size_(size), name_(name) {}

  Status files() {
    if (size_ < 8) return cut();
    const bool many = bytes_[5] & 0x10, tiled = bytes_[5] & 0x02;
    at_ = 8;
    uint64_t tables = 0;
    for (int parts = 0;; ++parts) {
      if (parts == kMaxExrParts) return invalidArgument("EXR has more than " + std::to_string(kMaxExrParts) + " parts", name_);
      PartHeader part;
      bool empty = false;
      GOBO_TRY(header(part, empty));
      if (empty && (many || parts > 0)) return {};
      tables += chunks(part, many || tiled) * 8;
      if (tables > size_)
        return invalidArgument("EXR of " + std::to_string(part.width) + " x " + std::to_string(part.height) + " has a chunk table of " +
                                   std::to_string(tables) + " bytes, which the file cannot hold",
                               name_);
      if (!many) return {};
    }
  }

 private:
  Status cut() const { return invalidArgument("EXR header is cut short", name_); }

  bool text(std::string_view& out) {
    const auto* from = bytes_ + at_;
    const auto* end = static_cast<const uint8_t*>(std::memchr(from, 0, size_ - at_));
    if (!end) return false;
    out = {reinterpret_cast<const char*>(from), size_t(end - from)};
    at_ += out.size() + 1;
    return true;
  }
  template <typename T>
  T number(size_t at) const {
    T v;
    std::memcpy(&v, bytes_ + at, sizeof v);
    return v;
  }

  /// Attributes up to the header's end. `empty`: there was none.
  Status header(PartHeader& part, bool& empty) {
    for (empty = true;; empty = false) {
      std::string_view name, type;
      if (!text(name)) return cut();
      if (name.empty()) return {};
      if (!text(type) || size_ - at_ < 4) return cut();
      const uint32_t bytes = number<uint32_t>(at_);
      at_ += 4;
      const auto wrong = [&](const std::string& why) {
        return invalidArgument("EXR attribute \"" + std::string(name.substr(0, 60)) + "\" (" + std::string(type.substr(0, 60)) + ") of " +
                                   std::to_string(bytes) + " bytes at byte " + std::to_string(at_) + " " + why,
                               name_);
      };
      if (bytes > size_ - at_) return wrong("does not fit the file");
      const auto fixed = sizesOfTypes().find(type);
      if (fixed != sizesOfTypes().end() && fixed->second != bytes) return wrong("should have " + std::to_string(fixed->second));
      if (!whole(type, bytes)) return wrong("does not have the length of its contents");
      take(part, name, type);
      at_ += bytes;
    }
  }

  /// Lists fill their attribute exactly.
  bool whole(std::string_view type, uint32_t bytes) const {
    const size_t end = at_ + bytes;
    if (type == "floatvector") return bytes % 4 == 0;
    if (type == "preview")
      return bytes >= 8 && number<uint32_t>(at_) <= bytes && number<uint32_t>(at_ + 4) <= bytes &&
             bytes == 8 + uint64_t(number<uint32_t>(at_)) * number<uint32_t>(at_ + 4) * 4;
    if (type == "idmanifest") return bytes >= 4;
    if (type == "stringvector") {
      size_t at = at_;
      while (end - at >= 4 && number<uint32_t>(at) <= end - at - 4) at += 4 + number<uint32_t>(at);
      return at == end;
    }
    if (type == "chlist") {
      for (size_t at = at_; at < end;) {
        const auto* zero = static_cast<const uint8_t*>(std::memchr(bytes_ + at, 0, end - at));
        if (!zero) return false;
        const size_t length = size_t(zero - bytes_) - at;
        at += length + 1;
        if (length == 0) return at == end;
        if (end - at < 16) return false;
        at += 16;
      }
      return false;
    }
    return true;
  }

  void take(PartHeader& part, std::string_view name, std::string_view type) const {
    if (name == "dataWindow" && type == "box2i") {
      part.width = int64_t(number<int32_t>(at_ + 8)) - number<int32_t>(at_) + 1;
      part.height = int64_t(number<int32_t>(at_ + 12)) - number<int32_t>(at_ + 4) + 1;
    } else if (name == "tiles" && type == "tiledesc") {
      part.tileWidth = number<uint32_t>(at_);
      part.tileHeight = number<uint32_t>(at_ + 4);
    } else if (name == "compression" && type == "compression") part.compression = bytes_[at_];
    else if (name == "chunkCount" && type == "int") part.chunkCount = std::max<int64_t>(0, number<int32_t>(at_));
  }

  /// Entries of the chunk table, those of level 0 alone; 0 where OpenEXR will say what is wrong.
  static uint64_t chunks(const PartHeader& p, bool mayBeTiled) {
    const int lines = exrLinesPerChunk(p.compression);
    if (p.width <= 0 || p.height <= 0 || lines == 0) return uint64_t(p.chunkCount);
    uint64_t n = (uint64_t(p.height) + uint64_t(lines) - 1) / uint64_t(lines);
    if (mayBeTiled && p.tileWidth > 0 && p.tileHeight > 0)
      n = uint64_t((p.width + p.tileWidth - 1) / p.tileWidth) * uint64_t((p.height + p.tileHeight - 1) / p.tileHeight);
    return std::max(n, uint64_t(p.chunkCount));
  }

  const uint8_t* bytes_;
  size_t size_, at_ = 0;
  const std::string& name_;
};

}  // namespace

Status checkExrHeaders(const uint8_t* bytes, size_t size, const std::string& name) { return Walk(bytes, size, name).files(); }

uint64_t mostExrBuffer(uint64_t fileBytes) { return std::max<uint64_t>(64 << 20, fileBytes * 1024); }

int exrLinesPerChunk(int compression) {
  constexpr int lines[] = {1, 1, 1, 16, 32, 16, 32, 32, 32, 256};  // none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB
  return compression >= 0 && compression < int(std::size(lines)) ? lines[compression] : 0;
}

}  // namespace base
}  // namespace gobo
