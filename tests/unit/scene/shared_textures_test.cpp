// SPDX-License-Identifier: Apache-2.0
// Many textures of one picture cost one picture: in the scene, in its mip levels, in the blob and in a scene read from that. What
// each of them shows is what it would show alone.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "import/load.h"
#include "scene/mipmap.h"
#include "support/small_gltf.h"
#include "support/thorough.h"

namespace gobo::shared_textures_test {
namespace {

using Json = nlohmann::json;

/// The glTF's bytes; pictures come along as data URIs.
class Memory final : public FileSource {
 public:
  explicit Memory(std::string text) : text_(std::move(text)) {}
  Result<std::vector<uint8_t>> main(uint64_t) override { return std::vector<uint8_t>(text_.begin(), text_.end()); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t) override { return notFound("\"" + name + "\" does not exist"); }

 private:
  std::string text_;
};

std::string pictureUri(int side, float value) {
  Image image(side, side, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i % 3) * 0.25f + value;
  const auto png = encodePng(image);
  return "data:image/png;base64," + base64(png->data(), png->size());
}

/// `textures` textures over `images` images of the same bytes and every sampler there is; material i shows texture i as colour, as data
/// or cut out.
std::string manyTextures(int textures, int images, int side) {
  Json doc = Json::parse(smallGltf(""));
  const std::string uri = pictureUri(side, 0.25f);
  for (int i = 0; i < images; ++i) doc["images"].push_back({{"uri", uri}, {"name", "p" + std::to_string(i)}});
  for (const int s : {10497, 33071, 33648})
    for (const int t : {10497, 33071, 33648})
      for (const int filter : {9729, 9728}) doc["samplers"].push_back({{"wrapS", s}, {"wrapT", t}, {"magFilter", filter}});
  doc["materials"] = Json::array();
  for (int i = 0; i < textures; ++i) {
    doc["textures"].push_back({{"source", i % images}, {"sampler", i % 18}});
    Json m;
    m["name"] = "m" + std::to_string(i);
    if (i / 18 % 3 == 1) m["normalTexture"] = {{"index", i}};
    else m["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", i}};
    if (i / 18 % 3 == 2) m["alphaMode"] = "MASK";
    doc["materials"].push_back(m);
  }
  return doc.dump();
}

Result<ScenePtr> loadText(const std::string& text, uint64_t maxBytes = 8ull << 30, uint64_t textureBytes = 4ull << 30) {
  Memory files(text);
  LoadOptions options;
  options.files = &files;
  options.maxBytes = maxBytes;
  options.textureBytes = textureBytes;
  return loadGltf("many.gltf", options);
}

size_t arraysOf(const Scene& s) {
  std::set<const void*> arrays;
  for (const auto& t : s.textures) arrays.insert(t->texels8.empty() ? static_cast<const void*>(t->texelsF.data()) : t->texels8.data());
  return arrays.size();
}

// sRGB, linear, and sRGB cut out: three sets of levels, whatever the number of textures, samplers and images.
TEST(SharedTextures, OnePictureIsKeptOnce) {
  for (const auto& [images, side] : {std::pair(1, testing::thoroughOr(2048, 1024)), std::pair(500, testing::thoroughOr(256, 128))}) {
    const uint64_t one = uint64_t(side) * uint64_t(side) * 4, levels = one * 4 / 3;
    const std::string text = manyTextures(500, images, side);
    // A picture as floats (three channels), its texels, the document and encoded pictures.
    const auto scene = loadText(text, one * 4 + 2 * text.size() + (8 << 20));
    ASSERT_TRUE(scene.ok()) << scene.status().toString();
    ASSERT_EQ((*scene)->textures.size(), 500u);
    EXPECT_EQ(arraysOf(**scene), 3u);
    EXPECT_LT((*scene)->bytes(), 3 * levels + (2 << 20));
    if (images > 1) continue;
    const std::vector<uint8_t> blob = blobOfScene(**scene);
    EXPECT_LT(blob.size(), 3 * levels + (2 << 20));
    const auto keep = std::make_shared<std::vector<uint8_t>>(blob.size() + 64);
    uint8_t* at = keep->data() + (64 - reinterpret_cast<uintptr_t>(keep->data()) % 64) % 64;
    std::memcpy(at, blob.data(), blob.size());
    const auto back = readSceneBlob(keep, {at, blob.size()}, BlobTrust::Foreign);
    ASSERT_TRUE(back.ok()) << back.status().toString();
    EXPECT_EQ((*back)->hash(), (*scene)->hash());
    EXPECT_EQ(arraysOf(**back), 3u);
    EXPECT_EQ((*back)->bytes(), (*scene)->bytes());
  }
}

TEST(SharedTextures, EachIsWhatItWouldBeAlone) {
  const auto scene = loadText(manyTextures(54, 1, 20));
  ASSERT_TRUE(scene.ok()) << scene.status().toString();
  ASSERT_EQ((*scene)->textures.size(), 54u);
  std::set<std::string> contents;
  for (size_t i = 0; i < 54; ++i) {
    const Texture& t = *(*scene)->textures[i];
    Texture alone;
    alone.width = alone.height = 20;
    alone.srgb = i / 18 != 1;
    alone.wrapU = std::array{Wrap::Repeat, Wrap::Clamp, Wrap::Mirror}[i % 18 / 6];
    alone.wrapV = std::array{Wrap::Repeat, Wrap::Clamp, Wrap::Mirror}[i % 6 / 2];
    alone.nearest = i % 2 == 1;
    std::vector<uint8_t> texels;
    for (int p = 0; p < 400; ++p)
      for (int c = 0; c < 4; ++c) texels.push_back(c == 3 ? 255 : uint8_t(encodeTransfer(Transfer::Srgb, 0.25 * c + 0.25) * 255.0 + 0.5));
    alone.texels8 = texels;
    sealTexture(alone);
    const Texture made = mipmapped(alone, i / 18 == 2);
    EXPECT_EQ(t.content, made.content) << i;
    EXPECT_EQ(t.lowest, made.lowest) << i;
    EXPECT_EQ(t.texels8, made.texels8) << i;
    contents.insert(t.content.hex());
  }
  EXPECT_EQ(contents.size(), 36u);  // 18 samplers as colour (an opaque picture is the same cut out) and as data
}

// The bound on textures counts what is kept, so sharing does not cost resolution.
TEST(SharedTextures, TheBoundCountsThemOnce) {
  const std::string text = manyTextures(60, 1, 64);
  const auto whole = loadText(text, 8ull << 30, 3 * 64 * 64 * 4 * 4 / 3 + 3000), half = loadText(text, 8ull << 30, 3 * 64 * 64 * 4 - 1);
  ASSERT_TRUE(whole.ok() && half.ok());
  EXPECT_TRUE((*whole)->warnings.empty()) << (*whole)->warnings[0];
  EXPECT_GE((*half)->warnings.size(), 24u);  // at least one set of levels, all its textures
  EXPECT_EQ(arraysOf(**half), 3u);
}

// Glossiness in alpha becomes roughness of its own texels: once for each picture and factor.
TEST(SharedTextures, GlossMapsAreMadeOnceForEachFactor) {
  Json doc = Json::parse(smallGltf(""));
  doc["images"] = {{{"uri", pictureUri(16, 0.5f)}}};
  doc["textures"] = {{{"source", 0}}};
  doc["materials"] = Json::array();
  for (int i = 0; i < 40; ++i)
    doc["materials"].push_back(
        {{"extensions", {{"KHR_materials_pbrSpecularGlossiness", {{"specularGlossinessTexture", {{"index", 0}}}, {"glossinessFactor", i % 2 ? 0.5 : 1.0}}}}}});
  doc["extensionsUsed"].push_back("KHR_materials_pbrSpecularGlossiness");
  const auto scene = loadText(doc.dump());
  ASSERT_TRUE(scene.ok()) << scene.status().toString();
  EXPECT_EQ((*scene)->textures.size(), 4u);  // colour, data, and two of roughness
}

}  // namespace
}  // namespace gobo::shared_textures_test
