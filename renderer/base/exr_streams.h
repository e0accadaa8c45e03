// SPDX-License-Identifier: Apache-2.0
// OpenEXR's streams over memory, for the files of base/ that use the library; no other header knows it.
#pragma once

#include <ImfCompression.h>
#include <ImfIO.h>

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "base/image_io.h"

namespace gobo {
inline namespace base {

class MemoryReader final : public Imf::IStream {
 public:
  MemoryReader(const uint8_t* bytes, size_t size) : IStream("memory"), bytes_(bytes), size_(size) {}
  bool isMemoryMapped() const override { return true; }
  char* readMemoryMapped(int n) override { return const_cast<char*>(reinterpret_cast<const char*>(take(n))); }
  bool read(char c[], int n) override {
    std::memcpy(c, take(n), size_t(n));
    return at_ < size_;
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t pos) override { at_ = pos; }
  void clear() override {}

 private:
  const uint8_t* take(int n) {
    if (n < 0 || at_ > size_ || uint64_t(n) > size_ - at_) throw std::runtime_error("unexpected end of file");
    const uint8_t* p = bytes_ + at_;
    at_ += uint64_t(n);
    return p;
  }
  const uint8_t* bytes_;
  uint64_t size_, at_ = 0;
};

class MemoryWriter final : public Imf::OStream {
 public:
  explicit MemoryWriter(std::vector<uint8_t>& out) : OStream("memory"), out_(out) {}
  void write(const char c[], int n) override {
    if (at_ + uint64_t(n) > out_.size()) out_.resize(at_ + uint64_t(n));
    std::memcpy(out_.data() + at_, c, size_t(n));
    at_ += uint64_t(n);
  }
  uint64_t tellp() override { return at_; }
  void seekp(uint64_t pos) override { at_ = pos; }

 private:
  std::vector<uint8_t>& out_;
  uint64_t at_ = 0;
};

inline Imf::Compression exrCompression(ExrCompression c) {
  switch (c) {
    case ExrCompression::None: return Imf::NO_COMPRESSION;
    case ExrCompression::Rle: return Imf::RLE_COMPRESSION;
    case ExrCompression::Zips: return Imf::ZIPS_COMPRESSION;
    case ExrCompression::Zip: return Imf::ZIP_COMPRESSION;
    case ExrCompression::Piz: return Imf::PIZ_COMPRESSION;
    case ExrCompression::Dwaa: return Imf::DWAA_COMPRESSION;
    case ExrCompression::Dwab: return Imf::DWAB_COMPRESSION;
  }
  return Imf::ZIP_COMPRESSION;
}

}  // namespace base
}  // namespace gobo
