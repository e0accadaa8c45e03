// SPDX-License-Identifier: Apache-2.0
// Format choice by content, what is taken out of PNG and JPEG before a library sees them. EXR is in image_exr.cpp, files in file_io.cpp, the
// other formats in renderer/codec.
#include "base/image_io.h"

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstring>
#include <limits>

#include "base/decode_limit.h"
#include "base/image_codec.h"
#include "base/image_exr.h"
#include "base/image_write.h"
#include "base/srgb_values.h"
#include "base/utf8.h"

namespace gobo {
inline namespace base {
namespace {

bool starts(const uint8_t* b, size_t size, std::string_view magic) { return size >= magic.size() && std::memcmp(b, magic.data(), magic.size()) == 0; }

/// Format extension by the first bytes; "" when unknown. A wrong file name must not select a parser.
std::string sniff(const uint8_t* b, size_t n) {
  if (starts(b, n, "\x76\x2f\x31\x01")) return "exr";
  if (starts(b, n, "\x89PNG")) return "png";
  if (starts(b, n, "\xff\xd8\xff")) return "jpg";
  if (starts(b, n, "#?")) return "hdr";
  if (starts(b, n, "BM")) return "bmp";
  if (starts(b, n, "GIF8")) return "gif";
  if (starts(b, n, std::string_view("II*\0", 4)) || starts(b, n, std::string_view("MM\0*", 4)) || starts(b, n, std::string_view("II+\0", 4)) ||
      starts(b, n, std::string_view("MM\0+", 4)))
    return "tif";
  if (starts(b, n, "DDS ")) return "dds";
  if (starts(b, n, "8BPS")) return "psd";
  if (n >= 12 && starts(b, n, "RIFF") && std::memcmp(b + 8, "WEBP", 4) == 0) return "webp";
  if (n >= 2 && b[0] == 'P' && ((b[1] >= '1' && b[1] <= '7') || b[1] == 'f' || b[1] == 'F')) return "pnm";
  if (starts(b, n, "SDPX") || starts(b, n, "XPDS")) return "dpx";
  return "";
}

std::string extension(const std::string& name) {
  const size_t dot = name.find_last_of('.');
  if (dot == std::string::npos || name.find('/', dot) != std::string::npos) return "";
  std::string e = name.substr(dot + 1);
  for (char& c : e) c = char(std::tolower(uint8_t(c)));
  return e;
}

/// The PNG's picture chunks alone; sizes are checked before the library opens the file. Dropped: ICC, Exif and text, for the
/// same reason as below.
Result<std::vector<uint8_t>> plainPng(const uint8_t* b, size_t n, const ReadLimits& limits) {
  auto word = [&](size_t i) { return uint64_t(b[i]) << 24 | uint64_t(b[i + 1]) << 16 | uint64_t(b[i + 2]) << 8 | b[i + 3]; };
  if (n < 33 || std::memcmp(b + 12, "IHDR", 4) != 0) return invalidArgument("PNG header is cut short");
  GOBO_TRY(checkImageSize(int64_t(word(16)), int64_t(word(20)), b[25] == 0 ? 1 : b[25] == 4 ? 2 : b[25] == 6 ? 4 : 3, n, limits));
  std::vector<uint8_t> out(b, b + 8);
  out.reserve(n);
  for (size_t i = 8; i + 12 <= n;) {
    const uint64_t length = word(i);
    if (length > n - i - 12) return invalidArgument("PNG chunk at byte " + std::to_string(i) + " is cut short");
    const std::string_view type(reinterpret_cast<const char*>(b + i + 4), 4);
    if (type == "IHDR" || type == "PLTE" || type == "tRNS" || type == "IDAT" || type == "IEND") out.insert(out.end(), b + i, b + i + 12 + length);
    if (type == "IEND") return out;
    i += 12 + size_t(length);
  }
  return invalidArgument("PNG without an end chunk");
}

/// The end of the entropy-coded data from i on: the next marker that is neither a stuffed byte nor a restart, or n.
size_t endOfScan(const uint8_t* b, size_t n, size_t i) {
  for (; i + 1 < n; ++i)
    if (b[i] == 0xff && b[i + 1] != 0x00 && b[i + 1] != 0xff && (b[i + 1] < 0xd0 || b[i + 1] > 0xd7)) return i;
  return n;
}

/// The JPEG without what a picture does not need: APPn segments but for JFIF and Adobe (which say how colours are coded), and
/// comments, between scans too. OpenImageIO 2.4 reads out of bounds in damaged ICC profiles, Exif and IPTC blocks, and we use none. Refuses sizes
/// above the limits here, because opening a progressive JPEG already decodes all its scans. Damage after the first scan ends the picture there.
Result<std::vector<uint8_t>> plainJpeg(const uint8_t* b, size_t n, const ReadLimits& limits) {
  std::vector<uint8_t> out = {0xff, 0xd8};
  out.reserve(n);
  bool framed = false, scanned = false;
  for (size_t i = 2; i + 4 <= n;) {
    if (b[i] != 0xff) {
      if (scanned) break;
      return invalidArgument("JPEG segment marker expected at byte " + std::to_string(i));
    }
    const int marker = b[i + 1];
    if (marker == 0xff) {
      ++i;
      continue;
    }
    if (marker == 0xd9 && scanned) break;
    if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) {
      i += 2;
      continue;
    }
    const size_t length = size_t(b[i + 2]) << 8 | b[i + 3];
    if (length < 2 || length > n - i - 2) {
      if (scanned) break;
      return invalidArgument("JPEG segment at byte " + std::to_string(i) + " is cut short");
    }
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame) {
      if (length < 8) return invalidArgument("JPEG frame header is cut short");
      GOBO_TRY(checkImageSize(b[i + 7] << 8 | b[i + 8], b[i + 5] << 8 | b[i + 6], b[i + 9], n, limits));
      framed = true;
    }
    const bool scan = marker == 0xda;
    if (scan && !framed) break;
    const bool dropped = marker == 0xfe || (marker >= 0xe1 && marker <= 0xef && marker != 0xee);
    const size_t end = scan ? endOfScan(b, n, i + 2 + length) : i + 2 + length;
    if (!dropped) out.insert(out.end(), b + i, b + end);
    scanned = scanned || scan;
    i = end;
  }
  if (!scanned) return invalidArgument("JPEG without a frame or a scan");
  out.insert(out.end(), {0xff, 0xd9});
  return out;
}

Result<Image> readByCodec(const uint8_t* bytes, size_t size, const std::string& format, const std::string& name, const ReadLimits& limits) {
  GOBO_ASSIGN(const ImageCodec* const codec, imageCodec());
  return codec->decode(bytes, size, format, name, limits, checkImageSize);
}

/// Code value of `v` in 0 .. 2^bits - 1, rounded to nearest; NaN is 0.
uint32_t codeValue(float v, Transfer transfer, double top) { return uint32_t(encodeTransfer(transfer, double(v)) * top + 0.5); }

template <typename T>
std::vector<uint8_t> codeValues(const Image& image, int channels, Transfer transfer) {
  const double top = double(std::numeric_limits<T>::max());
  const int colours = channels >= 3 ? 3 : 1;
  std::vector<uint8_t> bytes(image.pixels() * channels * sizeof(T));
  for (size_t i = 0; i < image.pixels(); ++i)
    for (int c = 0; c < channels; ++c) {
      const T v = T(codeValue(image.data[i * image.channels + c], c < colours ? transfer : Transfer::Linear, top));
      std::memcpy(bytes.data() + (i * channels + c) * sizeof(T), &v, sizeof(T));
    }
  return bytes;
}

Result<std::vector<uint8_t>> encodeIntegers(const Image& image, bool jpeg, int channels, const PixelOptions& options) {
  if (image.width <= 0 || image.height <= 0 || image.channels <= 0 || image.data.size() != image.pixels() * image.channels)
    return invalidArgument("image is empty or its data has the wrong size");
  const bool wide = !jpeg && options.bits == 16;
  const Transfer transfer = options.data ? Transfer::Linear : options.transfer;
  const std::vector<uint8_t> values = wide ? codeValues<uint16_t>(image, channels, transfer) : codeValues<uint8_t>(image, channels, transfer);
  const CodedPixels pixels{values.data(), image.width, image.height, channels, wide, options.data, transfer, std::clamp(options.quality, 1, 100)};
  return jpeg ? writeJpeg(pixels) : writePng(pixels);
}

}  // namespace

