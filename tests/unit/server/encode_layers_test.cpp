// SPDX-License-Identifier: Apache-2.0
// Multi-layer files as the server makes them: what is in them, and that equal pictures are equal bytes.
#include <gtest/gtest.h>

#include <google/protobuf/struct.pb.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/image_io.h"
#include "plan/outputs.h"
#include "server/encode.h"
#include "support/engines.h"

namespace gobo::encode_layers_test {
namespace {

using namespace testing;

v1::RenderRequest layersRequest(const char* outputs) {
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 16);
  set(r, std::string("outputs=") + outputs);
  set(r, "encoding.layers=true");
  for (const char* e :
       {"lights.b.kind=POINT", "lights.b.position=1,3,1", "lights.b.intensity=3", "lights.a.kind=POINT", "lights.a.position=-1,3,1", "lights.a.intensity=2"})
    set(r, e);
  return r;
}

std::vector<uint8_t> fileOf(RenderResult& result) {
  auto images = encodeImages(result);
  EXPECT_TRUE(images.ok()) << images.status().toString();
  EXPECT_EQ(images->size(), 1u);
  return images.ok() && !images->empty() ? (*images)[0].bytes.copy() : std::vector<uint8_t>{};
}

Image layer(const std::vector<uint8_t>& bytes, const std::string& name) {
  const auto image = readExrLayer(bytes.data(), bytes.size(), "x.exr", name);
  EXPECT_TRUE(image.ok()) << image.status().toString();
  return image.ok() ? *image : Image(1, 1, 1);
}

const char* kAll = "beauty,albedo,normal,position,depth,alpha,object_id,material_id,motion,sample_count,variance,diffuse,specular,group:a,visibility:b";

TEST(EncodeLayers, EveryOutputIsALayer) {
  const auto engine = makeEngine();
  RenderResult result = mustRender(*engine, layersRequest(kAll));
  const auto bytes = fileOf(result);
  ASSERT_EQ(result.reply.images_size(), 1);
  EXPECT_EQ(result.reply.images(0).output(), "layers");
  for (const RenderedImage& i : result.images) {
    const Image back = layer(bytes, i.output == "beauty" ? "" : i.output);
    EXPECT_EQ(back.data, i.image().data) << i.output;
    EXPECT_EQ(back.names, findOutput(i.output)->channelNames()) << i.output;
  }
  std::vector<std::string> channels(result.reply.images(0).channels().begin(), result.reply.images(0).channels().end());
  for (const char* c : {"R", "albedo.R", "normal.X", "depth.Z", "object_id.X", "group_a.B"})
    EXPECT_NE(std::find(channels.begin(), channels.end(), c), channels.end()) << c;
}

TEST(EncodeLayers, HeaderTellsWhatMadeIt) {
  const auto engine = makeEngine();
  v1::RenderRequest r = layersRequest(kAll);
  r.mutable_certificate()->set_spp(16);
  RenderResult result = mustRender(*engine, r);
  const auto bytes = fileOf(result);
  auto meta = *exrMetadata(bytes.data(), bytes.size(), "x.exr");
  for (const char* key : {"gobo:request", "gobo:request_hash", "gobo:scene_hash", "gobo:seed", "gobo:build", "gobo:plan", "gobo:certificate", "gobo:layers",
                          "gobo:object_id", "gobo:material_id"})
    EXPECT_FALSE(meta[key].empty()) << key;
  v1::RenderRequest back;  // sent again, it is the same picture
  ASSERT_TRUE(messageFromJson(meta["gobo:request"], back, "header").ok());
  const RenderResult again = mustRender(*engine, back);
  EXPECT_EQ(again.reply.request_hash(), meta["gobo:request_hash"]);
  EXPECT_EQ(firstDifference(again, result), "");
  google::protobuf::Struct names;
  ASSERT_TRUE(messageFromJson(meta["gobo:object_id"], names, "names").ok()) << meta["gobo:object_id"];
  const auto info = *engine->inspectScene("spheres");
  ASSERT_EQ(names.fields_size(), info.instance_names_size());
  for (int i = 0; i < info.instance_names_size(); ++i) EXPECT_EQ(names.fields().at(std::to_string(i)).string_value(), info.instance_names(i));
  ASSERT_TRUE(messageFromJson(meta["gobo:layers"], names, "layers").ok());
  EXPECT_EQ(names.fields().at("group_a").string_value(), "group:a");
  v1::Certificate certificate;
  ASSERT_TRUE(messageFromJson(meta["gobo:certificate"], certificate, "certificate").ok());
  EXPECT_EQ(certificate.rmse(), result.reply.certificate().rmse());
  EXPECT_EQ(certificate.ms(), 0.0);
}

TEST(EncodeLayers, SameBytesForAnyThreadsAndACacheThatIsWarm) {
  for (const char* compression : {"ZIP", "PIZ", "DWAA"}) {
    v1::RenderRequest r = layersRequest(kAll);
    set(r, std::string("encoding.compression=") + compression);
    // One engine after the other: a living one of one thread would hold the next to it.
    RenderResult a = mustRender(*makeEngine(256ull << 20, {}, 1), r);
    const auto many = makeEngine(256ull << 20, {}, 5);
    RenderResult b = mustRender(*many, r), c = mustRender(*many, r);
    const auto bytes = fileOf(a);
    EXPECT_TRUE(bytes == fileOf(b)) << compression << ": threads";
    EXPECT_TRUE(bytes == fileOf(c)) << compression << ": warm";
    r.mutable_scheduling()->set_client("another");
    RenderResult d = mustRender(*many, r);
    EXPECT_TRUE(bytes == fileOf(d)) << compression << ": who asked is no part of the picture";
  }
}

TEST(EncodeLayers, HalfAndDwaSpareDataLayers) {
  const auto engine = makeEngine();
  v1::RenderRequest r = layersRequest(kAll);
  set(r, "encoding.half=true");
  set(r, "encoding.compression=DWAB");
  RenderResult result = mustRender(*engine, r);
  const auto bytes = fileOf(result);
  for (const RenderedImage& i : result.images) {
    const OutputInfo& info = *findOutput(i.output);
    const Image back = layer(bytes, i.output == "beauty" ? "" : i.output);
    if (info.float32) { EXPECT_EQ(back.data, i.image().data) << i.output; }
    if (!info.float32 && info.lossless()) {
      for (size_t k = 0; k < back.data.size(); ++k)
        ASSERT_NEAR(back.data[k], i.image().data[k], 0x1p-11f * std::fabs(i.image().data[k]) + 0x1p-24f) << i.output;
    }
  }
}

// Pictures of shadow maps have sizes of their own: each file its own, and as the only layer.
TEST(EncodeLayers, PicturesOfShadowMaps) {
  const auto engine = makeEngine();
  v1::RenderRequest r = layersRequest("beauty,shadow_basis:a,shadow_flags:a");
  for (const char* e :
       {"encoding.layers=false", "encoding.half=true", "shadows.exponential.c=80", "shadows.exponential.classification=Z_MAX", "shadows.map.resolution=8"})
    set(r, e);
  for (const v1::Encoding::Format format : {v1::Encoding::EXR, v1::Encoding::PNG, v1::Encoding::JPEG, v1::Encoding::RAW_FLOAT}) {
    r.mutable_encoding()->set_format(format);
    RenderResult result = mustRender(*engine, r);
    const auto images = encodeImages(result);
    ASSERT_TRUE(images.ok()) << images.status().toString();
    ASSERT_EQ(images->size(), 3u);
    const auto& map = (*images)[1];
    EXPECT_EQ(map.descriptor.width(), 24u) << "six faces of 8 texels in three columns";
    EXPECT_EQ(map.descriptor.height(), 16u);
    EXPECT_EQ(map.descriptor.channels_size(), 1);
    EXPECT_EQ((*images)[2].descriptor.width(), 24u);
    if (format == v1::Encoding::RAW_FLOAT) { EXPECT_EQ(map.bytes.size(), size_t(24 * 16 * 4)); }
    if (format != v1::Encoding::EXR) continue;
    const Image back = layer(map.bytes.copy(), "");
    EXPECT_EQ(back.data, result.images[1].image().data) << "not stored as half";
    EXPECT_TRUE(std::any_of(back.data.begin(), back.data.end(), [](float v) { return v * 2048 != std::round(v * 2048); })) << "the case that half would spoil";
  }
  r = layersRequest("shadow_basis:a");
  for (const char* e : {"shadows.variance.min_variance=0", "shadows.map.resolution=4"}) set(r, e);
  RenderResult alone = mustRender(*engine, r);
  const auto bytes = fileOf(alone);
  EXPECT_EQ(layer(bytes, "shadow_basis:a").data, alone.images.at(0).image().data);
}

// A window is a place in the picture; a map has none.
TEST(EncodeLayers, MapsBesideWindowsHaveBoxesOfTheirOwn) {
  const auto engine = makeEngine();
  const auto boxOf = [](const std::vector<uint8_t>& bytes, const std::string& name) {
    const std::string key = name + std::string("\0box2i\0", 7);
    const auto at = std::search(bytes.begin(), bytes.end(), key.begin(), key.end());
    std::vector<int32_t> box(4);
    if (at != bytes.end()) std::memcpy(box.data(), &*at + key.size() + 4, 16);
    return box;
  };
  v1::RenderRequest r = layersRequest("beauty,shadow_basis:a");
  for (const char* e : {"encoding.layers=false", "shadows.variance.min_variance=0", "shadows.map.resolution=8", "window.x=4", "window.y=3", "window.width=8",
                        "window.height=5"})
    set(r, e);
  RenderResult result = mustRender(*engine, r);
  const auto images = encodeImages(result);
  ASSERT_TRUE(images.ok()) << images.status().toString();
  ASSERT_EQ(images->size(), 2u);
  const auto picture = (*images)[0].bytes.copy(), map = (*images)[1].bytes.copy();
  EXPECT_EQ(boxOf(picture, "dataWindow"), (std::vector<int32_t>{4, 3, 11, 7}));
  EXPECT_EQ(boxOf(picture, "displayWindow"), (std::vector<int32_t>{0, 0, 23, 15}));
  const auto whole = [](const RenderedImage& i) { return std::vector<int32_t>{0, 0, i.width() - 1, i.height() - 1}; };
  EXPECT_NE(result.images[1].width(), 24);
  for (const char* box : {"dataWindow", "displayWindow"}) EXPECT_EQ(boxOf(map, box), whole(result.images[1])) << box;
  for (const char* e : {"encoding.layers=true", "outputs=shadow_basis:a", "shadows.map.resolution=4"}) set(r, e);
  RenderResult alone = mustRender(*engine, r);
  const auto layers = fileOf(alone);
  for (const char* box : {"dataWindow", "displayWindow"}) EXPECT_EQ(boxOf(layers, box), whole(alone.images[0])) << box;
}

TEST(EncodeLayers, NamesThatBecomeEqualStayApart) {
  RenderResult result;
  result.reply.mutable_resolved()->mutable_encoding()->set_layers(true);
  for (const char* output : {"group:a.b", "group:a_b", "group:a.b"}) {
    auto term = std::make_shared<Term>("pixels", Domain::Pixel, Extent{4, 4, 1});
    const auto v = term->addPlane<float>("v", 3);
    std::fill(v.begin(), v.end(), output[7] == '.' ? 1.0f : 2.0f);
    result.images.emplace_back(output, term, "v", std::vector<std::string>{"R", "G", "B"});
  }
  const auto bytes = fileOf(result);
  EXPECT_EQ(layer(bytes, "group_a_b").data[0], 1.0f);
  EXPECT_EQ(layer(bytes, "group_a_b_2").data[0], 2.0f);
  EXPECT_EQ(exrLayers(bytes.data(), bytes.size(), "x")->size(), 2u);
}

// Every output has a preview within 0..1, whatever is in it; ids get colours that differ.
TEST(EncodeLayers, EveryOutputCanBeShown) {
  for (const OutputInfo& o : outputTable()) {
    const std::string name = std::string(o.name) + (o.named() ? ":x" : "");
    const int channels = int(o.channelNames().size());
    Image image(5, 2, channels);
    const float values[] = {-1.0f, 0.0f, 1.0f, 2.0f, 1e9f, -3.0f, NAN, INFINITY, 0.5f, 7.0f};
    for (size_t i = 0; i < image.pixels(); ++i)
      for (int c = 0; c < channels; ++c) image.data[i * channels + c] = values[i];
    v1::ToneMap tone;
    for (const int curve : {1, 2, 3, 4, 5}) {
      tone.set_curve(v1::ToneMap::Curve(curve));
      const DisplayImage shown = displayImage(name, image, tone);
      for (const float v : shown.image.data) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << name << " " << v;
      EXPECT_TRUE(encodePng(shown.image, {.data = shown.data, .bits = 16}).ok()) << name;
    }
  }
  Image ids(4, 1, 1);
  ids.data = {-1, 0, 1, 2};
  const Image shown = displayImage("object_id", ids, {}).image;
  EXPECT_EQ(shown.rgb(0, 0), Vec3(0.0f));
  for (int i = 1; i < 4; ++i)
    for (int j = 0; j < i; ++j) EXPECT_GT(glm::length(shown.rgb(i, 0) - shown.rgb(j, 0)), 0.1f);
}

TEST(EncodeLayers, TransferAndBitsReachTheFile) {
  Image grey(2, 1, 3);
  std::fill(grey.data.begin(), grey.data.end(), 0.18f);
  for (const auto& [transfer, want] : {std::pair{v1::Encoding::SRGB, 0.46135613}, {v1::Encoding::REC709, 0.40884811}, {v1::Encoding::LINEAR, 0.18}}) {
    auto term = std::make_shared<Term>("pixels", Domain::Pixel, Extent{2, 1, 1});
    const auto v = term->addPlane<float>("v", 3);
    std::copy(grey.data.begin(), grey.data.end(), v.begin());
    RenderResult result;
    auto& e = *result.reply.mutable_resolved()->mutable_encoding();
    e.set_format(v1::Encoding::PNG);
    e.set_png_bits(16);
    e.set_transfer(transfer);
    result.reply.mutable_resolved()->mutable_tone_map()->set_curve(v1::ToneMap::LINEAR);
    result.images.emplace_back("beauty", term, "v", std::vector<std::string>{"R", "G", "B"});
    const auto bytes = fileOf(result);
    EXPECT_NEAR(readImageFromMemory(bytes.data(), bytes.size(), "x.png")->data[0], want, 1.0 / 65535) << int(transfer);
  }
}

}  // namespace
}  // namespace gobo::encode_layers_test
