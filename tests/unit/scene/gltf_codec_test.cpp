// SPDX-License-Identifier: Apache-2.0
// Compressed glTF: the same model by other ways is the same model within what its coding keeps; damaged streams are answered.
#include <gtest/gtest.h>
#include <meshoptimizer.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "base/image_io.h"
#include "base/transfer.h"
#include "import/load.h"
#include "scene/file_source.h"

namespace gobo {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;
const fs::path kModels = "../shared/data/gltf/khronos";

class Codec : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gobo-codec-" + std::to_string(::getpid()) + "-" + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
    doc_ = Json::parse(R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"name":"n","mesh":0}],"meshes":[{"primitives":[{"attributes":{}}]}],
      "accessors":[],"bufferViews":[],"buffers":[{"uri":"data.bin"}]})");
  }
  void TearDown() override { fs::remove_all(folder_); }
  int view(const void* data, size_t size) {
    while (bin_.size() % 4) bin_.push_back(0);
    doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", bin_.size()}, {"byteLength", size}});
    bin_.insert(bin_.end(), static_cast<const uint8_t*>(data), static_cast<const uint8_t*>(data) + size);
    return int(doc_["bufferViews"].size()) - 1;
  }
  int accessor(int view, int component, const char* type, size_t count, bool normalised = false) {
    Json a = {{"bufferView", view}, {"componentType", component}, {"type", type}, {"count", count}};
    if (normalised) a["normalized"] = true;
    doc_["accessors"].push_back(a);
    return int(doc_["accessors"].size()) - 1;
  }
  Json& primitive() { return doc_["meshes"][0]["primitives"][0]; }
  Result<ScenePtr> load() {
    doc_["buffers"][0]["byteLength"] = bin_.size();
    std::ofstream(folder_ / "data.bin", std::ios::binary).write(reinterpret_cast<const char*>(bin_.data()), std::streamsize(bin_.size()));
    std::ofstream(folder_ / "a.gltf") << doc_.dump();
    return loadGltf((folder_ / "a.gltf").string());
  }
  ScenePtr mustLoad() {
    auto s = load();
    EXPECT_TRUE(s.ok()) << s.status().toString();
    return s.ok() ? *s : nullptr;
  }
  /// A buffer view whose bytes are `packed`, decoded to `stride` x `count`, with a fallback buffer that has no bytes.
  int packedView(const std::vector<uint8_t>& packed, size_t stride, size_t count, const char* mode, const char* filter) {
    const int at = view(packed.data(), packed.size());
    if (doc_["buffers"].size() == 1) doc_["buffers"].push_back({{"byteLength", 1 << 20}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}});
    Json v = {{"buffer", 1}, {"byteOffset", 0}, {"byteLength", stride * count}};
    v["extensions"]["EXT_meshopt_compression"] = {{"buffer", 0},
                                                  {"byteOffset", doc_["bufferViews"][at]["byteOffset"]},
                                                  {"byteLength", packed.size()},
                                                  {"byteStride", stride},
                                                  {"count", count},
                                                  {"mode", mode},
                                                  {"filter", filter}};
    if (std::string(mode) == "ATTRIBUTES") v["byteStride"] = stride;
    doc_["bufferViews"][at] = v;
    return at;
  }
  fs::path folder_;
  Json doc_;
  std::vector<uint8_t> bin_;
};

std::vector<uint8_t> packVertices(const void* data, size_t count, size_t stride) {
  std::vector<uint8_t> out(meshopt_encodeVertexBufferBound(count, stride));
  meshopt_encodeVertexVersion(0);
  out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), data, count, stride));
  return out;
}

