// SPDX-License-Identifier: Apache-2.0
#include "server/encode.h"

#include <gtest/gtest.h>

#include "base/hash.h"

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "base/image_io.h"

namespace gobo::encode_test {
namespace {

Image ramp(int w, int h, int c) {
  Image image(w, h, c);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i) * 0.37f - 3.0f;
  return image;
}

RenderedImage rendered(const std::string& output, const Image& image) {
  auto term = std::make_shared<Term>("pixels", Domain::Pixel, Extent{image.width, image.height, 1});
  const auto plane = term->addPlane<float>("v", image.channels);
  std::copy(image.data.begin(), image.data.end(), plane.begin());
  return RenderedImage(output, term, "v", image.names);
}

RenderResult resultOf(const std::string& output, Image image, v1::Encoding::Format format) {
  RenderResult result;
  result.reply.mutable_resolved()->mutable_encoding()->set_format(format);
  result.images.push_back(rendered(output, image));
  return result;
}

TEST(Encode, SaysHowManyValuesHalvesDoNotHold) {
  Image image(4, 2, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = 65504.0f;  // the largest half is no loss
  const float inf = std::numeric_limits<float>::infinity();
  image.data[3] = 65505.0f;
  image.data[7] = -1e30f;
  image.data[9] = 3e38f;
  image.data[11] = inf;  // infinitely far is no number to lose
  const auto warnings = [&](const std::string& output, const std::function<void(v1::Encoding&)>& edit) {
    RenderResult result = resultOf(output, image, v1::Encoding::RAW_HALF);
    edit(*result.reply.mutable_resolved()->mutable_encoding());
    EXPECT_TRUE(encodeImages(result).ok());
    return std::vector<std::string>(result.reply.warnings().begin(), result.reply.warnings().end());
  };
  const auto raw = warnings("beauty", [](v1::Encoding&) {});
  ASSERT_EQ(raw.size(), 1u);
  EXPECT_NE(raw[0].find("beauty: 3 of 24 values"), std::string::npos) << raw[0];
  EXPECT_TRUE(warnings("beauty", [](v1::Encoding& e) { e.set_format(v1::Encoding::RAW_FLOAT); }).empty());
  EXPECT_TRUE(warnings("beauty", [](v1::Encoding& e) { e.set_format(v1::Encoding::EXR); }).empty());
  EXPECT_EQ(warnings("beauty",
                     [](v1::Encoding& e) {
                       e.set_format(v1::Encoding::EXR);
                       e.set_half(true);
                     })
                .size(),
            1u);
  EXPECT_EQ(warnings("beauty",
                     [](v1::Encoding& e) {
                       e.set_format(v1::Encoding::EXR);
                       e.set_half(true);
                       e.set_layers(true);
                     })
                .size(),
            1u);
  EXPECT_EQ(warnings("beauty",
                     [](v1::Encoding& e) {
                       e.set_format(v1::Encoding::EXR);
                       e.set_compression(v1::Encoding::DWAA);
                     })
                .size(),
            1u);
  EXPECT_TRUE(warnings("position",
                       [](v1::Encoding& e) {
                         e.set_format(v1::Encoding::EXR);
                         e.set_half(true);
                       })
                  .empty())
      << "written as 32 bits";
}

TEST(Sha256, KnownDigests) {  // FIPS 180-4 examples
  EXPECT_EQ(sha256Hex("abc", 3), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256Hex("", 0), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  Sha256 pieces;
  pieces.add("a", 1);
  pieces.add("bc", 2);
  EXPECT_EQ(pieces.hex(), sha256Hex("abc", 3));
}

TEST(Encode, RawFloatIsTheMemoryAsItIs) {
  Image image = ramp(5, 3, 4);
  image.data[7] = 1e30f;
  RenderResult result = resultOf("beauty", image, v1::Encoding::RAW_FLOAT);
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok());
  ASSERT_EQ((*images)[0].bytes.size(), image.data.size() * 4);
  EXPECT_EQ(std::memcmp((*images)[0].bytes.data(), image.data.data(), image.data.size() * 4), 0);
  const v1::ImageDescriptor& d = result.reply.images(0);
  EXPECT_EQ(d.width(), 5u);
  EXPECT_EQ(d.height(), 3u);
  EXPECT_EQ(d.channels_size(), 4);
  EXPECT_EQ(d.bytes(), image.data.size() * 4);
  EXPECT_EQ(d.digest(), hashBytes((*images)[0].bytes.data(), (*images)[0].bytes.size()).hex());
}

TEST(Encode, HalvesAreRoundedToNearestAndNeverInfinite) {
  Image image(4, 1, 1);
  image.data = {1.0f, 65520.0f, -1e9f, 0.333333f};  // 65520 would round to infinity
  const PictureBytes bytes = rawBytes(image.data, true);
  uint16_t h[4];
  ASSERT_EQ(bytes.size(), sizeof h);
  std::memcpy(h, bytes.data(), sizeof h);
  EXPECT_EQ(h[0], 0x3c00);
  EXPECT_EQ(h[1], 0x7bff);
  EXPECT_EQ(h[2], 0xfbff);
  EXPECT_EQ(h[3], 0x3555);
}

TEST(Encode, ExrKeepsFloatsAndSaysWhatMadeIt) {
  const Image image = ramp(8, 6, 3);
  RenderResult result = resultOf("beauty", image, v1::Encoding::EXR);
  result.reply.mutable_resolved()->set_scene("kitchen");
  result.reply.set_request_hash("abcdef0123");
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok()) << images.status().toString();
  const PictureBytes& bytes = (*images)[0].bytes;
  auto back = readImageFromMemory(bytes.data(), bytes.size(), "x.exr");
  ASSERT_TRUE(back.ok()) << back.status().toString();
  EXPECT_EQ(back->data, image.data);
  const std::string text(bytes.begin(), bytes.end());
  EXPECT_NE(text.find("gobo:request_hash"), std::string::npos);
  EXPECT_NE(text.find("abcdef0123"), std::string::npos);
  EXPECT_NE(text.find("kitchen"), std::string::npos);
}

TEST(Encode, SeveralOutputsAreSeveralImages) {
  RenderResult result = resultOf("beauty", ramp(4, 4, 3), v1::Encoding::RAW_HALF);
  result.images.push_back(rendered("depth", ramp(4, 4, 1)));
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok());
  ASSERT_EQ(result.reply.images_size(), 2);
  EXPECT_EQ(result.reply.images(1).output(), "depth");
  EXPECT_EQ(result.reply.images(1).bytes(), 32u);
}

