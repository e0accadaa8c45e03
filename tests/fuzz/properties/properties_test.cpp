// SPDX-License-Identifier: Apache-2.0
// The fuzz targets' properties without a fuzzer: every seed of ../shared/data, every regression (tests/data/fuzz/TARGET), and
// inputs made on the spot. And that the properties can fail.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>

#include "base/utf8.h"
#include "fuzz/pack.h"
#include "fuzz/targets.h"
#include "support/small_gltf.h"

namespace gobo::fuzz {
namespace {

namespace fs = std::filesystem;
using Property = Outcome (*)(Bytes);

std::vector<uint8_t> contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
Bytes bytesOf(const std::string& s) { return {reinterpret_cast<const uint8_t*>(s.data()), s.size()}; }

struct Count {
  size_t files = 0, accepted = 0, refused = 0;
};
Count feed(Property property, const fs::path& root, size_t most, const std::function<bool(const fs::path&)>& wanted) {
  std::vector<fs::path> files;
  for (const auto& e : fs::recursive_directory_iterator(root))
    if (e.is_regular_file() && e.file_size() <= most && wanted(e.path())) files.push_back(e.path());
  std::sort(files.begin(), files.end());
  Count n;
  for (const fs::path& file : files) {
    const Outcome out = property(contents(file));
    EXPECT_EQ(out.broken, "") << file;
    ++n.files;
    ++(out.accepted ? n.accepted : n.refused);
  }
  return n;
}
void show(const char* what, const Count& n) { std::cout << what << ": " << n.files << " files, " << n.accepted << " accepted, " << n.refused << " refused\n"; }

TEST(FuzzProperties, Regressions) {
  std::map<std::string, Property> targets{{"corpus", nullptr}};  // below
  for (const Target& t : readerTargets()) targets[t.name] = t.property;
  for (const char* name : kServedNames) targets[name] = nullptr;  // tests/fuzz/served
  for (const auto& e : fs::directory_iterator("tests/data/fuzz")) {
    if (!e.is_directory()) continue;
    const auto target = targets.find(e.path().filename());
    ASSERT_NE(target, targets.end()) << e.path() << " belongs to no target";
    if (target->second) show(target->first.c_str(), feed(target->second, e.path(), 64 << 10, [](const fs::path&) { return true; }));
  }
}

// What fuzzers found worth keeping, made of our own seeds (docs/fuzzing.md).
TEST(FuzzProperties, Corpora) {
  for (const Target& t : readerTargets()) {
    const std::string file = std::string("tests/data/fuzz/corpus/") + t.name + ".pack";
    const auto inputs = readPack(file);
    ASSERT_TRUE(inputs.ok()) << inputs.status().toString();
    EXPECT_GT(inputs->size(), 10u) << file;
    Count n;
    for (size_t i = 0; i < inputs->size(); ++i) {
      EXPECT_LE((*inputs)[i].size(), t.mostBytes) << file;
      const Outcome out = t.property((*inputs)[i]);
      EXPECT_EQ(out.broken, "") << file << ", input " << i;
      ++n.files;
      ++(out.accepted ? n.accepted : n.refused);
    }
    show(t.name, n);
  }
}

TEST(FuzzPack, IsReadAsItWasWritten) {
  const std::string file = (fs::temp_directory_path() / ("gobo-pack-" + std::to_string(::getpid()))).string();
  const auto damaged = [&](const std::string& bytes) {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    return readPack(file).status();
  };
  EXPECT_EQ(readPack(file).status().code(), Code::NotFound);
  ASSERT_TRUE(writePack(file, {{3, 2}, {}, {1}, {3, 2}}).ok());
  const auto back = readPack(file);
  ASSERT_TRUE(back.ok()) << back.status().toString();
  EXPECT_EQ(*back, (Inputs{{}, {1}, {3, 2}}));
  const std::vector<uint8_t> raw = contents(file);
  const std::string whole(raw.begin(), raw.end());
  EXPECT_TRUE(damaged(whole).ok());
  EXPECT_EQ(damaged("GOBO" + whole).code(), Code::InvalidArgument);
  EXPECT_EQ(damaged(whole.substr(0, whole.size() - 1)).code(), Code::InvalidArgument);
  EXPECT_EQ(damaged(whole + "ab").code(), Code::InvalidArgument);
  EXPECT_EQ(damaged(whole).location(), "");
  EXPECT_EQ(damaged(whole + "ab").location(), file);
  fs::remove(file);
}

TEST(FuzzProperties, GltfSeeds) {
  if (!fs::exists("../shared/data/gltf")) GTEST_SKIP() << "../shared/data/gltf is absent";
  const Count n = feed(tryGltf, "../shared/data/gltf", 48 << 10, [](const fs::path& p) { return p.extension() == ".gltf" || p.extension() == ".glb"; });
  show("gltf", n);
  EXPECT_GT(n.accepted, 50u);
  EXPECT_GT(n.refused, 50u);
}

TEST(FuzzProperties, PictureSeeds) {
  if (!fs::exists("../shared/data/exr")) GTEST_SKIP() << "../shared/data is absent";
  for (const char* folder : {"exr", "hdr", "images"}) {
    const Count n = feed(tryImage, std::string("../shared/data/") + folder, 32 << 10,
                         [](const fs::path& p) { return p.extension() != ".tsv" && p.extension() != ".md" && p.extension() != ".rst"; });
    show(folder, n);
    EXPECT_GT(n.files, 10u);
  }
}

TEST(FuzzProperties, EditedBlobs) {
  // A fixed stream of edits of fields and bytes, as libFuzzer would make them.
  uint64_t state = 42;
  const auto random = [&] {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return uint8_t(state >> 56);
  };
  size_t accepted = 0;
  for (int k = 0; k < 1500; ++k) {
    std::vector<uint8_t> input{uint8_t(1 + k % 2)};
    const int edits = 1 + k % 3;
    for (int i = 0; i < edits * (k % 2 ? 7 : 3); ++i) input.push_back(random());
    const Outcome out = tryBlob(input);
    ASSERT_EQ(out.broken, "") << "edit " << k;
    accepted += out.accepted;
  }
  EXPECT_GT(accepted, 100u);  // harmless edits of fields
  EXPECT_LT(accepted, 1400u);
  std::cout << accepted << " of 1500 edited blobs accepted\n";
  EXPECT_TRUE(tryBlob(std::vector<uint8_t>{1}).accepted);  // no edit
  EXPECT_TRUE(tryBlob(std::vector<uint8_t>{2}).accepted);
}

TEST(FuzzProperties, Requests) {
  for (const char* text : {R"({"scene":"rich","lights":{"lamp":{"intensity":3}}})",
                           R"({"camera":{"position":{"x":1},"lookAt":{"y":1}},"encoding":{"half":true}})", "halt.spp=4\nlights.lamp.color=1,1,0"})
    EXPECT_TRUE(tryRequestText(bytesOf(text)).accepted) << text;
  for (const char* text : {R"({"width":0})", R"({"nothing":1})", R"({"halt":{"error":"NaN"}})", "{", R"({"camera":{"yfovDeg":"Infinity"}})"}) {
    const Outcome out = tryRequestText(bytesOf(text));
    EXPECT_FALSE(out.accepted) << text;
    EXPECT_FALSE(out.said.empty()) << text;
    EXPECT_EQ(out.broken, "") << text;
  }
}

TEST(FuzzProperties, NamesThatAreNotUtf8BecomeText) {
  // Percent-escapes give any byte; the warning about the file that is not there must still be a protobuf string.
  for (const char* uri : {"%ff.png", "a%c3.png", "%ed%a0%80.png"}) {
    const Outcome out = tryGltf(bytesOf(smallGltf(uri)));
    EXPECT_TRUE(out.accepted) << out.said;
    EXPECT_EQ(out.broken, "") << uri;
  }
  // A quotation that is cut in the middle of a character.
  const Outcome refused = tryGltf(bytesOf(smallGltf("../" + std::string(96, 'a') + "\xc3\xa9\xc3\xa9")));
  EXPECT_FALSE(refused.accepted);
  EXPECT_EQ(refused.broken, "");
  EXPECT_EQ(tryGltf(bytesOf("{\"asset\":\"\xff\"}")).broken, "");
}

TEST(FuzzProperties, TheyCanFail) {
  EXPECT_NE(brokenStatus(Status(), ""), "");
  EXPECT_NE(brokenStatus(internalError("x", "file"), "file"), "");
  EXPECT_NE(brokenStatus(invalidArgument("", "file"), "file"), "");
  EXPECT_NE(brokenStatus(invalidArgument("x", "elsewhere"), "file"), "");
  EXPECT_NE(brokenStatus(invalidArgument("\xff", "file"), "file"), "");
  EXPECT_EQ(brokenStatus(invalidArgument("x", "file#/a"), "file"), "");
  EXPECT_EQ(brokenValues(*richScene()), "");
  EXPECT_EQ(brokenBlob(*richScene()), "");
  EXPECT_EQ(brokenPoses(richScene()), "");
  Scene s = *richScene();
  s.materials[0].bsdf.roughness = NAN;
  EXPECT_NE(brokenValues(s), "");
  EXPECT_NE(brokenBlob(s), "");
  Scene t = *richScene();
  t.warnings.push_back("\xff");
  EXPECT_NE(brokenValues(t), "");
  EXPECT_NE(brokenBlob(t), "");  // the reader of blobs refuses it too
}

TEST(Utf8, WellFormedOrNot) {
  for (const char* good : {"", "a", "\xc3\xa9", "\xe2\x82\xac", "\xf0\x9f\x98\x80", "\xed\x9f\xbf", "\xf4\x8f\xbf\xbf"}) {
    EXPECT_TRUE(isUtf8(good)) << good;
    EXPECT_EQ(cleanUtf8(std::string(good)), good);
  }
  for (const char* bad :
       {"\x80", "\xc3", "\xc0\xaf", "\xe0\x80\x80", "\xed\xa0\x80", "\xf0\x80\x80\x80", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xe2\x82", "a\xffz"})
    EXPECT_FALSE(isUtf8(bad));
  EXPECT_EQ(cleanUtf8(std::string("a\xff\xc3\xa9\xe2\x82")), "a\\xff\xc3\xa9\\xe2\\x82");
}

}  // namespace
}  // namespace gobo::fuzz
