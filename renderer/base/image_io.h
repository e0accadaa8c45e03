// SPDX-License-Identifier: Apache-2.0
// Reading and writing pictures: EXR by OpenEXR, everything else by OpenImageIO. Errors name the file.
// Writing is atomic: a temporary file in the same folder, then rename; a failed write leaves nothing behind.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {

struct ReadLimits {
  int maxDimension = 16384;             ///< pixels a side
  uint64_t maxPixels = 1ull << 27;      ///< decompression bombs are refused before their pixels are allocated
};

/// Any readable picture, as floats. Integer formats are scaled to 0..1 and kept in the file's transfer curve
/// (sRGB decoding is the texture's business). HDR and EXR are linear already.
Result<Image> readImage(const std::string& path, const ReadLimits& limits = {});
/// The same from bytes in memory; `name` is used in errors and to guess the format by its extension.
Result<Image> readImageFromMemory(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits = {});

struct ExrOptions {
  bool half = false;
  std::map<std::string, std::string> metadata;  ///< string attributes, e.g. {"gobo:request", json}
};
/// One-part scan-line ZIP EXR holding the image's named channels.
Result<std::vector<uint8_t>> encodeExr(const Image& image, const ExrOptions& options = {});
/// 8-bit sRGB PNG or JPEG of an image that is already display-referred and linear in 0..1 (values outside are clamped).
Result<std::vector<uint8_t>> encodePng(const Image& image);
Result<std::vector<uint8_t>> encodeJpeg(const Image& image, int quality = 90);

/// Writes bytes atomically (temporary + fsync + rename).
Status writeFileAtomic(const std::string& path, const void* data, size_t size);
Result<std::vector<uint8_t>> readFile(const std::string& path, uint64_t maxBytes = 1ull << 32);

}  // namespace gobo
