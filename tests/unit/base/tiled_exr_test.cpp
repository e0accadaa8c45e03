// SPDX-License-Identifier: Apache-2.0
// A picture whose tiles came in any order is the picture; what is no tile of it is refused; nothing half-written is left.
#include <gtest/gtest.h>

#include <ImfHeader.h>
#include <ImfStandardAttributes.h>
#include <ImfTiledInputFile.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "base/image_io.h"
#include "base/sobol.h"
#include "base/tiled_exr.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
constexpr int kWide = 75, kTall = 41, kSide = 32;

struct TiledExrTest : ::testing::Test {
  TiledExrTest() : folder("/tmp/gobo-tiled-" + std::to_string(getpid())) {
    fs::create_directories(folder);
    for (size_t i = 0; i < colour.size(); ++i) colour[i] = 8.0f * toUnit(hash32(1, i)) - 2.0f;
    for (size_t i = 0; i < ids.size(); ++i) ids[i] = float(hash32(2, i) % 100003);
  }
  ~TiledExrTest() override { fs::remove_all(folder); }

  /// The part of the picture as the server encodes it.
  std::vector<uint8_t> part(int x, int y, int w, int h, ExrPlace place = {0, 0, kWide, kTall}) const {
    const auto cut = [&](const std::vector<float>& from, int channels) {
      std::vector<float> to;
      for (int r = y; r < y + h; ++r) to.insert(to.end(), from.begin() + (r * kWide + x) * channels, from.begin() + (r * kWide + x + w) * channels);
      return to;
    };
    const std::vector<float> c = cut(colour, 3), i = cut(ids, 1);
    const std::vector<ExrLayer> layers = {{"", {"R", "G", "B"}, c, false, false}, {"object_id", {"id"}, i, true, true}};
    ExrOptions o;
    o.half = true;
    o.compression = ExrCompression::None;
    o.metadata = {{"gobo:request", "of a tile"}, {"gobo:plan", "of a tile"}, {"gobo:build", "a"}};
    o.place = {place.x + x, place.y + y, place.width, place.height};
    const auto bytes = encodeExr(w, h, layers, o);
    EXPECT_TRUE(bytes.ok()) << bytes.status().toString();
    return bytes.ok() ? *bytes : std::vector<uint8_t>{};
  }
  std::vector<std::array<int, 4>> tiles() const {
    std::vector<std::array<int, 4>> all;
    for (int y = 0; y < kTall; y += kSide)
      for (int x = 0; x < kWide; x += kSide) all.push_back({x, y, std::min(kSide, kWide - x), std::min(kSide, kTall - y)});
    return all;
  }
  std::vector<std::string> left() const {
    std::vector<std::string> names;
    for (const auto& f : fs::directory_iterator(folder)) names.push_back(f.path().filename());
    return names;
  }
  std::string folder;
  std::vector<float> colour = std::vector<float>(size_t(kWide) * kTall * 3), ids = std::vector<float>(size_t(kWide) * kTall);
};

TEST_F(TiledExrTest, TilesInAnyOrderAreThePicture) {
  const std::string path = folder + "/a.exr";
  const auto whole = part(0, 0, kWide, kTall, {});
  for (const auto c : {ExrCompression::None, ExrCompression::Zip, ExrCompression::Piz})
    for (const uint32_t seed : {3u, 4u}) {
      TiledExr file(path, kSide, c, {{"gobo:request", "of the whole"}, {"gobo:plan", ""}});
      auto order = tiles();
      for (size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[hash32(seed, i) % i]);
      for (const auto& [x, y, w, h] : order) ASSERT_TRUE(file.add(part(x, y, w, h)).ok());
      EXPECT_EQ(fs::exists(path), c != ExrCompression::None || seed == 4) << "before its end nothing is in place";
      const Status ended = file.finish();
      ASSERT_TRUE(ended.ok()) << ended.toString();
      const auto bytes = readFile(path, 1 << 20);
      ASSERT_TRUE(bytes.ok());
      EXPECT_EQ(file.bytes(), bytes->size());
      for (const char* layer : {"", "object_id"}) {
        const auto a = readExrLayer(whole.data(), whole.size(), "whole", layer), b = readExrLayer(bytes->data(), bytes->size(), path, layer);
        ASSERT_TRUE(a.ok() && b.ok()) << b.status().toString();
        EXPECT_EQ(a->data, b->data) << layer;
      }
      Imf::TiledInputFile in(path.c_str());
      EXPECT_EQ(in.header().tileDescription().xSize, unsigned(kSide));
      EXPECT_EQ(in.header().typedAttribute<Imf::StringAttribute>("gobo:request").value(), "of the whole");
      EXPECT_EQ(in.header().typedAttribute<Imf::StringAttribute>("gobo:build").value(), "a");
      EXPECT_EQ(in.header().find("gobo:plan"), in.header().end());
    }
  EXPECT_EQ(left(), (std::vector<std::string>{"a.exr"}));
}

TEST_F(TiledExrTest, APartLiesWhereItWasInThePicture) {
  const auto bytes = part(33, 5, 20, 11);
  const auto image = readExrLayer(bytes.data(), bytes.size(), "part", "object_id");
  ASSERT_TRUE(image.ok()) << image.status().toString();
  EXPECT_EQ(image->width, 20);
  for (int y = 0; y < 11; ++y)
    for (int x = 0; x < 20; ++x) ASSERT_EQ(image->at(x, y)[0], ids[size_t((y + 5) * kWide + x + 33)]);
  std::vector<float> v(3, 1.0f);
  const ExrLayer one{"", {"R", "G", "B"}, v, false, false};
  ExrOptions o;
  for (const ExrPlace& beyond : {ExrPlace{75, 0, 75, 41}, ExrPlace{0, 41, 75, 41}, ExrPlace{-1, 0, 75, 41}}) {
    o.place = beyond;
    EXPECT_EQ(encodeExr(1, 1, std::span(&one, 1), o).status().code(), Code::InvalidArgument);
  }
}

TEST_F(TiledExrTest, WhatIsNoTileIsRefusedAndNothingIsLeft) {
  const std::string path = folder + "/a.exr";
  {
    TiledExr file(path, kSide, ExrCompression::Zip, {});
    ASSERT_TRUE(file.add(part(0, 0, kSide, kSide)).ok());
    const auto refused = [&](const std::vector<uint8_t>& exr, const std::string& text) {
      const Status s = file.add(exr);
      EXPECT_FALSE(s.ok());
      EXPECT_NE(s.toString().find(text), std::string::npos) << s.toString();
    };
    refused(part(0, 0, kSide, kSide), "a tile came twice");
    refused(part(1, 0, kSide, kSide), "pixels from 1,0 are no tile");
    refused(part(32, 0, 31, kSide), "pixels from 32,0 are no tile");
    refused(part(32, 0, kSide, kSide, {0, 0, kWide + 1, kTall}), "a tile of another picture");
    refused({1, 2, 3}, "cannot write a tile");
    const Status early = file.finish();
    EXPECT_EQ(early.code(), Code::FailedPrecondition);
    EXPECT_NE(early.message().find("5 tiles are missing"), std::string::npos) << early.message();
  }
  EXPECT_EQ(left(), std::vector<std::string>{});
  TiledExr nowhere(folder + "/none/a.exr", kSide, ExrCompression::Zip, {});
  EXPECT_FALSE(nowhere.add(part(0, 0, kSide, kSide)).ok());
  EXPECT_FALSE(nowhere.finish().ok());
}

}  // namespace
}  // namespace gobo
