// SPDX-License-Identifier: Apache-2.0
#include "base/image_exr.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfRgbaFile.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <cstring>
#include <set>
#include <tuple>

namespace gobo {
namespace {

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

/// Order within an image: the nameless layer first, then layers by name; in a layer R G B A, X Y Z, then the rest by name.
auto channelOrder(const std::string& channel) {
  const size_t dot = channel.find_last_of('.');
  const std::string layer = dot == std::string::npos ? "" : channel.substr(0, dot);
  const std::string last = dot == std::string::npos ? channel : channel.substr(dot + 1);
  static const std::string known = "RGBAXYZ";
  const size_t rank = last.size() == 1 ? known.find(last[0]) : std::string::npos;
  return std::tuple(layer, rank == std::string::npos ? known.size() : rank, last);
}

/// Luminance/chroma files have subsampled channels, which only the RGBA reader reassembles.
Result<Image> readSubsampled(const uint8_t* bytes, size_t size, int width, int height) {
  MemoryReader stream(bytes, size);
  Imf::RgbaInputFile file(stream, 1);
  const Imath::Box2i window = file.dataWindow();
  std::vector<Imf::Rgba> pixels(size_t(width) * height);
  file.setFrameBuffer(pixels.data() - window.min.x - ptrdiff_t(window.min.y) * width, 1, size_t(width));
  file.readPixels(window.min.y, window.max.y);
  Image image(width, height, 4);
  image.names = {"R", "G", "B", "A"};
  for (size_t i = 0; i < pixels.size(); ++i) {
    const float rgba[] = {pixels[i].r, pixels[i].g, pixels[i].b, pixels[i].a};
    std::copy(rgba, rgba + 4, image.data.data() + i * 4);
  }
  return image;
}

}  // namespace

Result<Image> readExr(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  MemoryReader stream(bytes, size);
  Imf::MultiPartInputFile file(stream, 1, false);
  if (file.parts() < 1) return invalidArgument("EXR file has no parts", name);
  const Imf::Header& header = file.header(0);
  if (header.hasType() && Imf::isDeepData(header.type())) return invalidArgument("deep EXR images are not read", name);
  const Imath::Box2i window = header.dataWindow();
  const int64_t width = int64_t(window.max.x) - window.min.x + 1, height = int64_t(window.max.y) - window.min.y + 1;
  std::vector<std::string> names;
  bool subsampled = false;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    names.push_back(c.name());
    subsampled |= c.channel().xSampling != 1 || c.channel().ySampling != 1;
  }
  GOBO_TRY(checkImageSize(width, height, int64_t(names.size()), size, limits).at(name));
  // OpenEXR forms addresses of the window's origin in a float frame buffer: keep them far from overflow.
  constexpr int far = 1 << 24;
  if (std::abs(int64_t(window.min.x)) > far || std::abs(int64_t(window.min.y)) > far)
    return invalidArgument("EXR data window is too far from the origin", name);
  if (subsampled) return readSubsampled(bytes, size, int(width), int(height));
  std::sort(names.begin(), names.end(), [](const auto& a, const auto& b) { return channelOrder(a) < channelOrder(b); });

  Image image(int(width), int(height), int(names.size()));
  image.names = names;
  const size_t pixel = names.size() * sizeof(float), row = pixel * size_t(width);
  Imf::FrameBuffer buffer;
  for (size_t c = 0; c < names.size(); ++c) {
    char* origin = reinterpret_cast<char*>(image.data.data() + c) - ptrdiff_t(window.min.x) * ptrdiff_t(pixel) - ptrdiff_t(window.min.y) * ptrdiff_t(row);
    buffer.insert(names[c], Imf::Slice(Imf::FLOAT, origin, pixel, row));
  }
  Imf::InputPart part(file, 0);
  part.setFrameBuffer(buffer);
  part.readPixels(window.min.y, window.max.y);
  return image;
}

Result<std::vector<uint8_t>> encodeExr(const Image& image, const ExrOptions& options) {
  if (image.width <= 0 || image.height <= 0 || image.channels <= 0 || image.data.size() != image.pixels() * image.channels)
    return invalidArgument("image is empty or its data has the wrong size");
  std::vector<std::string> names = image.names;
  if (names.empty()) {
    if (image.channels > 4) return invalidArgument("an image of more than 4 channels needs channel names");
    names = image.channels == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B", "A"};
    names.resize(size_t(image.channels));
  }
  if (int(names.size()) != image.channels || std::set<std::string>(names.begin(), names.end()).size() != names.size())
    return invalidArgument("channel names are not one per channel and unique");
  for (const std::string& n : names)
    if (n.empty() || n.size() > 255) return invalidArgument("channel name \"" + n.substr(0, 40) + "\" is empty or too long");
  try {
    Imf::Header header(image.width, image.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    for (const auto& [key, value] : options.metadata) header.insert(key, Imf::StringAttribute(value));
    const Imf::PixelType type = options.half ? Imf::HALF : Imf::FLOAT;
    std::vector<half> halves;
    if (options.half) {
      halves.resize(image.data.size());
      // A value beyond half's range would become Inf in the file: it is clamped to the largest half instead.
      for (size_t i = 0; i < image.data.size(); ++i)
        halves[i] = half(std::isfinite(image.data[i]) ? std::clamp(image.data[i], -65504.0f, 65504.0f) : image.data[i]);
    }
    const size_t unit = options.half ? 2 : 4, pixel = unit * size_t(image.channels);
    char* base = options.half ? reinterpret_cast<char*>(halves.data()) : reinterpret_cast<char*>(const_cast<float*>(image.data.data()));
    Imf::FrameBuffer buffer;
    for (int c = 0; c < image.channels; ++c) {
      header.channels().insert(names[c], Imf::Channel(type));
      buffer.insert(names[c], Imf::Slice(type, base + unit * size_t(c), pixel, pixel * size_t(image.width)));
    }
    std::vector<uint8_t> out;
    {
      MemoryWriter stream(out);
      Imf::OutputFile file(stream, header, 1);
      file.setFrameBuffer(buffer);
      file.writePixels(image.height);
    }
    return out;
  } catch (const std::exception& e) {
    return internalError(std::string("cannot encode EXR: ") + e.what());
  }
}

}  // namespace gobo