TEST_F(Codec, MeshoptViewsAndFiltersDecode) {
  constexpr size_t n = 100;
  std::vector<Vec3> positions, normals;
  std::vector<uint32_t> corners;
  for (size_t i = 0; i < n; ++i) {
    positions.push_back(Vec3(float(i % 10), std::sin(float(i)), float(i / 10)));
    normals.push_back(glm::normalize(Vec3(std::cos(float(i)), std::sin(float(i)), 0.3f + 0.01f * float(i))));
    if (i >= 2) corners.insert(corners.end(), {uint32_t(i - 2), uint32_t(i - 1), uint32_t(i)});
  }
  std::vector<uint8_t> oct(n * 8), exponents(n * 12);
  std::vector<Vec4> four;
  for (const Vec3& v : normals) four.push_back(Vec4(v, 0));
  meshopt_encodeFilterOct(oct.data(), n, 8, 16, &four[0].x);
  meshopt_encodeFilterExp(exponents.data(), n, 12, 20, &positions[0].x);
  std::vector<uint8_t> indices(meshopt_encodeIndexBufferBound(corners.size(), n));
  indices.resize(meshopt_encodeIndexBuffer(indices.data(), indices.size(), corners.data(), corners.size()));
  doc_["extensionsUsed"] = doc_["extensionsRequired"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
  primitive()["attributes"]["POSITION"] = accessor(packedView(packVertices(exponents.data(), n, 12), 12, n, "ATTRIBUTES", "EXPONENTIAL"), 5126, "VEC3", n);
  primitive()["attributes"]["NORMAL"] = accessor(packedView(packVertices(oct.data(), n, 8), 8, n, "ATTRIBUTES", "OCTAHEDRAL"), 5122, "VEC3", n, true);
  primitive()["indices"] = accessor(packedView(indices, 4, corners.size(), "TRIANGLES", "NONE"), 5125, "SCALAR", corners.size());
  const ScenePtr s = mustLoad();
  ASSERT_TRUE(s);
  const Mesh& m = *s->meshes[0];
  ASSERT_EQ(m.indices.size(), corners.size());
  for (size_t i = 0; i < n; ++i) {
    EXPECT_LT(glm::length(m.positions[i] - positions[i]), 1e-4f) << i;  // 20 bits
    EXPECT_LT(glm::length(m.normals[i] - normals[i]), 3e-4f) << i;      // 16 bits octahedral
  }
  for (size_t k = 0; k < corners.size(); k += 3) {  // the coder may turn a triangle's corners
    std::set<uint32_t> a(&corners[k], &corners[k] + 3), b(m.indices.begin() + k, m.indices.begin() + k + 3);
    EXPECT_EQ(a, b);
  }
  const Json good = doc_;
  const auto refused = [&](const char* key, const Json& value) {
    doc_ = good;
    doc_["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value;
    const auto bad = load();
    ASSERT_FALSE(bad.ok()) << key;
    EXPECT_NE(bad.status().location().find("#/bufferViews/0/extensions/EXT_meshopt_compression"), std::string::npos) << bad.status().toString();
  };
  refused("count", 1u << 31);
  refused("byteStride", 6);
  refused("byteLength", 7);
  refused("mode", "STRIPS");
  refused("filter", "QUATERNION");
  // A few bytes cannot ask for much memory.
  doc_ = good;
  doc_["bufferViews"][0]["byteLength"] = uint64_t(12) << 27;
  doc_["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]["count"] = 1u << 27;
  EXPECT_NE(load().status().message().find("cannot hold"), std::string::npos) << load().status().toString();
}

TEST_F(Codec, GpuInstancesShareTheMesh) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, places[] = {1, 0, 0, 0, 2, 0}, sizes[] = {1, 1, 1, 3, 3, 3};
  const int8_t turns[] = {0, 0, 0, 127, 0, 0, 90, 90};  // normalised: identity, and 90 degrees about z
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  const int t = accessor(view(places, sizeof places), 5126, "VEC3", 2), r = accessor(view(turns, sizeof turns), 5120, "VEC4", 2, true),
            s = accessor(view(sizes, sizeof sizes), 5126, "VEC3", 2);
  doc_["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", t}, {"ROTATION", r}, {"SCALE", s}};
  doc_["nodes"][0]["translation"] = {0, 0, 10};
  doc_["extensionsUsed"] = doc_["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
  const ScenePtr scene = mustLoad();
  ASSERT_TRUE(scene);
  ASSERT_EQ(scene->instances.size(), 2u);
  EXPECT_EQ(scene->meshes.size(), 1u);
  EXPECT_EQ(scene->instances[0].name, "n");
  EXPECT_EQ(scene->instances[1].name, "n#2");
  EXPECT_EQ(Vec3(scene->instances[0].toWorld * Vec4(1, 0, 0, 1)), Vec3(2, 0, 10));
  EXPECT_LT(glm::length(Vec3(scene->instances[1].toWorld * Vec4(1, 0, 0, 1)) - Vec3(0, 5, 10)), 1e-5f);
  doc_["accessors"][size_t(s)]["count"] = 1;
  EXPECT_NE(load().status().message().find("differ in number"), std::string::npos);
}

TEST_F(Codec, WebpPicturesAndBasisFallback) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  primitive()["material"] = 0;
  // 8 x 8, green (0, 255, 0), lossy.
  const unsigned char green[] = {0x52, 0x49, 0x46, 0x46, 0x44, 0x00, 0x00, 0x00, 0x57, 0x45, 0x42, 0x50, 0x56, 0x50, 0x38, 0x20, 0x38, 0x00, 0x00,
                                 0x00, 0x50, 0x02, 0x00, 0x9d, 0x01, 0x2a, 0x08, 0x00, 0x08, 0x00, 0x00, 0x00, 0x00, 0x25, 0xa0, 0x02, 0x74, 0xba,
                                 0x01, 0xf8, 0x01, 0xfa, 0x01, 0xfc, 0x00, 0x07, 0x90, 0x00, 0xfe, 0xfb, 0x0f, 0x8b, 0xff, 0xee, 0x94, 0x25, 0xc9,
                                 0x9a, 0x6e, 0x7f, 0xfb, 0xa5, 0x0f, 0xff, 0xe9, 0xea, 0x93, 0x67, 0xc9, 0x31, 0x97, 0xff, 0xa7, 0x71, 0x00, 0x00};
  Image red(8, 8, 3);
  for (size_t i = 0; i < red.data.size(); i += 3) red.data[i] = 1;
  const auto png = encodePng(red);
  ASSERT_TRUE(png.ok());
  ASSERT_TRUE(writeFileAtomic(folder_ / "green.webp", green, sizeof green).ok());
  ASSERT_TRUE(writeFileAtomic(folder_ / "red.png", png->data(), png->size()).ok());
  doc_["images"] = Json::parse(R"([{"uri":"green.webp"},{"uri":"red.png"},{"uri":"absent.ktx2"}])");
  doc_["textures"] =
      Json::parse(R"([{"source":1,"extensions":{"EXT_texture_webp":{"source":0}}},{"source":1,"extensions":{"KHR_texture_basisu":{"source":2}}}])");
  doc_["materials"] = Json::parse(R"([{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])");
  doc_["extensionsUsed"] = {"EXT_texture_webp"};
  ScenePtr s = mustLoad();
  ASSERT_TRUE(s);
  ASSERT_TRUE(s->materials[0].albedo.texture.valid());
  Vec4 c = s->textures[s->materials[0].albedo.texture.texture]->sample(Vec2(0.5f));
  EXPECT_GT(c.y, 0.8f);
  EXPECT_LT(c.x, 0.1f);
  doc_["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 1;
  s = mustLoad();
  ASSERT_TRUE(s && s->materials[0].albedo.texture.valid());
  EXPECT_GT(s->textures[s->materials[0].albedo.texture.texture]->sample(Vec2(0.5f)).x, 0.9f);
  EXPECT_TRUE(std::any_of(s->warnings.begin(), s->warnings.end(),
                          [](const std::string& w) { return w.find("/textures/1/extensions/KHR_texture_basisu") != std::string::npos; }));
}

// Two texels, lossless: (200, 100, 50, 128) and (10, 20, 30, 0).
constexpr uint8_t kWebpWithAlpha[] = {0x52, 0x49, 0x46, 0x46, 0x1c, 0x00, 0x00, 0x00, 0x57, 0x45, 0x42, 0x50, 0x56, 0x50, 0x38, 0x4c, 0x10, 0x00,
                                      0x00, 0x00, 0x2f, 0x01, 0x00, 0x00, 0x10, 0x38, 0x05, 0xd9, 0x15, 0x90, 0xef, 0x21, 0x33, 0x80, 0xf1, 0x00};

TEST_F(Codec, WebpColoursAreApartFromAlpha) {
  const int want[8] = {200, 100, 50, 128, 10, 20, 30, 0};
  const auto picture = readImageFromMemory(kWebpWithAlpha, sizeof kWebpWithAlpha, "a.webp");
  ASSERT_TRUE(picture.ok()) << picture.status().toString();
  ASSERT_EQ(picture->width, 2);
  ASSERT_EQ(picture->height, 1);
  ASSERT_EQ(picture->channels, 4);
  for (size_t i = 0; i < 8; ++i) EXPECT_FLOAT_EQ(picture->data[i] * 255.0f, float(want[i])) << i;
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  primitive()["material"] = 0;
  ASSERT_TRUE(writeFileAtomic(folder_ / "a.webp", kWebpWithAlpha, sizeof kWebpWithAlpha).ok());
  doc_["images"] = Json::parse(R"([{"uri":"a.webp"}])");
  doc_["textures"] = Json::parse(R"([{"extensions":{"EXT_texture_webp":{"source":0}}}])");
  doc_["materials"] = Json::parse(R"([{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])");
  doc_["extensionsUsed"] = doc_["extensionsRequired"] = {"EXT_texture_webp"};
  const ScenePtr s = mustLoad();
  ASSERT_TRUE(s && s->materials[0].albedo.texture.valid());
  const Texture& texture = *s->textures[s->materials[0].albedo.texture.texture];
  for (int i = 0; i < 2; ++i) {
    const Vec4 texel = texture.sample(Vec2(0.25f + 0.5f * float(i), 0.5f));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(texel[c], decodeTransfer(Transfer::Srgb, want[4 * i + c] / 255.0), 1e-4) << i << " " << c;
    EXPECT_NEAR(texel.w, want[4 * i + 3] / 255.0, 1e-6) << i;
  }
}

TEST_F(Codec, WebpIsRefusedWhereItIsDamagedAnimatedOrTooLarge) {
  const auto code = [](const uint8_t* bytes, size_t size, const ReadLimits& limits = {}) {
    return readImageFromMemory(bytes, size, "a.webp", limits).status().code();
  };
  for (size_t n = 0; n < sizeof kWebpWithAlpha; ++n) EXPECT_EQ(code(kWebpWithAlpha, n), Code::InvalidArgument) << n;
  ReadLimits limits;
  limits.maxDimension = 1;
  EXPECT_EQ(code(kWebpWithAlpha, sizeof kWebpWithAlpha, limits), Code::ResourceExhausted);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  limits = {};
  limits.stop = stop.token();
  EXPECT_EQ(code(kWebpWithAlpha, sizeof kWebpWithAlpha, limits), Code::Cancelled);
  // 2 x 1, two pictures.
  const uint8_t animated[] = {0x52, 0x49, 0x46, 0x46, 0x80, 0x00, 0x00, 0x00, 0x57, 0x45, 0x42, 0x50, 0x56, 0x50, 0x38, 0x58, 0x0a, 0x00, 0x00, 0x00,
                              0x02, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x41, 0x4e, 0x49, 0x4d, 0x06, 0x00, 0x00, 0x00, 0xff, 0xff,
                              0xff, 0xff, 0x00, 0x00, 0x41, 0x4e, 0x4d, 0x46, 0x28, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x00,
                              0x00, 0x00, 0x00, 0x00, 0x64, 0x00, 0x00, 0x02, 0x56, 0x50, 0x38, 0x4c, 0x0f, 0x00, 0x00, 0x00, 0x2f, 0x01, 0x00, 0x00,
                              0x00, 0x38, 0x05, 0xd9, 0x28, 0xdc, 0x43, 0xa6, 0xff, 0x51, 0x01, 0x00, 0x41, 0x4e, 0x4d, 0x46, 0x24, 0x00, 0x00, 0x00,
                              0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x64, 0x00, 0x00, 0x00, 0x56, 0x50, 0x38, 0x4c,
                              0x0c, 0x00, 0x00, 0x00, 0x2f, 0x00, 0x00, 0x00, 0x00, 0x28, 0x59, 0x91, 0x2b, 0xd3, 0xff, 0x00};
  const Status moves = readImageFromMemory(animated, sizeof animated, "a.webp").status();
  EXPECT_EQ(moves.code(), Code::InvalidArgument);
  EXPECT_NE(moves.message().find("animated"), std::string::npos) << moves.toString();
}

TEST_F(Codec, MaterialExtensionsArriveInTheirFields) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  primitive()["material"] = 0;
  doc_["materials"] =
      Json::parse(R"([{"extensions":{"KHR_materials_ior":{"ior":0},"KHR_materials_specular":{"specularFactor":0.4,"specularColorFactor":[1,2,0.5]},
    "KHR_materials_transmission":{"transmissionFactor":0.9},"KHR_materials_volume":{"thicknessFactor":2,"attenuationDistance":3,"attenuationColor":[0.1,0.2,0.3]},
    "KHR_materials_volume_scatter":{"multiscatterColor":[0.5,0.6,0.7],"scatterAnisotropy":-0.25},"KHR_materials_dispersion":{"dispersion":0.3},
    "KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.35,"diffuseTransmissionColorFactor":[0.2,0.3,0.4]},
    "KHR_materials_clearcoat":{"clearcoatFactor":0.8,"clearcoatRoughnessFactor":0.15},"KHR_materials_sheen":{"sheenColorFactor":[0.3,0.2,0.1],"sheenRoughnessFactor":0.45},
    "KHR_materials_anisotropy":{"anisotropyStrength":0.6,"anisotropyRotation":1.2},"KHR_materials_iridescence":{"iridescenceFactor":0.7,"iridescenceIor":1.8,
    "iridescenceThicknessMinimum":200,"iridescenceThicknessMaximum":500},"KHR_materials_unlit":{}}},
    {"extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0.1,0.2,0.3,1],"specularFactor":[0.4,0.5,0.6],"glossinessFactor":0.75}}},{}])");
  const ScenePtr s = mustLoad();
  ASSERT_TRUE(s);
  const Bsdf& b = s->materials[0].bsdf;
  EXPECT_GT(b.ior, 1e5f);
  EXPECT_EQ(b.specular, 0.4f);
  EXPECT_EQ(b.specularColor, Vec3(1, 2, 0.5f));
  EXPECT_EQ(b.transmission, 0.9f);
  EXPECT_EQ(b.thickness, 2.0f);
  EXPECT_EQ(b.attenuationDistance, 3.0f);
  EXPECT_EQ(b.attenuationColor, Vec3(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(b.scatterAlbedo, Vec3(0.5f, 0.6f, 0.7f));
  EXPECT_EQ(b.scatterAnisotropy, -0.25f);
  EXPECT_EQ(b.dispersion, 0.3f);
  EXPECT_EQ(b.diffuseTransmission, 0.35f);
  EXPECT_EQ(b.diffuseTransmissionColor, Vec3(0.2f, 0.3f, 0.4f));
  EXPECT_EQ(b.clearcoat, 0.8f);
  EXPECT_EQ(b.clearcoatRoughness, 0.15f);
  EXPECT_EQ(b.sheenColor, Vec3(0.3f, 0.2f, 0.1f));
  EXPECT_EQ(b.sheenRoughness, 0.45f);
  EXPECT_EQ(b.anisotropy, 0.6f);
  EXPECT_EQ(b.anisotropyRotation, 1.2f);
  EXPECT_EQ(b.iridescence, 0.7f);
  EXPECT_EQ(b.iridescenceIor, 1.8f);
  EXPECT_EQ(b.iridescenceThicknessMin, 200.0f);
  EXPECT_EQ(b.iridescenceThicknessMax, 500.0f);
  EXPECT_TRUE(b.unlit);
  const Material& glossy = s->materials[1];
  EXPECT_EQ(glossy.albedo.factor, Vec3(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(glossy.bsdf.metallic, 0.0f);
  EXPECT_EQ(glossy.bsdf.roughness, 0.25f);
  const float f0 = sqr((glossy.bsdf.ior - 1) / (glossy.bsdf.ior + 1));
  EXPECT_LT(glm::length(f0 * glossy.bsdf.specularColor - Vec3(0.4f, 0.5f, 0.6f)), 1e-4f) << "F0 is the specular colour";
  EXPECT_FALSE(s->materials[2].bsdf.unlit);
  EXPECT_EQ(s->materials[2].bsdf.attenuationDistance, 0.0f);
}

/// KHR_materials_unlit: the colour is the base colour alone, so the surface is no light either.
TEST_F(Codec, UnlitMaterialsEmitNothing) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  primitive()["material"] = 0;
  doc_["extensionsUsed"] = {"KHR_materials_unlit"};
  doc_["materials"] = Json::parse(R"([{"emissiveFactor":[1,0,0],"pbrMetallicRoughness":{"baseColorFactor":[0.2,0.3,0.4,1]}}])");
  const ScenePtr lit = mustLoad();
  ASSERT_TRUE(lit);
  EXPECT_GE(lit->findLight("n"), 0);
  const std::string said = "/materials/0/emissiveFactor: an unlit material shows its base colour alone; its emission is ignored";
  const auto times = [&](const Scene& scene) { return std::count(scene.warnings.begin(), scene.warnings.end(), said); };
  EXPECT_EQ(times(*lit), 0);
  doc_["materials"][0]["extensions"]["KHR_materials_unlit"] = Json::object();
  const ScenePtr unlit = mustLoad();
  ASSERT_TRUE(unlit);
  EXPECT_TRUE(unlit->materials[0].bsdf.unlit);
  EXPECT_FALSE(unlit->materials[0].emits());
  EXPECT_EQ(unlit->materials[0].albedo.factor, Vec3(0.2f, 0.3f, 0.4f));
  EXPECT_EQ(unlit->findLight("n"), -1) << "its mesh is no light";
  EXPECT_EQ(times(*unlit), 1);
  doc_["materials"][0]["emissiveFactor"] = {0, 0, 0};
  EXPECT_EQ(times(*mustLoad()), 0) << "nothing to ignore";
}

/// Files of a folder; what the loader said it was about to parse.
struct WatchedFiles final : FileSource {
  explicit WatchedFiles(const std::string& path) : disk(path) {}
  Result<std::vector<uint8_t>> main(uint64_t maxBytes) override { return disk.main(maxBytes); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t maxBytes) override { return disk.beside(name, maxBytes); }
  void parsing(const std::string& place) override { places.push_back(place); }
  DiskFiles disk;
  std::vector<std::string> places;
};

/// What ends the load later is not to be blamed on a picture that was left out.
TEST_F(Codec, DamagedPicturesAreNotBlamedForWhatFollows) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  primitive()["attributes"]["POSITION"] = accessor(view(quad, sizeof quad), 5126, "VEC3", 3);
  primitive()["material"] = 0;
  const char damaged[] = "\x89PNG\r\n\x1a\nxxxxxxxxxxxx";
  ASSERT_TRUE(writeFileAtomic(folder_ / "bad.png", damaged, sizeof damaged - 1).ok());
  doc_["images"] = Json::parse(R"([{"uri":"bad.png"}])");
  doc_["textures"] = Json::parse(R"([{"source":0}])");
  doc_["materials"] = Json::parse(R"([{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])");
  ASSERT_TRUE(mustLoad());  // writes the files
  WatchedFiles files((folder_ / "a.gltf").string());
  LoadOptions options;
  options.files = &files;
  const auto s = loadGltf((folder_ / "a.gltf").string(), options);
  ASSERT_TRUE(s.ok()) << s.status().toString();
  EXPECT_FALSE((*s)->materials[0].albedo.texture.valid());
  EXPECT_EQ(std::count(files.places.begin(), files.places.end(), "/images/0"), 1);
  ASSERT_FALSE(files.places.empty());
  EXPECT_EQ(files.places.back(), "");
}

/// The largest skin is the measure, wherever it stands and however many primitives ask.
TEST_F(Codec, JointsBeyondEverySkinAreNamed) {
  const float quad[] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, all[] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, one[] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const uint8_t within[] = {0, 2, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0}, beyond[] = {0, 3, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0};  // the second has no weight
  std::vector<float> binds;
  for (int joint = 0; joint < 3; ++joint) binds.insert(binds.end(), std::begin(one), std::end(one));
  const int positions = accessor(view(quad, sizeof quad), 5126, "VEC3", 3), weights = accessor(view(all, sizeof all), 5126, "VEC4", 3),
            inverse = accessor(view(binds.data(), binds.size() * 4), 5126, "MAT4", 3), single = accessor(view(one, sizeof one), 5126, "MAT4", 1);
  const int joints[] = {accessor(view(within, sizeof within), 5121, "VEC4", 3), accessor(view(beyond, sizeof beyond), 5121, "VEC4", 3)};
  doc_["meshes"][0]["primitives"] = Json::array();
  for (const int j : joints) doc_["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", positions}, {"JOINTS_0", j}, {"WEIGHTS_0", weights}}}});
  doc_["nodes"] = Json::parse(R"([{"name":"n","mesh":0,"skin":1},{"children":[2,3]},{},{}])");
  doc_["scenes"][0]["nodes"] = {0, 1};
  doc_["skins"] = Json::parse(R"([{"joints":[1]},{"joints":[1,2,3]},{"joints":[2]}])");
  doc_["skins"][0]["inverseBindMatrices"] = doc_["skins"][2]["inverseBindMatrices"] = single;
  doc_["skins"][1]["inverseBindMatrices"] = inverse;
  const ScenePtr s = mustLoad();
  ASSERT_TRUE(s);
  std::vector<std::string> said;
  for (const std::string& w : s->warnings)
    if (w.find("JOINTS_0") != std::string::npos) said.push_back(w);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0], "/meshes/0/primitives/1/attributes/JOINTS_0: 2 joints without weight are out of range of every skin");
}

