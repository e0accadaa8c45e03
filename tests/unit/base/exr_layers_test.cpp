// SPDX-License-Identifier: Apache-2.0
// Multi-layer EXR: layers come back by name and bit for bit where they must, DWA touches colours only, bytes are reproducible.
#include <gtest/gtest.h>

#include <ImfArray.h>
#include <ImfHeader.h>
#include <ImfMatrixAttribute.h>
#include <ImfMultiPartInputFile.h>
#include <ImfStandardAttributes.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>

#include "base/image_io.h"
#include "base/sobol.h"

namespace gobo {
namespace {

constexpr int kW = 70, kH = 45;

std::vector<float> noise(int channels, uint32_t seed, float scale) {
  std::vector<float> v(size_t(kW) * kH * channels);
  for (size_t i = 0; i < v.size(); ++i) v[i] = scale * (toUnit(hash32(seed, i)) - 0.25f);
  return v;
}

struct Layers {
  std::vector<float> beauty = noise(3, 1, 8.0f), albedo = noise(3, 2, 1.0f), normal = noise(3, 3, 1.0f), depth = noise(1, 4, 1e5f), id = noise(1, 5, 1.0f);
  std::vector<ExrLayer> all;
  Layers() {
    for (size_t i = 0; i < id.size(); ++i) id[i] = float(int(i * 2654435761u % 100003) - 1);
    all = {{"", {"R", "G", "B"}, beauty, false, false},
           {"albedo", {"R", "G", "B"}, albedo, false, false},
           {"normal", {"X", "Y", "Z"}, normal, false, true},
           {"depth", {"Z"}, depth, true, true},
           {"object_id", {"id"}, id, true, true}};
  }
};

Image layerOf(const std::vector<uint8_t>& bytes, const std::string& layer) {
  const auto image = readExrLayer(bytes.data(), bytes.size(), "a.exr", layer);
  EXPECT_TRUE(image.ok()) << layer << ": " << image.status().toString();
  return image.ok() ? *image : Image(kW, kH, 1);
}

std::vector<uint8_t> encoded(std::span<const ExrLayer> layers, const ExrOptions& options = {}) {
  const auto bytes = encodeExr(kW, kH, layers, options);
  EXPECT_TRUE(bytes.ok()) << bytes.status().toString();
  return bytes.ok() ? *bytes : std::vector<uint8_t>{};
}

TEST(ExrLayers, EveryLosslessCompressionKeepsEveryBit) {
  const Layers l;
  for (const auto c : {ExrCompression::None, ExrCompression::Rle, ExrCompression::Zips, ExrCompression::Zip, ExrCompression::Piz}) {
    ExrOptions o;
    o.compression = c;
    const auto bytes = encoded(l.all, o);
    EXPECT_EQ(layerOf(bytes, "").data, l.beauty) << int(c);
    EXPECT_EQ(layerOf(bytes, "albedo").data, l.albedo) << int(c);
    EXPECT_EQ(layerOf(bytes, "normal").data, l.normal) << int(c);
    EXPECT_EQ(layerOf(bytes, "depth").data, l.depth) << int(c);
    EXPECT_EQ(layerOf(bytes, "object_id").data, l.id) << int(c);
    EXPECT_EQ(layerOf(bytes, "normal").names, (std::vector<std::string>{"X", "Y", "Z"}));
    EXPECT_EQ(layerOf(bytes, "").names, (std::vector<std::string>{"R", "G", "B"}));
  }
}

TEST(ExrLayers, HalfLeavesFloat32LayersAlone) {
  const Layers l;
  ExrOptions o;
  o.half = true;
  const auto bytes = encoded(l.all, o);
  EXPECT_EQ(layerOf(bytes, "depth").data, l.depth);
  EXPECT_EQ(layerOf(bytes, "object_id").data, l.id);
  const Image normal = layerOf(bytes, "normal");
  EXPECT_NE(normal.data, l.normal);
  for (size_t i = 0; i < l.normal.size(); ++i) EXPECT_NEAR(normal.data[i], l.normal[i], std::fabs(l.normal[i]) * 0x1p-11f + 0x1p-25f);
}

TEST(ExrLayers, DwaLosesColoursOnly) {
  const Layers l;
  for (const auto c : {ExrCompression::Dwaa, ExrCompression::Dwab}) {
    ExrOptions o;
    o.compression = c;
    const auto bytes = encoded(l.all, o);
    EXPECT_EQ(layerOf(bytes, "normal").data, l.normal);
    EXPECT_EQ(layerOf(bytes, "depth").data, l.depth);
    EXPECT_EQ(layerOf(bytes, "object_id").data, l.id);
    const Image albedo = layerOf(bytes, "albedo"), beauty = layerOf(bytes, "");
    EXPECT_NE(albedo.data, l.albedo) << "lossy after all?";
    double error = 0;
    for (size_t i = 0; i < l.beauty.size(); ++i) error += std::fabs(beauty.data[i] - l.beauty[i]);
    EXPECT_LT(error / double(l.beauty.size()), 0.25);  // of noise in -2 .. 6, the worst that DCT can meet
    EXPECT_EQ(layerOf(bytes, "albedo").names, (std::vector<std::string>{"R", "G", "B"}));
    o.dwaLevel = 500;
    EXPECT_LT(encoded(l.all, o).size(), bytes.size());
  }
}

// Why lossless layers get a part of their own: DWA's rule goes by the last name of a channel, and Y is luma to it.
TEST(ExrLayers, DwaAloneWouldLoseChannelsCalledY) {
  Layers l;
  l.all[2].lossless = false;
  ExrOptions o;
  o.compression = ExrCompression::Dwaa;
  const Image normal = layerOf(encoded(std::span(l.all).subspan(2, 1), o), "normal");
  size_t x = 0, y = 0;
  for (size_t i = 0; i < l.normal.size(); i += 3) x += normal.data[i] != l.normal[i], y += normal.data[i + 1] != l.normal[i + 1];
  EXPECT_EQ(x, 0u);
  EXPECT_GT(y, 1000u);
}

TEST(ExrLayers, LossyRangeIsClampedNotInfinite) {
  std::vector<float> wild(size_t(kW) * kH * 3, 1.0f);
  wild[0] = 1e9f;
  wild[1] = -1e9f;
  wild[2] = 70000.0f;
  const ExrLayer layer{"", {"R", "G", "B"}, wild, false, false};
  ExrOptions o;
  o.compression = ExrCompression::Dwaa;
  for (const float v : layerOf(encoded(std::span(&layer, 1), o), "").data) ASSERT_TRUE(std::isfinite(v) && std::fabs(v) <= 66000.0f) << v;
}

TEST(ExrLayers, NamesAndListing) {
  Layers l;
  l.all.push_back({exrLayerName("group:key.001"), {"R", "G", "B"}, l.beauty, false, true});
  for (const auto c : {ExrCompression::Zip, ExrCompression::Dwaa}) {
    ExrOptions o;
    o.compression = c;
    const auto bytes = encoded(l.all, o);
    EXPECT_EQ(layerOf(bytes, "group_key_001").data, l.beauty);
    EXPECT_EQ(layerOf(bytes, "group:key.001").data, l.beauty) << "by the name of the output";
    const auto names = exrLayers(bytes.data(), bytes.size(), "a.exr");
    ASSERT_TRUE(names.ok());
    for (const char* n : {"", "albedo", "normal", "depth", "object_id", "group_key_001"}) EXPECT_EQ(std::count(names->begin(), names->end(), n), 1) << n;
    const auto none = readExrLayer(bytes.data(), bytes.size(), "a.exr", "nothing");
    EXPECT_EQ(none.status().code(), Code::NotFound);
    EXPECT_NE(none.status().message().find("object_id"), std::string::npos) << "lists what there is";
  }
}

TEST(ExrLayers, MoreThan64ChannelsAreReadByLayer) {
  Layers l;
  for (int i = 0; i < 30; ++i) l.all.push_back({"group_" + std::to_string(i), {"R", "G", "B"}, l.albedo, false, true});
  const auto bytes = encoded(l.all);
  EXPECT_EQ(layerOf(bytes, "group_17").data, l.albedo);
  EXPECT_EQ(layerOf(bytes, "").data, l.beauty);
}

TEST(ExrLayers, PictureSpecNamesFileAndLayer) {
  const Layers l;
  const auto bytes = encoded(l.all);
  const std::string file = (std::filesystem::temp_directory_path() / ("gobo_layers_" + std::to_string(::getpid()) + ".exr")).string();
  ASSERT_TRUE(writeFileAtomic(file, bytes.data(), bytes.size()).ok());
  EXPECT_EQ(readPicture(file)->data, l.beauty);
  EXPECT_EQ(readPicture(file + ":depth")->data, l.depth);
  EXPECT_EQ(readPicture(file + ":a:b").status().code(), Code::NotFound);
  EXPECT_FALSE(readPicture(file + "x").ok());
  std::filesystem::remove(file);
}

TEST(ExrLayers, MetadataAndMatrices) {
  const Layers l;
  ExrOptions o;
  o.metadata["gobo:request"] = "{\"scene\":\"x\"}";
  Mat4 m(1.0f);
  m[3] = Vec4(5, 6, 7, 1);  // translation, column vectors
  o.matrices["worldToCamera"] = m;
  for (const auto c : {ExrCompression::Zip, ExrCompression::Dwaa}) {
    o.compression = c;
    const auto bytes = encoded(l.all, o);
    EXPECT_EQ((*exrMetadata(bytes.data(), bytes.size(), "a.exr"))["gobo:request"], "{\"scene\":\"x\"}");
    const std::string file = (std::filesystem::temp_directory_path() / ("gobo_meta_" + std::to_string(::getpid()) + ".exr")).string();
    ASSERT_TRUE(writeFileAtomic(file, bytes.data(), bytes.size()).ok());
    Imf::MultiPartInputFile in(file.c_str());
    ASSERT_TRUE(Imf::hasWorldToCamera(in.header(0)));
    const Imath::V3f p = Imath::V3f(1, 1, 1) * Imf::worldToCamera(in.header(0));
    EXPECT_EQ(p, Imath::V3f(6, 7, 8));
    std::filesystem::remove(file);
  }
}

TEST(ExrLayers, SameBytesEveryTime) {
  const Layers l;
  for (const auto c : {ExrCompression::Zip, ExrCompression::Piz, ExrCompression::Dwab}) {
    ExrOptions o;
    o.compression = c;
    EXPECT_EQ(encoded(l.all, o), encoded(l.all, o)) << int(c);
  }
}

TEST(ExrLayers, RefusesBadLayers) {
  Layers l;
  l.all.push_back({"albedo", {"R", "G", "B"}, l.albedo, false, true});
  EXPECT_FALSE(encodeExr(kW, kH, l.all).ok()) << "twice the same name";
  l.all.back() = {"short", {"R", "G", "B"}, std::span<const float>(l.albedo).first(5), false, true};
  EXPECT_FALSE(encodeExr(kW, kH, l.all).ok());
  EXPECT_FALSE(encodeExr(kW, kH, {}).ok());
}

}  // namespace
}  // namespace gobo
