// SPDX-License-Identifier: Apache-2.0
// What a glTF comes in: GLB chunks, JSON text, data URIs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "import/gltf/container.h"
#include "import/load.h"
#include "support/gltf_base.h"

namespace gobo {
namespace {

using testing::GltfBase;
using testing::Json;
using testing::MemoryFile;

constexpr uint32_t kJson = 0x4e4f534a, kBin = 0x004e4942, kOther = 0x44434241;

Result<ScenePtr> load(const std::string& bytes) {
  MemoryFile file(bytes);
  LoadOptions options;
  options.files = &file;
  return loadGltf("a.glb", options);
}
std::string word(uint32_t v) { return std::string(reinterpret_cast<const char*>(&v), 4); }
std::string chunk(uint32_t type, const std::string& bytes, int64_t stated = -1) {
  return word(stated < 0 ? uint32_t(bytes.size()) : uint32_t(stated)) + word(type) + bytes;
}
std::string glb(const std::string& chunks, int64_t length = -1, uint32_t version = 2, const char* magic = "glTF") {
  return magic + word(version) + word(length < 0 ? uint32_t(chunks.size()) + 12 : uint32_t(length)) + chunks;
}
std::string padded(std::string s, char by) {
  while (s.size() % 4) s += by;
  return s;
}

struct Parts {
  std::string json, bin;
};
Parts parts() {
  GltfBase b = testing::gltfBase();
  return {padded(b.doc.dump(), ' '), padded(std::string(b.bytes.begin(), b.bytes.end()), '\0')};
}

bool warns(const Result<ScenePtr>& scene, const std::string& what) {
  return scene.ok() &&
         std::any_of((*scene)->warnings.begin(), (*scene)->warnings.end(), [&](const std::string& w) { return w.find(what) != std::string::npos; });
}

TEST(GltfContainer, ChunksOfAGlb) {
  const auto [json, bin] = parts();
  const std::string j = chunk(kJson, json), b = chunk(kBin, bin);
  const auto good = load(glb(j + b));
  ASSERT_TRUE(good.ok()) << good.status().toString();
  const auto refused = [&](const std::string& file, const char* why) {
    const auto scene = load(file);
    ASSERT_FALSE(scene.ok()) << "loads: " << why;
    EXPECT_NE(scene.status().message().find(why), std::string::npos) << scene.status().toString();
    EXPECT_EQ(scene.status().location().substr(0, 5), "a.glb");
  };
  refused(glb(j + b, -1, 2, "glTG"), "cannot be parsed");
  refused(glb(j + b, -1, 1), "version 1 is not 2");
  refused(glb(j + b, int64_t(json.size() + bin.size()) + 400), "but the file has");
  refused(glb(j + b, 8), "but the file has");
  refused(glb(j + b + b), "has a second BIN chunk");
  refused(glb(j + j + b), "has a second JSON chunk");
  refused(glb(b + j), "begins with a BIN chunk");
  refused(glb(j + chunk(kOther, "abcd") + b), "BIN chunk is not the second chunk");
  refused(glb(j + chunk(kBin, bin, int64_t(bin.size()) + 4)), "does not fit the file");
  refused(glb(chunk(kJson, json, 1 << 24) + b), "does not fit the file");
  refused(glb(chunk(kJson, "") + b), "cannot be parsed");
  refused(glb(j + "abc"), "chunk 1: its header is cut short");
  refused(glb(j).substr(0, 15), "header is cut short");
  refused(glb(j + chunk(kBin, bin.substr(0, bin.size() - 8))), "byteLength");
  EXPECT_TRUE(warns(load(glb(j + b + chunk(kOther, "abcd"))), "unknown type 0x44434241"));
  EXPECT_TRUE(warns(load(glb(j + b) + "tail"), "4 bytes after the end"));
  EXPECT_TRUE(warns(load(glb(j + chunk(kBin, bin + "x"))), "no multiple of 4"));
  EXPECT_TRUE(warns(load(glb(j + chunk(kBin, bin + std::string(8, '\0')))), "/buffers/0/byteLength: the GLB chunk has"));
  // A buffer of a GLB without a BIN chunk has no bytes; nothing reads it here.
  const std::string alone = padded(R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":4}]})", ' ');
  EXPECT_TRUE(warns(load(glb(chunk(kJson, alone))), "/buffers/0: has no uri"));
}

TEST(GltfContainer, DataUrisOfBothKindsAreTheSameScene) {
  const GltfBase base = testing::gltfBase();
  const auto plain = load(base.text());
  ASSERT_TRUE(plain.ok()) << plain.status().toString();
  std::string escaped;
  for (const uint8_t v : base.bytes) {
    char hex[8];
    std::snprintf(hex, sizeof hex, "%%%02x", v);
    escaped += hex;
  }
  const std::string whole = base64(base.bytes.data(), base.bytes.size());
  const auto with = [&](const std::string& uri) {
    GltfBase b = base;
    b.doc["buffers"][0]["uri"] = uri;
    return load(b.text());
  };
  for (const char* head : {"data:application/octet-stream,", "data:application/gltf-buffer,", "data:,"}) {
    const auto scene = with(std::string(head) + escaped);
    ASSERT_TRUE(scene.ok()) << head << ": " << scene.status().toString();
    EXPECT_EQ((*scene)->hash(), (*plain)->hash());
  }
  std::string bare = whole, percent = whole;
  while (bare.back() == '=') bare.pop_back();  // padding may be left away, and '=' escaped
  for (size_t at; (at = percent.find('=')) != std::string::npos;) percent.replace(at, 1, "%3D");
  for (const std::string& digits : {bare, percent}) EXPECT_TRUE(with("data:application/octet-stream;base64," + digits).ok());
  for (const auto& [uri, why] : {std::pair{"data:application/octet-stream;base64,@@@@", "byte 64 at 0"},
                                 {"data:application/octet-stream;base64,AAAAA", "no whole bytes"},
                                 {"data:application/octet-stream;base64", "no comma"},
                                 {"data:application/octet-stream;base64,", "has 0 bytes"}}) {
    const auto scene = with(uri);
    ASSERT_FALSE(scene.ok()) << uri;
    EXPECT_NE(scene.status().message().find(why), std::string::npos) << scene.status().toString();
    EXPECT_EQ(scene.status().location().substr(0, 16), "a.glb#/buffers/0");
  }
}

TEST(GltfContainer, JsonText) {
  const std::string good = testing::gltfBase().text();
  const auto refused = [](const std::string& text, const std::string& location, const char* why) {
    const auto scene = load(text);
    ASSERT_FALSE(scene.ok()) << why;
    EXPECT_EQ(scene.status().location(), "a.glb#" + location) << scene.status().toString();
    EXPECT_NE(scene.status().message().find(why), std::string::npos) << scene.status().toString();
  };
  const auto with = [&](const std::string& what, const std::string& by) {
    std::string t = good;
    t.replace(t.find(what), what.size(), by);
    return t;
  };
  refused(with("\"asset\":{", "\"scene\":0,\"asset\":{"), "/scene", "\"scene\" stands twice");
  refused(with("\"asset\":{", "\"asset\":{\"version\":\"2.0\","), "/asset/version", "stands twice");
  refused(with("\"name\":\"joint 1\"", "\"name\":\"joint 1\",\"name\":\"x\""), "/nodes/1/name", "stands twice");
  std::string many = R"({"asset":{"version":"2.0","extras":{)";  // more keys than are compared one by one
  for (int k = 0; k < 40; ++k) many += "\"k" + std::to_string(k) + "\":[{\"k\":1},{\"k\":2}],";
  EXPECT_TRUE(load(many + "\"last\":0}}}").ok());
  refused(many + "\"k39\":0}}}", "/asset/extras/k39", "stands twice");
  refused(many + "\"k3\":0}}}", "/asset/extras/k3", "stands twice");
  for (const char* bad : {"\xff\xfe", "\xc0\xaf", "\xed\xa0\x80", "\\ud800", "\x01"})
    refused(with("\"asset\":{", "\"asset\":{\"generator\":\"" + std::string(bad) + "\","), "", "cannot be parsed");
  for (const char* bad : {"NaN", "Infinity", "1e999", "01", "'x'", ""})
    refused(with("\"asset\":{", "\"asset\":{\"extras\":" + std::string(bad) + ","), "", "cannot be parsed");
  refused(good + "{}", "", "cannot be parsed");
  refused("[]", "", "not a JSON object");
  refused("", "", "cannot be parsed");
  EXPECT_TRUE(warns(load("\xef\xbb\xbf" + good), "byte order mark"));
}

TEST(GltfContainer, PicturesAreNamedByTheirBytes) {
  const auto kind = [](const std::string& s) { return gltf::pictureKind({s.begin(), s.end()}); };
  EXPECT_EQ(kind(smallPng(1, 2, 3)), "image/png");
  EXPECT_EQ(kind("\xff\xd8\xff\xe0"), "image/jpeg");
  EXPECT_EQ(kind(std::string("RIFF\0\0\0\0WEBP", 12)), "image/webp");
  EXPECT_EQ(kind("BM"), "image/bmp");
  EXPECT_EQ(kind(""), "");
  // KTX2 is not decoded: the texture is left out by name.
  GltfBase base = testing::gltfBase();
  base.doc["images"][1]["uri"] = "data:image/ktx2;base64," + base64("\xabKTX 20\xbb\r\n\x1a\n", 12);
  base.doc["textures"][0]["source"] = 1;
  EXPECT_TRUE(warns(load(base.text()), "is ktx2"));
}

}  // namespace
}  // namespace gobo
