// SPDX-License-Identifier: Apache-2.0
// Format choice by content, OpenImageIO formats, PNG and JPEG. EXR is in image_exr.cpp, files in file_io.cpp.
#include "base/image_io.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <cstring>

#include "base/image_exr.h"

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
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.data.data())) {
    const std::string why = input->geterror();
    return invalidArgument("damaged " + format + " image" + (why.empty() ? "" : ": " + why), name);
  }
  return image;
}

uint8_t toSrgb8(float linear) {
  if (!(linear > 0.0f)) return 0;  // NaN too
  const double c = std::min(double(linear), 1.0);
  const double e = c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1.0 / 2.4) - 0.055;
  return uint8_t(e * 255.0 + 0.5);
}
uint8_t toUnorm8(float v) { return !(v > 0.0f) ? 0 : uint8_t(std::min(v, 1.0f) * 255.0f + 0.5f); }

Result<std::vector<uint8_t>> encode8(const Image& image, const char* format, int channels, int quality) {
  if (image.width <= 0 || image.height <= 0 || image.channels <= 0 || image.data.size() != image.pixels() * image.channels)
    return invalidArgument("image is empty or its data has the wrong size");
  std::vector<uint8_t> pixels(image.pixels() * channels);
  for (size_t i = 0; i < image.pixels(); ++i)
    for (int c = 0; c < channels; ++c) {
      const float v = image.data[i * image.channels + c];
      pixels[i * channels + c] = c < 3 && !(channels == 2 && c == 1) ? toSrgb8(v) : toUnorm8(v);
    }
  std::vector<uint8_t> out;
  OIIO::Filesystem::IOVecOutput memory(out);
  auto output = OIIO::ImageOutput::create(std::string("memory.") + format, &memory);
  if (!output || !output->supports("ioproxy")) return internalError(std::string("no encoder for ") + format);
  OIIO::ImageSpec spec(image.width, image.height, channels, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  spec.attribute("oiio:UnassociatedAlpha", 1);
  if (quality > 0) spec.attribute("Compression", "jpeg:" + std::to_string(std::clamp(quality, 1, 100)));
  if (!output->set_ioproxy(&memory) || !output->open(std::string("memory.") + format, spec) ||
      !output->write_image(OIIO::TypeDesc::UINT8, pixels.data()) || !output->close())
    return internalError(std::string("cannot encode ") + format + ": " + output->geterror());
  return out;
}

}  // namespace

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
  return {};
}

Result<Image> readImageFromMemory(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  if (size == 0) return invalidArgument("image is empty", name);
  std::string format = sniff(bytes, size);
  if (format.empty()) format = extension(name);
  if (format == "tga" || format == "targa") format = "tga";
  if (format.empty()) return invalidArgument("unknown image format", name);
  try {
    if (format == "exr") return readExr(bytes, size, name, limits);
    return readByOiio(bytes, size, format, name, limits);
  } catch (const std::exception& e) {
    return invalidArgument("damaged " + format + " image: " + e.what(), name);
  }
}

Result<Image> readImage(const std::string& path, const ReadLimits& limits) {
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(path));
  return readImageFromMemory(bytes.data(), bytes.size(), path, limits);
}

Result<std::vector<uint8_t>> encodePng(const Image& image) { return encode8(image, "png", std::min(image.channels, 4), 0); }

Result<std::vector<uint8_t>> encodeJpeg(const Image& image, int quality) {
  return encode8(image, "jpg", image.channels >= 3 ? 3 : 1, quality);
}

}  // namespace gobo
