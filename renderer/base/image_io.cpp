// SPDX-License-Identifier: Apache-2.0
// Format choice by content, OpenImageIO formats, PNG and JPEG. EXR is in image_exr.cpp, files in file_io.cpp.
#include "base/image_io.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstring>
#include <limits>

#include "base/decode_limit.h"
#include "base/image_exr.h"
#include "base/utf8.h"

namespace gobo {
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
      starts(b, n, std::string_view("MM\0+", 4))) return "tif";
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

/// The JPEG without what a picture does not need: APPn segments but for JFIF and Adobe (which say how colours are coded), and
/// comments. OpenImageIO 2.4 reads out of bounds in damaged ICC profiles and Exif blocks, and we use neither. Refuses sizes
/// above the limits here, because opening a progressive JPEG already decodes all its scans.
Result<std::vector<uint8_t>> plainJpeg(const uint8_t* b, size_t n, const ReadLimits& limits) {
  std::vector<uint8_t> out = {0xff, 0xd8};
  out.reserve(n);
  bool framed = false;
  for (size_t i = 2; i + 4 <= n;) {
    if (b[i] != 0xff) return invalidArgument("JPEG segment marker expected at byte " + std::to_string(i));
    const int marker = b[i + 1];
    if (marker == 0xff) { ++i; continue; }
    if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) { i += 2; continue; }
    const size_t length = size_t(b[i + 2]) << 8 | b[i + 3];
    if (length < 2 || length > n - i - 2) return invalidArgument("JPEG segment at byte " + std::to_string(i) + " is cut short");
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame) {
      if (length < 8) return invalidArgument("JPEG frame header is cut short");
      GOBO_TRY(checkImageSize(b[i + 7] << 8 | b[i + 8], b[i + 5] << 8 | b[i + 6], b[i + 9], n, limits));
      framed = true;
    }
    if (marker == 0xda) {  // scan data: the rest as it is
      if (!framed) break;
      out.insert(out.end(), b + i, b + n);
      return out;
    }
    const bool dropped = marker == 0xfe || (marker >= 0xe1 && marker <= 0xef && marker != 0xee);
    if (!dropped) out.insert(out.end(), b + i, b + i + 2 + length);
    i += 2 + length;
  }
  return invalidArgument("JPEG without a frame or a scan");
}

Result<Image> readByOiio(const uint8_t* bytes, size_t size, const std::string& format, const std::string& name, const ReadLimits& limits) {
  OIIO::Filesystem::IOMemReader memory(const_cast<uint8_t*>(bytes), size);
  auto input = OIIO::ImageInput::create("memory." + format, false, nullptr, &memory);
  if (!input) {
    OIIO::geterror();
    return invalidArgument("unknown image format", name);
  }
  if (!input->supports("ioproxy")) return Status(Code::Unimplemented, "image format " + format + " cannot be read", name);
  OIIO::ImageSpec config, spec;
  config.attribute("oiio:UnassociatedAlpha", 1);  // glTF and our own PNGs keep colour and alpha apart
  // The name must not exist as a file: readers that ignore the proxy would open it.
  if (!input->set_ioproxy(&memory) || !input->open("memory." + format, spec, config)) {
    const std::string why = input->geterror();
    return invalidArgument("not a readable " + format + " image" + (why.empty() ? "" : ": " + why), name);
  }
  GOBO_TRY(checkImageSize(spec.width, spec.height, spec.nchannels, size, limits).at(name));
  if (spec.depth > 1) return invalidArgument("volume images are not read", name);
  if (spec.deep) return invalidArgument("deep images are not read", name);
  Image image(spec.width, spec.height, spec.nchannels);
  image.names = {spec.channelnames.begin(), spec.channelnames.end()};
  // Rows in whole strips between polls; tiles by the library, which asks for itself.
  bool read = true;
  if (spec.tile_width > 0) {
    const OIIO::ProgressCallback stopped = [](void* stop, float) { return static_cast<const StopToken*>(stop)->stopRequested(); };
    read = input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data(), OIIO::AutoStride, OIIO::AutoStride, OIIO::AutoStride, stopped,
                             const_cast<StopToken*>(&limits.stop));
  } else {
    const int strip = std::max(1, spec.get_int_attribute("tiff:RowsPerStrip", 1)), rows = std::max(64 / strip, 1) * strip;
    for (int y = 0; y < spec.height && read && !limits.stop.stopRequested(); y += rows) {
      const int end = std::min(spec.height, y + rows);
      float* to = image.data.data() + size_t(y) * size_t(spec.width) * size_t(spec.nchannels);
      read = input->read_scanlines(0, 0, spec.y + y, spec.y + end, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, to);
    }
  }
  if (limits.stop.stopRequested()) return Status(Code::Cancelled, "the reading was cancelled", name);
  if (!read) {
    const std::string why = input->geterror();
    return invalidArgument("damaged " + format + " image" + (why.empty() ? "" : ": " + why), name);
  }
  return image;
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