// PNG applies the sRGB curve: data outputs must come back as the numbers they were.
TEST(Encode, AJpegSaysTheChannelsThatItHas) {
  for (const auto& [format, channels] : {std::pair(v1::Encoding::JPEG, 3), std::pair(v1::Encoding::PNG, 4)}) {
    RenderResult result = resultOf("beauty", ramp(16, 8, 4), format);
    const auto files = encodeImages(result);
    ASSERT_TRUE(files.ok()) << files.status().toString();
    EXPECT_EQ(files->at(0).descriptor.channels_size(), channels);
    const auto read = readImageFromMemory(files->at(0).bytes.data(), files->at(0).bytes.size(), "picture");
    ASSERT_TRUE(read.ok()) << read.status().toString();
    EXPECT_EQ(read->channels, channels);
  }
}

TEST(Encode, NormalsAndAlphaReachThePngUncurved) {
  Image normal(3, 1, 3);
  normal.data = {0, 0, 1, -1, 0, 0, 0.5f, -0.5f, 0.70710678f};
  RenderResult result = resultOf("normal", normal, v1::Encoding::PNG);
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok()) << images.status().toString();
  auto back = readImageFromMemory((*images)[0].bytes.data(), (*images)[0].bytes.size(), "x.png");
  ASSERT_TRUE(back.ok());
  for (size_t i = 0; i < normal.data.size(); ++i) EXPECT_NEAR(back->data[i], 0.5f + 0.5f * normal.data[i], 0.51f / 255) << i;
}

TEST(Encode, DepthIsShownOverItsOwnRangeWithNothingBlack) {
  Image depth(4, 1, 1);
  depth.data = {2, 4, 3, std::numeric_limits<float>::infinity()};
  RenderResult result = resultOf("depth", depth, v1::Encoding::PNG);
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok()) << images.status().toString();
  auto back = readImageFromMemory((*images)[0].bytes.data(), (*images)[0].bytes.size(), "x.png");
  ASSERT_TRUE(back.ok());
  const float want[] = {1, 0, 0.5f, 0};
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(back->at(i, 0)[0], want[i], 0.51f / 255) << i;
}

TEST(Encode, ConstantAndEmptyDepthAreFinite) {
  for (const float v : {3.0f, 0.0f, std::numeric_limits<float>::quiet_NaN()}) {
    Image depth(2, 2, 1);
    std::fill(depth.data.begin(), depth.data.end(), v);
    for (const float t : displayImage("depth", depth, {}).image.data) EXPECT_TRUE(t >= 0 && t <= 1) << v;
  }
}

/// Distances to nothing: the others keep their range.
TEST(Encode, ADistanceToNothingIsNoPartOfTheRange) {
  Image distance(4, 1, 1);
  distance.data = {-0.5f, 0.5f, 1e30f, -2e29f};
  const Image shown = displayImage("shadow_distance:key", distance, {}).image;
  EXPECT_EQ(shown.data, (std::vector<float>{0.0f, 1.0f, 0.0f, 0.0f}));
}

TEST(Encode, OnlyRadianceIsToneMapped) {
  for (const char* name : {"beauty", "direct", "indirect", "emission", "group:key", "unoccluded:key"}) EXPECT_TRUE(isRadiance(name)) << name;
  for (const char* name : {"albedo", "normal", "depth", "position", "alpha", "visibility:key"}) EXPECT_FALSE(isRadiance(name)) << name;
}

TEST(Encode, JpegDecodesToItsSize) {
  Image image(16, 8, 3);
  std::fill(image.data.begin(), image.data.end(), 0.18f);
  RenderResult result = resultOf("albedo", image, v1::Encoding::JPEG);
  auto images = encodeImages(result);
  ASSERT_TRUE(images.ok()) << images.status().toString();
  auto back = readImageFromMemory((*images)[0].bytes.data(), (*images)[0].bytes.size(), "x.jpg");
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back->width, 16);
  EXPECT_NEAR(back->at(3, 3)[0], 0.4613f, 0.02f);  // sRGB of 0.18
}

TEST(Encode, UnknownFormatNamesTheField) {
  RenderResult result = resultOf("beauty", ramp(2, 2, 3), v1::Encoding::Format(77));
  auto images = encodeImages(result);
  EXPECT_EQ(images.status().code(), Code::InvalidArgument);
  EXPECT_NE(images.status().message().find("77"), std::string::npos);
}

}  // namespace
}  // namespace gobo::encode_test
