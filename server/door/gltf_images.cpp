// SPDX-License-Identifier: Apache-2.0
#include "server/door/gltf_images.h"

#include <bit>
#include <limits>

#include "base/image_io.h"

namespace gobo {
inline namespace door {

void toSensorDepth(std::span<float> depth, double least, double most) {
  for (float& z : depth) {
    if (!(z > 0.0f) || double(z) > most) z = std::numeric_limits<float>::infinity();
    else if (double(z) < least) z = 0.0f;
  }
}

// TIFF 6.0: header, one directory, then the strip.
std::string depthTiff(int width, int height, std::span<const float> depth) {
  static_assert(std::endian::native == std::endian::little);
  constexpr uint16_t kShort = 3, kLong = 4, kTags = 11;
  constexpr uint32_t kDirectory = 8, kStrip = kDirectory + 2 + 12 * kTags + 4;
  std::string out;
  out.reserve(kStrip + depth.size_bytes());
  const auto number = [&](auto v) { out.append(reinterpret_cast<const char*>(&v), sizeof v); };
  const auto tag = [&](uint16_t name, uint16_t type, uint32_t value) {
    number(name);
    number(type);
    number(uint32_t(1));
    number(value);  // one short lies in the field's first half, which little-endian numbers do by themselves
  };
  out += "II";
  number(uint16_t(42));
  number(kDirectory);
  number(kTags);
  tag(256, kLong, uint32_t(width));
  tag(257, kLong, uint32_t(height));
  tag(258, kShort, 32);               // bits a sample
  tag(259, kShort, 1);                // not compressed
  tag(262, kShort, 1);                // more is brighter
  tag(273, kLong, kStrip);            // where the strip begins
  tag(277, kShort, 1);                // samples a pixel
  tag(278, kLong, uint32_t(height));  // rows of the strip
  tag(279, kLong, uint32_t(depth.size_bytes()));
  tag(284, kShort, 1);  // interleaved
  tag(339, kShort, 3);  // IEEE floats
  number(uint32_t(0));  // no directory more
  out.append(reinterpret_cast<const char*>(depth.data()), depth.size_bytes());
  return out;
}

Result<std::vector<uint8_t>> labelPng(int width, int height, std::span<const float> colours, std::span<const float> depth) {
  Image image(width, height, 3);
  for (size_t p = 0; p < depth.size(); ++p)
    for (size_t c = 0; c < 3; ++c) image.data[3 * p + c] = depth[p] > 0.0f ? colours[3 * p + c] : 1.0f;
  PixelOptions options;
  options.data = true;
  return encodePng(image, options);
}

}  // namespace door
}  // namespace gobo