float farthest(const Mesh& a, const Mesh& b) {
  // Corner by corner; coders reorder triangles, so each corner of one is looked for among all of the other.
  std::multimap<float, Vec3> byX;
  for (const uint32_t i : b.indices) byX.emplace(b.positions[i].x, b.positions[i]);
  float worst = 0;
  for (const uint32_t i : a.indices) {
    const Vec3 p = a.positions[i];
    float best = 1e30f;
    for (auto it = byX.lower_bound(p.x - 1.0f); it != byX.end() && it->first < p.x + 1.0f; ++it) best = std::fmin(best, glm::length(it->second - p));
    worst = std::fmax(worst, best);
  }
  return worst;
}

TEST(Ducks, DracoAndQuantizedAreThePlainOne) {
  if (!fs::exists(kModels / "Duck")) GTEST_SKIP() << "../shared/data/gltf/khronos is absent";
  const auto plain = loadGltf((kModels / "Duck/glTF/Duck.gltf").string()), packed = loadGltf((kModels / "Duck/glTF-Draco/Duck.gltf").string()),
             small = loadGltf((kModels / "Duck/glTF-Quantized/Duck.gltf").string());
  ASSERT_TRUE(plain.ok() && packed.ok() && small.ok());
  Vec3 lo, hi, lo2, hi2;
  (*plain)->bounds(lo, hi);
  const float size = glm::length(hi - lo);
  for (const auto& other : {*packed, *small}) {
    EXPECT_EQ(other->triangleCount(), (*plain)->triangleCount());
    other->bounds(lo2, hi2);
    EXPECT_LT(glm::length(lo - lo2) + glm::length(hi - hi2), 2e-3f * size);
    EXPECT_TRUE(other->warnings.empty()) << other->warnings[0];
  }
  const Mesh &a = *(*plain)->meshes[0], &b = *(*packed)->meshes[0];
  Vec3 extent(0.0f);
  for (const Vec3& p : a.positions) extent = glm::max(extent, glm::abs(p));
  EXPECT_LT(farthest(a, b), 2e-3f * glm::length(extent));
  EXPECT_LT(farthest(b, a), 2e-3f * glm::length(extent));
}

TEST_F(Codec, DamagedDracoIsAnswered) {
  const fs::path from = kModels / "Box/glTF-Draco";
  if (!fs::exists(from)) GTEST_SKIP() << "../shared/data/gltf/khronos is absent";
  std::ifstream in(from / "Box.bin", std::ios::binary);
  const std::vector<char> good((std::istreambuf_iterator<char>(in)), {});
  fs::copy_file(from / "Box.gltf", folder_ / "Box.gltf");
  size_t refused = 0;
  for (size_t at = 0; at < good.size(); ++at) {
    std::vector<char> bad = good;
    bad[at] = char(bad[at] ^ 0xff);
    std::ofstream(folder_ / "Box.bin", std::ios::binary).write(bad.data(), std::streamsize(bad.size()));
    const auto s = loadGltf((folder_ / "Box.gltf").string());
    refused += !s.ok();
    EXPECT_TRUE(s.ok() || !s.status().location().empty());
  }
  EXPECT_GT(refused, 10u);
}

}  // namespace
}  // namespace gobo
