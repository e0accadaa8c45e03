// SPDX-License-Identifier: Apache-2.0
// What files of mattes say: names, manifest, channels, keys; and how many rays a pixel gets.
#include <gtest/gtest.h>

#include <google/protobuf/struct.pb.h>

#include <set>

#include "plan/cryptomatte.h"
#include "plan/outputs.h"
#include "request/request.h"
#include "terms/cryptomatte.h"
#include "trace/sample_passes.h"

namespace gobo::cryptomatte_names_test {
namespace {

TEST(CryptomatteNames, NamesOfTheirOwnOrByNumber) {
  Scene s;
  for (const char* n : {"", "material2", "", "b\xff", "material4", ""}) s.materials.emplace_back().name = n;
  EXPECT_EQ(matteNames(s, MatteOf::Materials), (std::vector<std::string>{"material0", "material2", "material2#2", "b\\xff", "material4", "material5"}));
  for (const char* n : {"ball", ""}) s.instances.emplace_back().name = n;
  EXPECT_EQ(matteNames(s, MatteOf::Objects), (std::vector<std::string>{"ball", "instance1"}));
}

TEST(CryptomatteNames, AttributesAreThoseOfTheSpecification) {
  const std::vector<std::string> names{"bunny", "quote\" back\\ line\n", "Kugel \xc3\xa4\xe2\x82\xac", "bunny", ""};
  auto a = cryptomatteAttributes("crypto_object", names);
  ASSERT_EQ(a.size(), 4u);
  EXPECT_EQ(a["cryptomatte/f834d0a/name"], "crypto_object");  // the key that other renderers write for this name
  EXPECT_EQ(a["cryptomatte/f834d0a/hash"], "MurmurHash3_32");
  EXPECT_EQ(a["cryptomatte/f834d0a/conversion"], "uint32_to_float32");
  EXPECT_TRUE(cryptomatteAttributes("crypto_material", {}).count("cryptomatte/bda530a/name"));
  EXPECT_EQ(cryptomatteAttributes("crypto_material", {}).at("cryptomatte/bda530a/manifest"), "{}");
  google::protobuf::Struct manifest;
  ASSERT_TRUE(messageFromJson(a["cryptomatte/f834d0a/manifest"], manifest, "manifest").ok()) << a["cryptomatte/f834d0a/manifest"];
  EXPECT_EQ(manifest.fields_size(), 4) << "a name once";
  EXPECT_EQ(manifest.fields().at("bunny").string_value(), "13851a76");
  for (const auto& [name, id] : manifest.fields()) EXPECT_EQ(id.string_value(), cryptomatteHex(cryptomatteId(name))) << name;
  EXPECT_TRUE(manifest.fields().count(names[1]) && manifest.fields().count(names[2]));
  for (const auto& [key, value] : a) EXPECT_LE(key.size(), 31u) << "what every EXR reader takes";
}

TEST(CryptomatteNames, ChannelsArePairsInLayersOfFour) {
  const auto channels = findOutput("cryptomatte_object")->channelNames();
  ASSERT_EQ(channels.size(), size_t(kCryptomatteChannels));
  EXPECT_EQ(channels.front(), "crypto_object00.R");
  EXPECT_EQ(channels[5], "crypto_object01.G");
  EXPECT_EQ(channels.back(), "crypto_object02.A");
  EXPECT_EQ(findOutput("cryptomatte_material")->channelNames().back(), "crypto_material02.A");
}

TEST(CryptomatteNames, DifferentNamesOfOneIdAreTold) {
  EXPECT_EQ(cryptomatteCollisions({"a", "b", "a"}), "");
  EXPECT_EQ(cryptomatteCollisions({"ball112595", "x", "ball23993", "ball112595"}), "names 'ball112595' and 'ball23993' have one id");
  EXPECT_EQ(cryptomatteCollisions({"ball23993", "ball112595", "ball112595"}), "names 'ball23993' and 'ball112595' have one id") << "once";
}

TEST(CryptomatteNames, RaysAreThoseOfTheSamplesWithinBounds) {
  const auto of = [](uint32_t spp, uint32_t slices = 1) { return cryptomatteSamples(passesFor(spp), slices); };
  EXPECT_EQ(of(1), 16);
  EXPECT_EQ(of(16), 16);
  EXPECT_EQ(of(17), 32) << "as many as paths";
  EXPECT_EQ(of(100), 112);
  EXPECT_EQ(of(256), 256);
  EXPECT_EQ(of(1u << 20), kMostCryptomatteSamples);
  EXPECT_EQ(of(4, 8), 4);
  EXPECT_EQ(of(1, 8), 2) << "16 in all";
  EXPECT_EQ(of(64, 8), 32) << "256 in all";
  EXPECT_EQ(of(1, 256), 1);
  EXPECT_EQ(of(16, 12), 16);
  EXPECT_EQ(of(64, 12), 22);
  for (const uint32_t slices : {1u, 3u, 16u})  // where more would change nothing none are waited for
    for (uint32_t spp = 1; spp <= 512; spp *= 2)
      if (!cryptomatteTakesMore(passesFor(spp), slices)) { EXPECT_EQ(of(spp, slices), of(1u << 20, slices)) << spp << " of " << slices; }
  EXPECT_TRUE(cryptomatteTakesMore(passesFor(128), 1));
  EXPECT_FALSE(cryptomatteTakesMore(passesFor(256), 1));
  EXPECT_TRUE(cryptomatteTakesMore(passesFor(8), 16));
  EXPECT_FALSE(cryptomatteTakesMore(passesFor(16), 16));
}

}  // namespace
}  // namespace gobo::cryptomatte_names_test
