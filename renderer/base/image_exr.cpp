// SPDX-License-Identifier: Apache-2.0
#include "base/image_exr.h"
#include "base/exr_header.h"
#include "base/exr_streams.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfPartType.h>
#include <ImfRgbaFile.h>
#include <ImfStringAttribute.h>
#include <ImfTileDescription.h>

#include <algorithm>
#include <cstring>
#include <tuple>

namespace gobo {
inline namespace base {
namespace {

constexpr int kRowsBetweenPolls = 64;  // of a stop token

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

namespace {

struct Selected {
  std::string channel, shown;
};  // name in the file, and in the image

bool hasName(const Imf::Header& header, const std::string& name) { return header.hasName() && header.name() == name; }
std::string layerOf(const std::string& channel) {
  const size_t dot = channel.find_last_of('.');
  return dot == std::string::npos ? "" : channel.substr(0, dot);
}

/// The wanted channels of one part as a picture.
Result<Image> readPart(Imf::MultiPartInputFile& file, int part, const std::vector<Selected>& wanted, const uint8_t* bytes, size_t size, const std::string& name,
                       const ReadLimits& limits) {
  const Imf::Header& header = file.header(part);
  if (header.hasType() && Imf::isDeepData(header.type())) return invalidArgument("deep EXR images are not read", name);
  const Imath::Box2i window = header.dataWindow();
  const int64_t width = int64_t(window.max.x) - window.min.x + 1, height = int64_t(window.max.y) - window.min.y + 1;
  bool subsampled = false;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) subsampled |= c.channel().xSampling != 1 || c.channel().ySampling != 1;
  GOBO_TRY(checkImageSize(width, height, int64_t(wanted.size()), size, limits).at(name));
  // OpenEXR allocates a row of tiles across the picture and whole tiles, however few of their pixels lie in the window.
  if (header.hasTileDescription()) {
    const Imf::TileDescription& tile = header.tileDescription();
    for (const int64_t across : {width, int64_t(tile.xSize)})
      if (const Status s = checkImageSize(across, int64_t(tile.ySize), int64_t(wanted.size()), size, limits); !s.ok())
        return Status(s.code(), "EXR tiles of " + std::to_string(tile.xSize) + " x " + std::to_string(tile.ySize) + ": " + s.message(), name);
  }
  // It holds a chunk of all channels, read or not: lines as many as the compression takes together, or a row of tiles.
  uint64_t pixelBytes = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) pixelBytes += c.channel().type == Imf::HALF ? 2 : 4;
  const uint64_t lines = header.hasTileDescription() ? header.tileDescription().ySize : uint64_t(exrLinesPerChunk(header.compression()));
  const uint64_t across = header.hasTileDescription() ? std::max(uint64_t(width), uint64_t(header.tileDescription().xSize)) : uint64_t(width);
  if (pixelBytes * lines * across > mostExrBuffer(size))
    return invalidArgument("EXR of " + std::to_string(size) + " bytes has chunks of " + std::to_string(across) + " x " + std::to_string(lines) + " pixels, " +
                               std::to_string(pixelBytes) + " bytes each, which is more than it can hold",
                           name);
  // OpenEXR forms addresses of the window's origin in a float frame buffer: keep them far from overflow.
  constexpr int far = 1 << 24;
  if (std::abs(int64_t(window.min.x)) > far || std::abs(int64_t(window.min.y)) > far)
    return invalidArgument("EXR data window is too far from the origin", name);
  if (subsampled) return readSubsampled(bytes, size, int(width), int(height));
  Image image(int(width), int(height), int(wanted.size()));
  const size_t pixel = wanted.size() * sizeof(float), row = pixel * size_t(width);
  Imf::FrameBuffer buffer;
  for (size_t c = 0; c < wanted.size(); ++c) {
    image.names.push_back(wanted[c].shown);
    char* origin = reinterpret_cast<char*>(image.data.data() + c) - ptrdiff_t(window.min.x) * ptrdiff_t(pixel) - ptrdiff_t(window.min.y) * ptrdiff_t(row);
    buffer.insert(wanted[c].channel, Imf::Slice(Imf::FLOAT, origin, pixel, row));
  }
  Imf::InputPart input(file, part);
  input.setFrameBuffer(buffer);
  for (int y = window.min.y; y <= window.max.y; y += kRowsBetweenPolls) {
    if (limits.stop.stopRequested()) return Status(Code::Cancelled, "the reading was cancelled", name);
    input.readPixels(y, std::min(window.max.y, y + kRowsBetweenPolls - 1));
  }
  return image;
}

std::vector<Selected> channelsOf(const Imf::Header& header) {
  std::vector<Selected> out;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) out.push_back({c.name(), c.name()});
  std::sort(out.begin(), out.end(), [](const Selected& a, const Selected& b) { return channelOrder(a.channel) < channelOrder(b.channel); });
  return out;
}

/// Layers of every part, in order. A part whose channels have no layer gives its own name, but for the first part: "".
std::vector<std::string> layersOf(Imf::MultiPartInputFile& file) {
  std::vector<std::string> out;
  for (int p = 0; p < file.parts(); ++p)
    for (const Selected& c : channelsOf(file.header(p))) {
      std::string layer = layerOf(c.channel);
      if (layer.empty() && p > 0 && file.header(p).hasName()) layer = file.header(p).name();
      if (std::find(out.begin(), out.end(), layer) == out.end()) out.push_back(layer);
    }
  return out;
}

template <typename Body>
auto guarded(const std::string& name, const Body& body) -> decltype(body()) {
  try {
    return body();
  } catch (const std::exception& e) { return invalidArgument(std::string("damaged exr image: ") + e.what(), name); }
}

}  // namespace

