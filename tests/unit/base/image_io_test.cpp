// SPDX-License-Identifier: Apache-2.0
// Round trips by value, size limits, atomic writes, and damaged files that must end in an error or a finite-sized picture.
#include "base/image_io.h"

#include "base/decode_limit.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "base/sobol.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;

Image noiseImage(int w, int h, int c, float scale) {
  Image image(w, h, c);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = scale * (toUnit(hash32(5, i)) - 0.25f);
  return image;
}

TEST(ImageIo, ExrFloatIsExact) {
  Image image = noiseImage(37, 23, 5, 1000.0f);
  image.names = {"R", "G", "B", "A", "depth.Z"};
  image.data[0] = std::numeric_limits<float>::infinity();
  ExrOptions options;
  options.metadata["gobo:request"] = "{\"k\":1}";
  const auto bytes = encodeExr(image, options);
  ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
  const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.exr");
  ASSERT_TRUE(back.ok()) << back.status().toString();
  EXPECT_EQ(back->names, image.names);
  EXPECT_EQ(back->data, image.data);
  EXPECT_EQ(back->width, 37);
  EXPECT_NE(std::search(bytes->begin(), bytes->end(), options.metadata["gobo:request"].begin(), options.metadata["gobo:request"].end()), bytes->end());
}

TEST(ImageIo, ExrChannelsComeBackInPictureOrder) {
  Image image = noiseImage(3, 2, 3, 1.0f);
  image.names = {"N.X", "N.Y", "N.Z"};
  auto bytes = encodeExr(image);
  EXPECT_EQ(readImageFromMemory(bytes->data(), bytes->size(), "a.exr")->data, image.data);
  image.names = {"B", "G", "R"};
  bytes = encodeExr(image);
  const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.exr");
  EXPECT_EQ(back->names, (std::vector<std::string>{"R", "G", "B"}));
  EXPECT_EQ(back->data[0], image.data[2]);
}

TEST(ImageIo, ExrHalfRoundsAndClamps) {
  Image image = noiseImage(16, 16, 3, 10.0f);
  image.data[0] = 1e6f;
  image.data[1] = -1e30f;
  ExrOptions options;
  options.half = true;
  const auto bytes = encodeExr(image, options);
  const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.exr");
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(back->data[0], 65504.0f);
  EXPECT_EQ(back->data[1], -65504.0f);
  for (size_t i = 2; i < image.data.size(); ++i) EXPECT_NEAR(back->data[i], image.data[i], std::fabs(image.data[i]) * 0x1p-11f + 0x1p-25f);
}

TEST(ImageIo, PngStoresSrgbOfLinear) {
  Image image(256, 1, 4);
  for (int x = 0; x < 256; ++x) {
    const double e = x / 255.0, linear = e <= 0.04045 ? e / 12.92 : std::pow((e + 0.055) / 1.055, 2.4);
    for (int c = 0; c < 3; ++c) image.at(x, 0)[c] = float(linear);
    image.at(x, 0)[3] = x / 255.0f;  // alpha is linear and does not multiply colour
  }
  const auto bytes = encodePng(image);
  ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
  const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.png");
  ASSERT_TRUE(back.ok()) << back.status().toString();
  ASSERT_EQ(back->channels, 4);
  for (int x = 0; x < 256; ++x)
    for (int c = 0; c < 4; ++c) EXPECT_EQ(std::lround(back->at(x, 0)[c] * 255.0f), x) << c;
  Image wild(2, 1, 3);
  wild.data = {-5.0f, 7.0f, std::numeric_limits<float>::quiet_NaN(), 0.0f, 1.0f, 0.5f};
  const auto clamped = encodePng(wild);
  const auto read = readImageFromMemory(clamped->data(), clamped->size(), "b.png");
  EXPECT_EQ(read->data[0], 0.0f);
  EXPECT_EQ(read->data[1], 1.0f);
  EXPECT_EQ(read->data[2], 0.0f);
}

TEST(ImageIo, JpegIsClose) {
  Image image(32, 32, 3);
  std::fill(image.data.begin(), image.data.end(), 0.2140411f);  // sRGB 0.5
  const auto bytes = encodeJpeg(image, {.quality = 95});
  ASSERT_TRUE(bytes.ok()) << bytes.status().toString();
  const auto back = readImageFromMemory(bytes->data(), bytes->size(), "a.jpg");
  ASSERT_TRUE(back.ok()) << back.status().toString();
  for (const float v : back->data) EXPECT_NEAR(v, 0.5f, 2.0f / 255);
}

TEST(ImageIo, ContentChoosesTheFormatNotTheName) {
  const auto bytes = encodePng(noiseImage(4, 4, 3, 1.0f));
  EXPECT_TRUE(readImageFromMemory(bytes->data(), bytes->size(), "liar.exr").ok());
  const uint8_t junk[] = {1, 2, 3, 4, 5, 6, 7, 8};
  const auto bad = readImageFromMemory(junk, sizeof junk, "thing");
  EXPECT_EQ(bad.status().location(), "thing");
  EXPECT_FALSE(readImageFromMemory(junk, 0, "empty.png").ok());
}