namespace {
std::atomic<uint64_t> decodedLimit{kMostDecodedBytes};
}  // namespace

void setMostDecodedBytes(uint64_t bytes) { decodedLimit = bytes; }
uint64_t mostDecodedBytes() { return decodedLimit; }

Status checkImageSize(int64_t width, int64_t height, int64_t channels, size_t fileBytes, const ReadLimits& limits) {
  const std::string size = std::to_string(width) + " x " + std::to_string(height) + " x " + std::to_string(channels);
  if (width <= 0 || height <= 0 || channels <= 0) return invalidArgument("image size " + size + " is empty");
  if (width > limits.maxDimension || height > limits.maxDimension || uint64_t(width) * uint64_t(height) > limits.maxPixels)
    return Status(Code::ResourceExhausted, "image size " + size + " is above the limit of " + std::to_string(limits.maxDimension) + " pixels a side, " +
                                               std::to_string(limits.maxPixels) + " in all");
  if (channels > 64) return Status(Code::ResourceExhausted, "image has " + std::to_string(channels) + " channels; at most 64 are read");
  // No format packs more than about 8000 pixels into a byte (deflate of 1-bit pixels): more is a damaged or hostile header.
  const uint64_t pixels = uint64_t(width) * uint64_t(height);
  if (pixels > (1u << 16) && pixels / 16384 > fileBytes)
    return invalidArgument("image size " + size + " cannot come from " + std::to_string(fileBytes) + " bytes");
  // What decoders really make of a small file: a flat picture of 382 KB was 1.6 GB of floats.
  const uint64_t decoded = pixels * uint64_t(channels) * sizeof(float);
  if (decoded > std::max({mostDecodedBytes(), uint64_t(fileBytes) * kDecodedPerByte, kLeastDecodedBytes}))
    return Status(Code::ResourceExhausted, "image size " + size + " is " + std::to_string(decoded) + " bytes out of a file of " + std::to_string(fileBytes) +
                                               ", above the limit of " + std::to_string(std::max(mostDecodedBytes(), kLeastDecodedBytes)) +
                                               " (ingest.texture_bytes) and above " + std::to_string(kDecodedPerByte) + " times the file");
  return {};
}