Result<Image> readExr(const uint8_t* bytes, size_t size, const std::string& name, const ReadLimits& limits) {
  GOBO_TRY(checkExrHeaders(bytes, size, name));
  MemoryReader stream(bytes, size);
  Imf::MultiPartInputFile file(stream, 1, false);
  if (file.parts() < 1) return invalidArgument("EXR file has no parts", name);
  return readPart(file, 0, channelsOf(file.header(0)), bytes, size, name, limits);
}

Result<Image> readExrLayer(const uint8_t* bytes, size_t size, const std::string& name, const std::string& layer, const ReadLimits& limits) {
  return guarded(name, [&]() -> Result<Image> {
    GOBO_TRY(checkExrHeaders(bytes, size, name));
    MemoryReader stream(bytes, size);
    Imf::MultiPartInputFile file(stream, 1, false);
    const std::vector<std::string> layers = layersOf(file);
    std::string wanted = layer;
    if (std::find(layers.begin(), layers.end(), wanted) == layers.end()) wanted = exrLayerName(layer);
    for (int p = 0; p < file.parts(); ++p) {
      std::vector<Selected> chosen;
      for (const Selected& c : channelsOf(file.header(p))) {
        const std::string own = layerOf(c.channel);
        const bool byPart = own.empty() && p > 0 && hasName(file.header(p), wanted);
        if ((own == wanted && (p == 0 || !own.empty())) || byPart) chosen.push_back({c.channel, own.empty() ? c.channel : c.channel.substr(own.size() + 1)});
      }
      if (chosen.empty() && p == 0 && wanted.empty()) chosen = channelsOf(file.header(0));  // no nameless layer: everything
      if (!chosen.empty()) return readPart(file, p, chosen, bytes, size, name, limits);
    }
    std::string list;
    for (const std::string& l : layers)
      if (!l.empty()) list += (list.empty() ? "" : ", ") + l;
    return notFound("no layer '" + layer + "' in the file (has: " + (list.empty() ? "none" : list) + ")", name);
  });
}

Result<std::vector<std::string>> exrLayers(const uint8_t* bytes, size_t size, const std::string& name) {
  return guarded(name, [&]() -> Result<std::vector<std::string>> {
    GOBO_TRY(checkExrHeaders(bytes, size, name));
    MemoryReader stream(bytes, size);
    Imf::MultiPartInputFile file(stream, 1, false);
    return layersOf(file);
  });
}

Result<std::map<std::string, std::string>> exrMetadata(const uint8_t* bytes, size_t size, const std::string& name) {
  return guarded(name, [&]() -> Result<std::map<std::string, std::string>> {
    GOBO_TRY(checkExrHeaders(bytes, size, name));
    MemoryReader stream(bytes, size);
    Imf::MultiPartInputFile file(stream, 1, false);
    std::map<std::string, std::string> out;
    if (file.parts() < 1) return out;
    const Imf::Header& header = file.header(0);
    for (auto a = header.begin(); a != header.end(); ++a)
      if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&a.attribute())) out[a.name()] = text->value();
    return out;
  });
}

std::string exrLayerName(std::string_view output) {
  std::string name(output);
  for (char& c : name)
    if (!((c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '_')) c = '_';
  return name;
}

}  // namespace base
}  // namespace gobo
