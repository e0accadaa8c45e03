// SPDX-License-Identifier: Apache-2.0
// EXR encoding (image_io.h: encodeExr). Reading is in image_exr.cpp.
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMatrixAttribute.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <set>

#include "base/exr_streams.h"
#include "base/halves.h"
#include "base/image_io.h"

namespace gobo {
inline namespace base {
namespace {

float inHalfRange(float v) { return std::isfinite(v) ? std::clamp(v, -kLargestHalf, kLargestHalf) : v; }

/// One part's header, frame buffer, and the copies that hold converted pixels.
struct Part {
  Imf::Header header;
  Imf::FrameBuffer buffer;
  std::deque<std::vector<half>> halves;
  std::deque<std::vector<float>> floats;
  int left = 0, top = 0;

  Part(int width, int height, const ExrPlace& place, Imf::Compression compression) : header(width, height) {
    header.compression() = compression;
    left = place.x;
    top = place.y;
    if (place.width) header.displayWindow() = {{0, 0}, {place.width - 1, place.height - 1}};
    header.dataWindow() = {{left, top}, {left + width - 1, top + height - 1}};
  }

  void add(const ExrLayer& layer, int width, bool useHalf, bool lossy) {
    const size_t channels = layer.channels.size();
    const Imf::PixelType type = useHalf ? Imf::HALF : Imf::FLOAT;
    const char* base = reinterpret_cast<const char*>(layer.pixels.data());
    // A value beyond half's range would become Inf in the file, and DWA quantises in halves whatever the channel's type.
    if (useHalf) {
      auto& copy = halves.emplace_back(layer.pixels.size());
      toHalves(layer.pixels, reinterpret_cast<uint16_t*>(copy.data()), /*infinite=*/true);
      base = reinterpret_cast<const char*>(copy.data());
    } else if (lossy) {
      auto& copy = floats.emplace_back(layer.pixels.size());
      for (size_t i = 0; i < copy.size(); ++i) copy[i] = inHalfRange(layer.pixels[i]);
      base = reinterpret_cast<const char*>(copy.data());
    }
    const size_t unit = useHalf ? 2 : 4, pixel = unit * channels;
    for (size_t c = 0; c < channels; ++c) {
      const std::string name = layer.name.empty() ? layer.channels[c] : layer.name + "." + layer.channels[c];
      header.channels().insert(name, Imf::Channel(type));
      const char* const first = base + unit * c - ptrdiff_t(pixel) * (ptrdiff_t(left) + ptrdiff_t(top) * width);  // where the library looks for pixel 0, 0
      buffer.insert(name, Imf::Slice(type, const_cast<char*>(first), pixel, pixel * size_t(width)));
    }
  }
};

Status check(int width, int height, std::span<const ExrLayer> layers, const ExrPlace& place) {
  if (width <= 0 || height <= 0 || layers.empty()) return invalidArgument("image is empty or its data has the wrong size");
  if (place.x < 0 || place.y < 0 || (place.width && (place.x > place.width - width || place.y > place.height - height)))
    return invalidArgument("pixels lie beyond the picture that they are a part of");
  std::set<std::string> names;
  for (const ExrLayer& layer : layers) {
    if (layer.channels.empty() || layer.pixels.size() != size_t(width) * height * layer.channels.size())
      return invalidArgument("image is empty or its data has the wrong size");
    for (const std::string& c : layer.channels) {
      const std::string name = layer.name.empty() ? c : layer.name + "." + c;
      if (c.empty() || name.size() > 255) return invalidArgument("channel name \"" + name.substr(0, 40) + "\" is empty or too long");
      if (!names.insert(name).second) return invalidArgument("channel names are not one per channel and unique");
    }
  }
  return {};
}

void addAttributes(Imf::Header& header, const ExrOptions& options) {
  for (const auto& [key, value] : options.metadata) header.insert(key, Imf::StringAttribute(value));
  for (const auto& [key, m] : options.matrices) {
    Imath::M44f rows;  // row vectors: the transpose, which is our columns as they lie
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) rows[i][j] = m[i][j];
    header.insert(key, Imf::M44fAttribute(rows));
  }
}

}  // namespace

Result<std::vector<uint8_t>> encodeExr(int width, int height, std::span<const ExrLayer> layers, const ExrOptions& options) {
  GOBO_TRY(check(width, height, layers, options.place));
  try {
    const bool dwa = options.compression == ExrCompression::Dwaa || options.compression == ExrCompression::Dwab;
    const auto lossy = [dwa](const ExrLayer& l) { return dwa && !l.lossless; };
    const bool colour = std::any_of(layers.begin(), layers.end(), lossy), data = !std::all_of(layers.begin(), layers.end(), lossy);
    std::deque<Part> parts;
    for (const bool second : {false, true}) {
      if (dwa ? (second ? !data : !colour) : second) continue;
      Part& part = parts.emplace_back(width, height, options.place, exrCompression(dwa && second ? ExrCompression::Zip : options.compression));
      if (dwa && !second) part.header.dwaCompressionLevel() = options.dwaLevel;
      for (const ExrLayer& l : layers) {
        const bool here = !dwa || lossy(l) != second;
        if (here) part.add(l, width, options.half && !l.float32, lossy(l));
        if (here || parts.size() == 1)
          for (const auto& [key, value] : l.metadata) part.header.insert(key, Imf::StringAttribute(value));
      }
      part.header.setType(Imf::SCANLINEIMAGE);
      if (colour && data && dwa) part.header.setName(second ? "data" : "color");
    }
    addAttributes(parts[0].header, options);
    std::vector<uint8_t> out;
    MemoryWriter stream(out);
    if (parts.size() == 1) {
      Imf::OutputFile file(stream, parts[0].header, 1);
      file.setFrameBuffer(parts[0].buffer);
      file.writePixels(height);
    } else {
      const Imf::Header headers[2] = {parts[0].header, parts[1].header};
      Imf::MultiPartOutputFile file(stream, headers, 2, false, 1);
      for (int p = 0; p < 2; ++p) {
        Imf::OutputPart part(file, p);
        part.setFrameBuffer(parts[p].buffer);
        part.writePixels(height);
      }
    }
    return out;
  } catch (const std::exception& e) { return internalError(std::string("cannot encode EXR: ") + e.what()); }
}

Result<std::vector<uint8_t>> encodeExr(const Image& image, const ExrOptions& options) {
  ExrLayer layer;
  layer.channels = image.names;
  layer.pixels = image.data;
  if (layer.channels.empty()) {
    if (image.channels > 4) return invalidArgument("an image of more than 4 channels needs channel names");
    layer.channels = image.channels == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B", "A"};
    layer.channels.resize(size_t(std::max(image.channels, 0)));
  }
  if (int(layer.channels.size()) != image.channels) return invalidArgument("channel names are not one per channel and unique");
  layer.lossless = !layer.channels.empty() && layer.channels[0] != "R";
  return encodeExr(image.width, image.height, std::span(&layer, 1), options);
}

}  // namespace base
}  // namespace gobo
