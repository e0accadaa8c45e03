// SPDX-License-Identifier: Apache-2.0
#include "base/animated_png.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>

#include "base/image_io.h"

namespace gobo {
namespace {

std::string bytesOf(int width, int height, float shade, int channels = 3) {
  Image image(width, height, channels);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = 0.5f * shade + 0.4f * float(i % 7) / 7.0f;
  const auto png = encodePng(image, {.data = true});
  return std::string(png->begin(), png->end());
}
uint32_t number(const std::string& s, size_t at) {
  uint32_t v = 0;
  for (size_t k = 0; k < 4; ++k) v = v << 8 | uint8_t(s[at + k]);
  return v;
}
struct Chunk {
  std::string type, data;
};
std::vector<Chunk> chunksOf(const std::string& png) {
  std::vector<Chunk> out;
  for (size_t at = 8; at + 12 <= png.size();) {
    const uint32_t size = number(png, at);
    out.push_back({png.substr(at + 4, 4), png.substr(at + 8, size)});
    EXPECT_EQ(number(png, at + 8 + size), uint32_t(crc32(0, reinterpret_cast<const Bytef*>(png.data() + at + 4), size + 4))) << out.back().type;
    at += 12 + size_t(size);
  }
  return out;
}

TEST(AnimatedPng, HoldsItsPicturesAsTheyWere) {
  const std::vector<std::string> frames{bytesOf(33, 17, 0.1f), bytesOf(33, 17, 0.5f), bytesOf(33, 17, 0.9f)};
  const auto made = animatedPng(frames, 40);
  ASSERT_TRUE(made.ok()) << made.status().toString();
  const std::string file(made->begin(), made->end());
  const auto pixels = [](const std::string& png) { return readImageFromMemory(reinterpret_cast<const uint8_t*>(png.data()), png.size(), "x.png")->data; };
  EXPECT_EQ(pixels(file), pixels(frames[0]));  // to who knows no animations
  uint32_t sequence = 0, controls = 0;
  std::vector<std::string> found{""};
  std::vector<std::string> order;
  for (const Chunk& c : chunksOf(file)) {
    order.push_back(c.type);
    if (c.type == "acTL") {
      EXPECT_EQ(number(c.data, 0), 3u);
      EXPECT_EQ(number(c.data, 4), 0u);
    } else if (c.type == "fcTL") {
      EXPECT_EQ(number(c.data, 0), sequence++);
      EXPECT_EQ(number(c.data, 4), 33u);
      EXPECT_EQ(number(c.data, 8), 17u);
      EXPECT_EQ(number(c.data, 20), 40u << 16 | 1000u);
      ++controls;
    } else if (c.type == "fdAT") {
      EXPECT_EQ(number(c.data, 0), sequence++);
      found.push_back(c.data.substr(4));
    } else if (c.type == "IDAT") {
      found[0] += c.data;
    }
  }
  EXPECT_EQ(controls, 3u);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(order[0], "IHDR");
  EXPECT_EQ(order[1], "acTL");
  EXPECT_EQ(order.back(), "IEND");
  for (size_t i = 0; i < 3; ++i) {
    std::string own;
    for (const Chunk& c : chunksOf(frames[i]))
      if (c.type == "IDAT") own += c.data;
    EXPECT_EQ(found[i], own) << i;
  }
}

TEST(AnimatedPng, RefusesWhatDoesNotFit) {
  EXPECT_EQ(animatedPng({}, 40).status().code(), Code::InvalidArgument);
  const std::string good = bytesOf(8, 8, 0.5f);
  for (const std::string& bad : {bytesOf(8, 9, 0.5f), bytesOf(8, 8, 0.5f, 4), good.substr(0, good.size() / 2), std::string("JFIF"), std::string()}) {
    const std::vector<std::string> frames{good, bad};
    const auto made = animatedPng(frames, 40);
    ASSERT_FALSE(made.ok());
    EXPECT_NE(made.status().toString().find("picture 1"), std::string::npos) << made.status().toString();
  }
}

}  // namespace
}  // namespace gobo