TEST(ImageIo, LimitsRefuseBeforeDecoding) {
  const auto bytes = encodeExr(noiseImage(64, 32, 3, 1.0f));
  ReadLimits limits;
  limits.maxDimension = 63;
  EXPECT_EQ(readImageFromMemory(bytes->data(), bytes->size(), "a.exr", limits).status().code(), Code::ResourceExhausted);
  limits = {};
  limits.maxPixels = 64 * 32 - 1;
  EXPECT_EQ(readImageFromMemory(bytes->data(), bytes->size(), "a.exr", limits).status().code(), Code::ResourceExhausted);
  limits.maxPixels = 64 * 32;
  EXPECT_TRUE(readImageFromMemory(bytes->data(), bytes->size(), "a.exr", limits).ok());
}

// A flat picture of many pixels in a small file: refused by what it would decode to, before that is allocated.
TEST(ImageIo, DecodedBytesAreBounded) {
  Image flat(8192, 2900, 3);  // 285 MB of floats
  const auto png = encodePng(flat);
  ASSERT_TRUE(png.ok());
  ASSERT_LT(png->size(), 1u << 20);
  const uint64_t before = mostDecodedBytes();
  setMostDecodedBytes(280 << 20);
  EXPECT_TRUE(readImageFromMemory(png->data(), png->size(), "a.png").ok());
  setMostDecodedBytes(1 << 20);  // 256 MiB are read all the same
  const Status refused = readImageFromMemory(png->data(), png->size(), "a.png").status();
  const auto small = encodePng(Image(8192, 2700, 3));  // 265 MB
  const bool read = readImageFromMemory(small->data(), small->size(), "b.png").ok();
  setMostDecodedBytes(before);
  EXPECT_TRUE(read);
  EXPECT_EQ(refused.code(), Code::ResourceExhausted);
  EXPECT_NE(refused.message().find("8192 x 2900 x 3 is 285081600 bytes"), std::string::npos) << refused.toString();
  EXPECT_NE(refused.message().find("ingest.texture_bytes"), std::string::npos) << refused.toString();
  EXPECT_EQ(refused.location(), "a.png");
}

TEST(ImageIo, EncodersRefuseMalformedImages) {
  Image image(2, 2, 3);
  image.data.pop_back();
  EXPECT_FALSE(encodeExr(image).ok());
  EXPECT_FALSE(encodePng(image).ok());
  Image twice(1, 1, 2);
  twice.names = {"R", "R"};
  EXPECT_FALSE(encodeExr(twice).ok());
}

TEST(ImageIo, WritesAreAtomic) {
  const fs::path folder = fs::temp_directory_path() / ("gobo-io-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string path = (folder / "out.bin").string();
  ASSERT_TRUE(writeFileAtomic(path, "first", 5).ok());
  ASSERT_TRUE(writeFileAtomic(path, "second", 6).ok());
  EXPECT_EQ(readFile(path)->size(), 6u);
  EXPECT_EQ(readFile(path, 5).status().code(), Code::ResourceExhausted);
  // A target that cannot be replaced (a folder): error, and no temporary stays behind.
  fs::create_directories(folder / "dir" / "full");
  const Status failed = writeFileAtomic((folder / "dir").string(), "x", 1);
  EXPECT_FALSE(failed.ok());
  EXPECT_EQ(failed.location(), (folder / "dir").string());
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 2);
  EXPECT_EQ(readFile((folder / "none").string()).status().code(), Code::NotFound);
  EXPECT_EQ(writeFileAtomic((folder / "no" / "where").string(), "x", 1).code(), Code::NotFound);
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_FALSE(readFile((folder / "pipe").string()).ok());  // would hang for ever if opened for blocking reads
  fs::remove_all(folder);
}

TEST(ImageIo, DamagedFilesEndInAnErrorOrAPicture) {
  const fs::path data = "../shared/data";
  if (!fs::exists(data)) GTEST_SKIP() << "../shared/data is absent";
  std::vector<std::string> files;
  for (const char* folder : {"exr/damaged", "images/oiio-corrupt"})
    for (const auto& entry : fs::recursive_directory_iterator(data / folder))
      if (entry.is_regular_file() && entry.path().extension() != ".txt") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  ASSERT_GT(files.size(), 50u);
  ReadLimits limits;
  limits.maxPixels = 1u << 22;  // keeps the test's memory bounded
  size_t read = 0, refused = 0;
  for (const std::string& file : files) {
    const auto image = readImage(file, limits);
    if (image.ok()) {
      ++read;
      EXPECT_EQ(image->data.size(), image->pixels() * size_t(image->channels)) << file;
    } else {
      ++refused;
      EXPECT_EQ(image.status().location(), file) << image.status().toString();
    }
  }
  EXPECT_GT(refused, 20u);
  std::cout << "damaged images: " << files.size() << " files, " << read << " read, " << refused << " refused\n";
}

}  // namespace
}  // namespace gobo