Result<std::vector<uint8_t>> encodeIntegers(const Image& image, const char* format, int channels, const PixelOptions& options) {
  if (image.width <= 0 || image.height <= 0 || image.channels <= 0 || image.data.size() != image.pixels() * image.channels)
    return invalidArgument("image is empty or its data has the wrong size");
  const bool jpeg = std::string_view(format) == "jpg", wide = !jpeg && options.bits == 16;
  const OIIO::TypeDesc type = wide ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8;
  const Transfer transfer = options.data ? Transfer::Linear : options.transfer;
  const std::vector<uint8_t> pixels = wide ? codeValues<uint16_t>(image, channels, transfer) : codeValues<uint8_t>(image, channels, transfer);
  std::vector<uint8_t> out;
  OIIO::Filesystem::IOVecOutput memory(out);
  auto output = OIIO::ImageOutput::create(std::string("memory.") + format, &memory);
  if (!output || !output->supports("ioproxy")) return internalError(std::string("no encoder for ") + format);
  OIIO::ImageSpec spec(image.width, image.height, channels, type);
  if (!options.data && transfer == Transfer::Srgb) spec.attribute("oiio:ColorSpace", "sRGB");
  if (!options.data && transfer == Transfer::Linear) spec.attribute("oiio:ColorSpace", "Linear");
  spec.attribute("oiio:UnassociatedAlpha", 1);
  if (jpeg) spec.attribute("Compression", "jpeg:" + std::to_string(std::clamp(options.quality, 1, 100)));
  if (!output->set_ioproxy(&memory) || !output->open(std::string("memory.") + format, spec) ||
      !output->write_image(type, pixels.data()) || !output->close())
    return internalError(std::string("cannot encode ") + format + ": " + output->geterror());
  return out;
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
    return Status(Code::ResourceExhausted, "image size " + size + " is above the limit of " + std::to_string(limits.maxDimension) +
                  " pixels a side, " + std::to_string(limits.maxPixels) + " in all");
  if (channels > 64) return Status(Code::ResourceExhausted, "image has " + std::to_string(channels) + " channels; at most 64 are read");
  // No format packs more than about 8000 pixels into a byte (deflate of 1-bit pixels): more is a damaged or hostile header.
  const uint64_t pixels = uint64_t(width) * uint64_t(height);
  if (pixels > (1u << 16) && pixels / 16384 > fileBytes)
    return invalidArgument("image size " + size + " cannot come from " + std::to_string(fileBytes) + " bytes");
  // What decoders really make of a small file: a flat picture of 382 KB was 1.6 GB of floats.
  const uint64_t decoded = pixels * uint64_t(channels) * sizeof(float);
  if (decoded > std::max({mostDecodedBytes(), uint64_t(fileBytes) * kDecodedPerByte, kLeastDecodedBytes}))
    return Status(Code::ResourceExhausted, "image size " + size + " is " + std::to_string(decoded) + " bytes out of a file of " + std::to_string(fileBytes) + ", above the limit of " +
                  std::to_string(std::max(mostDecodedBytes(), kLeastDecodedBytes)) + " (ingest.texture_bytes) and above " + std::to_string(kDecodedPerByte) + " times the file");
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
      return readByOiio(plain->data(), plain->size(), format, name, limits);
    }
    return readByOiio(bytes, size, format, name, limits);
  } catch (const std::exception& e) {
    return invalidArgument("damaged " + format + " image: " + e.what(), name);
  }
}

}  // namespace

Result<Image> readImageFromMemory(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  auto image = readBytes(bytes, size, name, limits);
  if (!image.ok()) return cleanUtf8(image.status());   // libraries quote names from the file
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
    return readImageFromMemory(bytes.data(), bytes.size(), file, limits);
  }
  return readExrLayer(bytes.data(), bytes.size(), file, layer, limits);
}

Result<std::vector<uint8_t>> encodePng(const Image& image, const PixelOptions& options) {
  return encodeIntegers(image, "png", std::min(image.channels, 4), options);
}

Result<std::vector<uint8_t>> encodeJpeg(const Image& image, const PixelOptions& options) {
  return encodeIntegers(image, "jpg", image.channels >= 3 ? 3 : 1, options);
}

}  // namespace gobo
