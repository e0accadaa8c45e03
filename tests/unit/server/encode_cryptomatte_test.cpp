// SPDX-License-Identifier: Apache-2.0
// Files of mattes: every bit of ids, whatever the encoding says of halves and loss; attributes beside the channels that they are of; false colours.
#include <gtest/gtest.h>

#include <ImfChannelList.h>
#include <ImfHeader.h>
#include <ImfMultiPartInputFile.h>
#include <ImfStringAttribute.h>

#include <bit>
#include <cstring>
#include <map>

#include "base/exr_streams.h"
#include "base/image_io.h"
#include "plan/outputs.h"
#include "server/encode.h"
#include "support/engines.h"
#include "terms/cryptomatte.h"

namespace gobo::encode_cryptomatte_test {
namespace {

using namespace testing;

RenderResult rendered(const std::vector<std::string>& edits) {
  static const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 16);
  for (const std::string& e : edits) set(r, e);
  return mustRender(*engine, r);
}

std::vector<EncodedImage> encoded(RenderResult& result) {
  auto images = encodeImages(result);
  EXPECT_TRUE(images.ok()) << images.status().toString();
  return images.ok() ? std::move(*images) : std::vector<EncodedImage>{};
}

/// Attributes of each part that begin with "cryptomatte/", and its channels with their types.
struct PartSeen {
  std::map<std::string, std::string> attributes;
  std::map<std::string, Imf::PixelType> channels;
  Imf::Compression compression;
};
std::vector<PartSeen> partsOf(const PictureBytes& bytes) {
  MemoryReader stream(bytes.data(), bytes.size());
  Imf::MultiPartInputFile file(stream);
  std::vector<PartSeen> parts;
  for (int p = 0; p < file.parts(); ++p) {
    PartSeen seen;
    const Imf::Header& h = file.header(p);
    seen.compression = h.compression();
    for (auto at = h.begin(); at != h.end(); ++at)
      if (std::string(at.name()).starts_with("cryptomatte/")) seen.attributes[at.name()] = h.typedAttribute<Imf::StringAttribute>(at.name()).value();
    for (auto at = h.channels().begin(); at != h.channels().end(); ++at) seen.channels[at.name()] = at.channel().type;
    parts.push_back(std::move(seen));
  }
  return parts;
}

/// The ranks of a picture, from a file's numbered layers.
std::vector<float> ranksOf(const PictureBytes& bytes, const std::string& layer) {
  std::vector<float> out;
  for (const char* number : {"00", "01", "02"}) {
    const auto image = readExrLayer(bytes.data(), bytes.size(), "x.exr", layer + number);
    EXPECT_TRUE(image.ok()) << image.status().toString();
    if (!image.ok()) return {};
    EXPECT_EQ(image->names, (std::vector<std::string>{"R", "G", "B", "A"}));
    out.resize(image->pixels() * kCryptomatteChannels);
    for (size_t p = 0; p < image->pixels(); ++p)
      for (size_t c = 0; c < 4; ++c) out[p * kCryptomatteChannels + size_t(number[1] - '0') * 4 + c] = image->data[p * 4 + c];
  }
  return out;
}

bool sameBits(std::span<const float> a, std::span<const float> b) { return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0; }

TEST(EncodeCryptomatte, EveryEncodingKeepsEveryBitOfIds) {
  for (const char* compression : {"NONE", "RLE", "ZIPS", "ZIP", "PIZ", "DWAA", "DWAB"})
    for (const char* half : {"false", "true"})
      for (const char* layers : {"false", "true"}) {
        SCOPED_TRACE(std::string(compression) + " half " + half + " layers " + layers);
        RenderResult result = rendered({"outputs=beauty,cryptomatte_object,normal,cryptomatte_material", std::string("encoding.compression=") + compression,
                                        std::string("encoding.half=") + half, std::string("encoding.layers=") + layers});
        const auto files = encoded(result);
        const bool one = std::string(layers) == "true";
        ASSERT_EQ(files.size(), one ? 1u : 4u);
        for (const size_t k : {1u, 3u}) {
          const PictureBytes& bytes = files[one ? 0 : k].bytes;
          const std::string layer = k == 1 ? "crypto_object" : "crypto_material";
          EXPECT_TRUE(sameBits(ranksOf(bytes, layer), result.images[k].pixels())) << layer;
          for (const PartSeen& part : partsOf(bytes))
            for (const auto& [name, type] : part.channels) {
              if (!name.starts_with("crypto_")) continue;
              EXPECT_EQ(type, Imf::FLOAT) << name;
              EXPECT_TRUE(part.compression != Imf::DWAA_COMPRESSION && part.compression != Imf::DWAB_COMPRESSION) << name;
            }
        }
      }
}

TEST(EncodeCryptomatte, AttributesAreWhereTheChannelsAre) {
  RenderResult apart = rendered({"outputs=beauty,cryptomatte_object,cryptomatte_material"});
  const auto files = encoded(apart);
  ASSERT_EQ(files.size(), 3u);
  EXPECT_TRUE(partsOf(files[0].bytes).at(0).attributes.empty()) << "no channels, no manifest";
  const auto object = partsOf(files[1].bytes).at(0), material = partsOf(files[2].bytes).at(0);
  EXPECT_EQ(object.attributes.size(), 4u);
  EXPECT_EQ(object.attributes.at("cryptomatte/f834d0a/name"), "crypto_object");
  EXPECT_EQ(material.attributes.size(), 4u);
  EXPECT_EQ(material.attributes.at("cryptomatte/bda530a/name"), "crypto_material");
  EXPECT_EQ(object.channels.size(), 12u);
  EXPECT_TRUE(object.channels.count("crypto_object00.R") && object.channels.count("crypto_object02.A"));
  EXPECT_EQ(object.attributes, apart.attributes.at("cryptomatte_object"));
  RenderResult together = rendered({"outputs=beauty,cryptomatte_object,cryptomatte_material", "encoding.layers=true", "encoding.compression=DWAA"});
  const auto layers = encoded(together);
  const auto parts = partsOf(layers.at(0).bytes);
  ASSERT_EQ(parts.size(), 2u);
  for (const PartSeen& p : parts) EXPECT_EQ(p.attributes.size(), 8u) << "in the part that has them, and in the first, where most look";
  EXPECT_TRUE(parts[1].channels.count("crypto_material01.B"));
  const auto meta = *exrMetadata(layers[0].bytes.data(), layers[0].bytes.size(), "x.exr");
  EXPECT_NE(meta.at("gobo:layers").find("\"crypto_object01\":\"cryptomatte_object\""), std::string::npos) << meta.at("gobo:layers");
}

TEST(EncodeCryptomatte, ShownAsTheMeanOfColours) {
  Image image(3, 1, kCryptomatteChannels);
  std::fill(image.data.begin(), image.data.end(), 0.0f);
  const float a = std::bit_cast<float>(cryptomatteId("a")), b = std::bit_cast<float>(cryptomatteId("b"));
  image.data[0] = a, image.data[1] = 1.0f;
  image.data[12] = b, image.data[13] = 0.75f, image.data[14] = a, image.data[15] = 0.25f;
  image.data[24] = b, image.data[25] = 0.5f;
  const DisplayImage shown = displayImage("cryptomatte_object", image, {});
  EXPECT_TRUE(shown.data);
  ASSERT_EQ(shown.image.channels, 3);
  const Vec3 colour = shown.image.rgb(0, 0), other = 2.0f * shown.image.rgb(2, 0);
  EXPECT_GT(glm::length(colour - other), 0.1f);
  EXPECT_LT(glm::length(shown.image.rgb(1, 0) - (0.75f * other + 0.25f * colour)), 1e-5f);
  for (const char* format : {"PNG", "JPEG"}) {
    RenderResult result = rendered({"outputs=cryptomatte_object", std::string("encoding.format=") + format});
    const auto file = encoded(result);
    const auto back = readImageFromMemory(file.at(0).bytes.data(), file[0].bytes.size(), std::string("x.") + format);
    ASSERT_TRUE(back.ok());
    EXPECT_EQ(back->channels, 3);
    EXPECT_EQ(result.reply.images(0).channels_size(), 3);
  }
}

}  // namespace
}  // namespace gobo::encode_cryptomatte_test