namespace {

Result<Image> readBytes(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  if (size == 0) return invalidArgument("image is empty", name);
  std::string format = sniff(bytes, size);
  if (format.empty()) format = extension(name);
  if (format == "targa") format = "tga";
  if (format == "jpeg") format = "jpg";
  if (format.empty()) return invalidArgument("unknown image format", name);
  try {
    if (format == "exr") return readExr(bytes, size, name, limits);
    if (format == "png" || format == "jpg") {
      const auto plain = format == "png" ? plainPng(bytes, size, limits) : plainJpeg(bytes, size, limits);
      if (!plain.ok()) return plain.status().at(name);
      return readByCodec(plain->data(), plain->size(), format, name, limits);
    }
    return readByCodec(bytes, size, format, name, limits);
  } catch (const std::exception& e) { return invalidArgument("damaged " + format + " image: " + e.what(), name); }
}

}  // namespace

Result<Image> readImageFromMemory(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  auto image = readBytes(bytes, size, name, limits);
  if (!image.ok()) return cleanUtf8(image.status());  // libraries quote names from the file
  return image;
}

Result<Image> readImage(const std::string& path, const ReadLimits& limits) {
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(path));
  return readImageFromMemory(bytes.data(), bytes.size(), path, limits);
}

Result<Image> readPicture(const std::string& fileAndLayer, const ReadLimits& limits) {
  std::string file = fileAndLayer, layer;
  // The file's name ends at the first ".exr:": a layer may be called after an output that holds colons itself.
  const size_t colon = fileAndLayer.find(".exr:");
  if (colon != std::string::npos) {
    file = fileAndLayer.substr(0, colon + 4);
    layer = fileAndLayer.substr(colon + 5);
  }
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(file));
  if (!starts(bytes.data(), bytes.size(), "\x76\x2f\x31\x01")) {
    if (!layer.empty()) return invalidArgument("only EXR files have layers", fileAndLayer);
    GOBO_ASSIGN(Image image, readImageFromMemory(bytes.data(), bytes.size(), file, limits));
    if (holdsSrgbValues(bytes.data(), bytes.size()) && !decodeSrgbValues(image, limits.stop)) return Status(Code::Cancelled, "the reading was cancelled", file);
    return image;
  }
  return readExrLayer(bytes.data(), bytes.size(), file, layer, limits);
}

Result<std::vector<uint8_t>> encodePng(const Image& image, const PixelOptions& options) {
  return encodeIntegers(image, false, std::min(image.channels, 4), options);
}

Result<std::vector<uint8_t>> encodeJpeg(const Image& image, const PixelOptions& options) {
  return encodeIntegers(image, true, image.channels >= 3 ? 3 : 1, options);
}

}  // namespace base
}  // namespace gobo
