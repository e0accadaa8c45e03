// SPDX-License-Identifier: Apache-2.0
// glTF from documents made here: values read back exactly, and every class of fault answered with file, pointer and cause.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "import/load.h"

namespace gobo {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

class Gltf : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gobo-gltf-" + std::to_string(::getpid()) + "-" + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
    // 4 vertices (48 bytes), 6 u16 indices (12 bytes), 4 normals (48 bytes).
    const float positions[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, normals[] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    const uint16_t indices[] = {0, 1, 2, 0, 2, 3};
    bin_.resize(108);
    std::memcpy(bin_.data(), positions, 48);
    std::memcpy(bin_.data() + 48, indices, 12);
    std::memcpy(bin_.data() + 60, normals, 48);
    doc_ = Json::parse(R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
      "nodes":[{"name":"quad","mesh":0,"translation":[1,2,3]}],
      "meshes":[{"name":"square","primitives":[{"attributes":{"POSITION":0,"NORMAL":2},"indices":1}]}],
      "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
                   {"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"},
                   {"bufferView":2,"componentType":5126,"count":4,"type":"VEC3"}],
      "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12},{"buffer":0,"byteOffset":60,"byteLength":48}],
      "buffers":[{"byteLength":108}]})");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string writeGlb() {
    std::string text = doc_.dump();
    while (text.size() % 4) text += ' ';
    std::vector<uint8_t> bin = bin_;
    while (bin.size() % 4) bin.push_back(0);
    std::vector<uint8_t> out;
    auto word = [&](uint32_t v) {
      const auto* p = reinterpret_cast<const uint8_t*>(&v);
      out.insert(out.end(), p, p + 4);
    };
    word(0x46546c67);
    word(2);
    word(uint32_t(28 + text.size() + bin.size()));
    word(uint32_t(text.size()));
    word(0x4e4f534a);
    out.insert(out.end(), text.begin(), text.end());
    word(uint32_t(bin.size()));
    word(0x004e4942);
    out.insert(out.end(), bin.begin(), bin.end());
    return write("scene.glb", out.data(), out.size());
  }
  std::string write(const std::string& name, const void* data, size_t size) {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary).write(static_cast<const char*>(data), std::streamsize(size));
    return path;
  }
  std::string writeText(const std::string& name) {
    const std::string t = doc_.dump();
    return write(name, t.data(), t.size());
  }

  void expectRefused(const std::string& path, const std::string& pointer, const std::string& word) {
    const auto scene = loadGltf(path);
    ASSERT_FALSE(scene.ok()) << "loaded, but " << word << " was expected";
    EXPECT_EQ(scene.status().location(), path + pointer) << scene.status().toString();
    EXPECT_NE(scene.status().message().find(word), std::string::npos) << scene.status().toString();
  }
  void expectRefused(const std::string& pointer, const std::string& word) { expectRefused(writeGlb(), "#" + pointer, word); }
  ScenePtr load() {
    const auto scene = loadGltf(writeGlb());
    EXPECT_TRUE(scene.ok()) << scene.status().toString();
    return scene.ok() ? *scene : nullptr;
  }

  fs::path folder_;
  Json doc_;
  std::vector<uint8_t> bin_;
};

TEST_F(Gltf, MinimalGlbReadsBackExactly) {
  const ScenePtr s = load();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->triangleCount(), 2u);
  EXPECT_EQ(s->meshes[0]->indices, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(s->meshes[0]->positions[2], Vec3(1, 1, 0));
  EXPECT_EQ(s->instances[0].name, "quad");
  EXPECT_EQ(Vec3(s->instances[0].toWorld[3]), Vec3(1, 2, 3));
  EXPECT_EQ(s->materials[s->meshes[0]->material].bsdf.metallic, 1.0f);  // the format's default material
  EXPECT_TRUE(s->warnings.empty());
  EXPECT_EQ(s->cameras.size(), 1u);
}

TEST_F(Gltf, DataUriAndSeparateFileGiveTheSameScene) {
  const ScenePtr glb = load();
  write("my data.bin", bin_.data(), bin_.size());
  doc_["buffers"][0]["uri"] = "my%20data.bin";
  const auto separate = loadGltf(writeText("scene.gltf"));
  ASSERT_TRUE(separate.ok()) << separate.status().toString();
  EXPECT_EQ((*separate)->hash(), glb->hash());
}

TEST_F(Gltf, StripsAndFansMakeTheSameSquare) {
  const uint16_t strip[] = {0, 1, 3, 2}, fan[] = {0, 1, 2, 3};
  doc_["accessors"][1]["count"] = 4;
  for (int mode : {5, 6}) {
    std::memcpy(bin_.data() + 48, mode == 5 ? strip : fan, 8);
    doc_["meshes"][0]["primitives"][0]["mode"] = mode;
    const ScenePtr s = load();
    ASSERT_TRUE(s);
    ASSERT_EQ(s->triangleCount(), 2u) << mode;
    for (size_t t = 0; t < 6; t += 3) {  // all face +Z
      const Mesh& m = *s->meshes[0];
      const Vec3 a = m.positions[m.indices[t]], b = m.positions[m.indices[t + 1]], c = m.positions[m.indices[t + 2]];
      EXPECT_EQ(glm::cross(b - a, c - a).z, 1.0f) << mode;
    }
  }
}

TEST_F(Gltf, SparseAndNormalisedAccessors) {
  // Vertex 2 moves to (1,1,5) by a sparse accessor; colours are normalised bytes.
  const uint8_t index = 2, colours[16] = {255, 0, 51, 255};
  const float moved[] = {1, 1, 5};
  bin_.resize(112 + 16 + 12);
  bin_[108] = index;
  std::memcpy(bin_.data() + 112, moved, 12);
  std::memcpy(bin_.data() + 124, colours, 16);
  doc_["buffers"][0]["byteLength"] = bin_.size();
  for (auto [offset, length] : {std::pair{108, 1}, std::pair{112, 12}, std::pair{124, 16}})
    doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", length}});
  doc_["accessors"][0]["sparse"] = Json::parse(R"({"count":1,"indices":{"bufferView":3,"componentType":5121},"values":{"bufferView":4}})");
  doc_["accessors"].push_back({{"bufferView", 5}, {"componentType", 5121}, {"normalized", true}, {"count", 4}, {"type", "VEC4"}});
  doc_["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 3;
  const ScenePtr s = load();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->meshes[0]->positions[2], Vec3(1, 1, 5));
  EXPECT_EQ(s->meshes[0]->positions[1], Vec3(1, 0, 0));
  EXPECT_EQ(s->meshes[0]->colours[0], Vec4(1.0f, 0.0f, 51 / 255.0f, 1.0f));
  doc_["accessors"][0]["sparse"]["indices"]["byteOffset"] = 0;
  bin_[108] = 4;
  expectRefused("/accessors/0/sparse/indices", "sparse index 4 of 4");
}

TEST_F(Gltf, MaterialsLightsAndCameras) {
  doc_["materials"] = Json::parse(R"([{"name":"m","pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,0.5],"metallicFactor":0,"roughnessFactor":0.3},
    "emissiveFactor":[1,0.5,0],"alphaMode":"BLEND","doubleSided":true,"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4},
    "KHR_materials_specular":{"specularFactor":0},"KHR_materials_ior":{"ior":1.33},"KHR_materials_transmission":{"transmissionFactor":1}}}])");
  doc_["meshes"][0]["primitives"][0]["material"] = 0;
  doc_["extensionsUsed"] = {"KHR_lights_punctual"};
  doc_["extensions"] = Json::parse(
      R"({"KHR_lights_punctual":{"lights":[{"type":"spot","color":[1,0.5,0],"intensity":10,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.4}}]}})");
  doc_["cameras"] = Json::parse(
      R"([{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}},{"type":"orthographic","orthographic":{"xmag":2,"ymag":3,"znear":0,"zfar":9}}])");
  doc_["nodes"].push_back(Json::parse(
      R"({"name":"spot","translation":[0,5,0],"rotation":[-0.70710678,0,0,0.70710678],"scale":[2,2,2],"extensions":{"KHR_lights_punctual":{"light":0}}})"));
  doc_["nodes"].push_back(Json::parse(R"({"name":"eye","camera":0,"translation":[0,0,4]})"));
  doc_["nodes"].push_back(Json::parse(R"({"name":"plan","camera":1})"));
  doc_["nodes"].push_back(Json::parse(R"({"name":"panel","scale":[2,1,1],"extras":{"gobo_light":{"type":"rect","width":3,"height":4,"radiance":[1,2,3]}}})"));
  doc_["scenes"][0]["nodes"] = {0, 1, 2, 3, 4};
  const ScenePtr s = load();
  ASSERT_TRUE(s);
  const Material& m = s->materials[s->findMaterial("m")];
  EXPECT_EQ(m.albedo.factor, Vec3(0.5f, 0.25f, 0.125f));
  EXPECT_EQ(m.coverage.mode, AlphaMode::Blend);
  EXPECT_EQ(m.coverage.factor, 0.5f);
  EXPECT_EQ(m.emission.radiance, Vec3(4, 2, 0));
  EXPECT_EQ(m.bsdf.specular, 0.0f);
  EXPECT_EQ(m.bsdf.ior, 1.33f);
  EXPECT_EQ(m.bsdf.transmission, 1.0f);
  const Light& spot = s->lights[s->findLight("spot")];
  EXPECT_EQ(spot.power, Vec3(10, 5, 0));
  EXPECT_EQ(partsOf(spot).color, Vec3(1, 0.5f, 0));
  EXPECT_EQ(partsOf(spot).intensity, 10.0f);
  EXPECT_LT(glm::length(spot.shape.axis - Vec3(0, -1, 0)), 1e-6f);
  EXPECT_NEAR(spot.shape.cosOuter, std::cos(0.4), 1e-6);
  const Light& panel = s->lights[s->findLight("panel")];
  EXPECT_EQ(panel.shape.u, Vec3(3, 0, 0));
  EXPECT_EQ(panel.shape.v, Vec3(0, 2, 0));
  EXPECT_EQ(panel.shape.axis, Vec3(0, 0, -1));
  EXPECT_EQ(panel.power, Vec3(1, 2, 3));
  EXPECT_EQ(s->lights[s->findLight("quad")].shape.kind, LightKind::Mesh);
  EXPECT_EQ(s->cameras[s->findCamera("eye")].yfov, 0.7f);
  EXPECT_EQ(s->cameras[s->findCamera("plan")].yheight, 6.0f);
}

/// A scale of 0 along one axis makes a mesh flat; along more it hides it, whether or not the file has an animation.
TEST_F(Gltf, FlatNodesAreDrawn) {
  const Json good = doc_;
  const auto scaled = [&](const Json& scale, bool animated) {
    doc_ = good;
    bin_.resize(108);
    doc_["nodes"][0]["scale"] = scale;
    if (!animated) return load();
    const float keys[] = {0, 1, 0, 0, 0, 1, 0, 0};
    bin_.resize(140);
    std::memcpy(bin_.data() + 108, keys, sizeof keys);
    doc_["buffers"][0]["byteLength"] = 140;
    doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", 108}, {"byteLength", 8}});
    doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", 116}, {"byteLength", 24}});
    doc_["accessors"].push_back(Json::parse(R"({"bufferView":3,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]})"));
    doc_["accessors"].push_back(Json::parse(R"({"bufferView":4,"componentType":5126,"count":2,"type":"VEC3"})"));
    doc_["nodes"].push_back(Json::object({{"name", "other"}}));
    doc_["animations"] = Json::parse(R"([{"samplers":[{"input":3,"output":4}],"channels":[{"sampler":0,"target":{"node":1,"path":"translation"}}]}])");
    return load();
  };
  const Json scales[] = {{2, 2, 0}, {0, 2, 3}, {2, 0, 3}};
  for (const Json& scale : scales) {
    const ScenePtr still = scaled(scale, false), moving = scaled(scale, true);
    ASSERT_TRUE(still && moving);
    EXPECT_TRUE(still->warnings.empty()) << scale << still->warnings[0];
    ASSERT_EQ(still->instances.size(), 1u) << scale;
    ASSERT_EQ(moving->instances.size(), 1u) << scale;
    const Mat4& m = still->instances[0].toWorld;
    EXPECT_EQ(m, moving->instances[0].toWorld) << scale;
    EXPECT_GT(std::fabs(glm::determinant(Mat3(m))), 0.0f) << scale;
    const Vec3 given(scale[0].get<float>(), scale[1].get<float>(), scale[2].get<float>());
    EXPECT_LT(glm::length(Vec3(m * Vec4(1, 1, 1, 1)) - (Vec3(1, 2, 3) + given)), 1e-5f) << scale;
  }
  // Flattened by its parent across its own axes: none of them is 0, and it is flat all the same.
  doc_ = good;
  bin_.resize(108);
  doc_["nodes"][0]["rotation"] = {0.0, 0.38268343, 0.0, 0.92387953};
  doc_["nodes"].push_back(Json::parse(R"({"name":"press","scale":[1,1,0],"children":[0]})"));
  doc_["scenes"][0]["nodes"] = {1};
  const ScenePtr pressed = load();
  ASSERT_TRUE(pressed);
  EXPECT_TRUE(pressed->warnings.empty());
  ASSERT_EQ(pressed->instances.size(), 1u);
  EXPECT_LT(glm::length(Vec3(pressed->instances[0].toWorld * Vec4(1, 1, 0, 1)) - Vec3(1 + std::sqrt(0.5f), 3, 0)), 1e-5f);

  const Json hidden[] = {{2, 0, 0}, {0, 0, 3}, {0, 0, 0}};
  for (const Json& scale : hidden) {
    const ScenePtr still = scaled(scale, false), moving = scaled(scale, true);
    ASSERT_TRUE(still && moving);
    EXPECT_TRUE(still->instances.empty()) << scale;
    ASSERT_FALSE(still->warnings.empty()) << scale;
    EXPECT_EQ(still->warnings[0].find("/nodes/0: "), 0u) << still->warnings[0];
    ASSERT_EQ(moving->instances.size(), 1u) << scale << ": it may grow";
    EXPECT_LT(glm::length(Vec3(moving->instances[0].toWorld[0])), 1e-6f) << scale;
  }
}

/// KHR_lights_punctual: of the node's transform only place and direction count. A camera without a direction is left out, an area light without
/// an area is dark; a warning says either.
TEST_F(Gltf, PointLightsDoNotMindScale) {
  doc_["extensionsUsed"] = Json::array({"KHR_lights_punctual"});
  doc_["extensions"]["KHR_lights_punctual"]["lights"] = Json::parse(R"([{"type":"point","intensity":10},{"type":"spot","intensity":10,"spot":{}}])");
  doc_["cameras"] = Json::parse(R"([{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}])");
  const char* names[] = {"point", "spot"};
  for (int light = 0; light < 2; ++light) {
    Json node = {{"name", names[light]}, {"translation", {4, 5, 6}}, {"rotation", {0.70710678, 0, 0, 0.70710678}}};
    node["extensions"]["KHR_lights_punctual"]["light"] = light;
    doc_["nodes"].push_back(node);
  }
  doc_["nodes"].push_back(Json::parse(R"({"name":"panel","extras":{"gobo_light":{"type":"rect","radiance":[1,2,3]}}})"));
  doc_["nodes"].push_back(Json::parse(R"({"name":"eye","camera":0})"));
  doc_["scenes"][0]["nodes"] = {0, 1, 2, 3, 4};
  const Json scales[] = {{1, 1, 1}, {1, 1, 0}, {1, 0, 1}, {0, 1, 1}, {1, 0, 0}, {0, 0, 1}, {0, 0, 0}};
  for (const Json& scale : scales) {
    SCOPED_TRACE(scale.dump());
    for (size_t node = 1; node <= 4; ++node) doc_["nodes"][node]["scale"] = scale;
    const ScenePtr s = load();
    ASSERT_TRUE(s);
    for (const char* name : names) {
      ASSERT_GE(s->findLight(name), 0) << name;
      const Light& l = s->lights[size_t(s->findLight(name))];
      EXPECT_EQ(l.power, Vec3(10.0f)) << name;
      EXPECT_EQ(l.shape.position, Vec3(4, 5, 6)) << name;
      EXPECT_LT(glm::length(l.shape.axis - Vec3(0, 1, 0)), 1e-6f) << name;
    }
    const int zeros = int(scale[0] == 0) + int(scale[1] == 0) + int(scale[2] == 0);
    const bool dark = scale[0] == 0 || scale[1] == 0;
    const LightShape& panel = s->lights[size_t(s->findLight("panel"))].shape;
    EXPECT_EQ(glm::length(glm::cross(panel.u, panel.v)) < 1e-8f, dark);
    EXPECT_EQ(s->findCamera("eye") >= 0, zeros < 2);
    EXPECT_EQ(s->warnings.size(), size_t(dark) + size_t(zeros > 1));
  }
}

/// Without normals a file's tangents are of nothing: they are made from texture coordinates, as where it has none.
TEST_F(Gltf, TangentsNeedNormals) {
  const float tangents[16] = {0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1};
  bin_.resize(172);
  std::memcpy(bin_.data() + 108, tangents, sizeof tangents);
  doc_["buffers"][0]["byteLength"] = 172;
  doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", 108}, {"byteLength", 64}});
  doc_["accessors"].push_back(Json::parse(R"({"bufferView":3,"componentType":5126,"count":4,"type":"VEC4"})"));
  Json& attributes = doc_["meshes"][0]["primitives"][0]["attributes"];
  attributes["TANGENT"] = 3;
  const ScenePtr both = load();
  ASSERT_TRUE(both);
  EXPECT_TRUE(both->warnings.empty());
  ASSERT_EQ(both->meshes[0]->tangents.size(), 4u);
  EXPECT_EQ(both->meshes[0]->tangents[0], Vec4(0, 1, 0, 1));
  attributes.erase("NORMAL");
  const ScenePtr alone = load();
  ASSERT_TRUE(alone);
  ASSERT_EQ(alone->warnings.size(), 1u);
  EXPECT_EQ(alone->warnings[0], "/meshes/0/primitives/0/attributes/TANGENT: tangents without normals are ignored");
  attributes.erase("TANGENT");
  const ScenePtr neither = load();
  ASSERT_TRUE(neither);
  EXPECT_EQ(alone->facetHash(Facet::Shading, {}), neither->facetHash(Facet::Shading, {}));
  EXPECT_NE(alone->facetHash(Facet::Shading, {}), both->facetHash(Facet::Shading, {}));
}

/// Points become balls, lines tubes with tips, of 1/500 of the diagonal, closed and facing outwards, with their vertices' colours.
TEST_F(Gltf, PointsAndLinesAreDrawn) {
  const Json good = doc_;
  doc_["buffers"][0]["byteLength"] = 156;
  const float colours[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 0};
  bin_.resize(156);
  std::memcpy(bin_.data() + 108, colours, 48);
  doc_["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", 108}, {"byteLength", 48}});
  doc_["accessors"].push_back({{"bufferView", 3}, {"componentType", 5126}, {"count", 4}, {"type", "VEC3"}});
  doc_["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 3;
  const Json coloured = doc_;
  const double radius = std::sqrt(2.0) / 500;
  struct Case {
    int mode;
    size_t elements, triangles;
    bool indices;
  };
  for (const Case& c :
       {Case{0, 6, 20, true}, Case{0, 4, 20, false}, Case{1, 3, 24, true}, Case{1, 2, 24, false}, Case{2, 4, 24, false}, Case{3, 3, 24, false}}) {
    doc_ = coloured;
    Json& primitive = doc_["meshes"][0]["primitives"][0];
    primitive["mode"] = c.mode;
    if (!c.indices) primitive.erase("indices");
    const ScenePtr s = load();
    ASSERT_TRUE(s) << c.mode;
    EXPECT_TRUE(s->warnings.empty()) << s->warnings[0];
    ASSERT_EQ(s->meshes.size(), 1u);
    const Mesh& m = *s->meshes[0];
    EXPECT_EQ(m.triangles(), c.elements * c.triangles) << c.mode;
    ASSERT_EQ(m.normals.size(), m.positions.size());
    ASSERT_EQ(m.colours.size(), m.positions.size());
    std::map<std::pair<uint32_t, uint32_t>, int> edges;  // a closed surface has each edge once in both directions
    for (size_t t = 0; t < m.indices.size(); t += 3) {
      const Vec3 a = m.positions[m.indices[t]], b = m.positions[m.indices[t + 1]], d = m.positions[m.indices[t + 2]], n = glm::cross(b - a, d - a);
      EXPECT_GT(glm::dot(n, m.normals[m.indices[t]] + m.normals[m.indices[t + 1]] + m.normals[m.indices[t + 2]]), 0.0f) << c.mode;
      for (size_t k = 0; k < 3; ++k) ++edges[{m.indices[t + k], m.indices[t + (k + 1) % 3]}];
    }
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
    }
    // Every vertex is a radius away from the corner of the square whose colour it has.
    for (size_t i = 0; i < m.positions.size(); ++i) {
      double nearest = 1e9;
      for (int k = 0; k < 4; ++k) {
        const Vec3 corner(k == 1 || k == 2, k >= 2, 0), colour(colours[3 * k], colours[3 * k + 1], colours[3 * k + 2]);
        if (Vec3(m.colours[i]) == colour) nearest = glm::length(m.positions[i] - corner);
      }
      EXPECT_NEAR(nearest, radius, 1e-5) << c.mode << " vertex " << i;
    }
  }
  doc_ = good;
  doc_["meshes"][0]["primitives"][0]["mode"] = 3;
  doc_["meshes"][0]["primitives"][0].erase("indices");
  doc_["accessors"][0]["count"] = 1;
  doc_["accessors"][2]["count"] = 1;
  doc_["accessors"][0]["max"] = {0, 0, 0};
  const ScenePtr one = load();
  ASSERT_TRUE(one);
  EXPECT_EQ(one->instances.size(), 0u);
  ASSERT_FALSE(one->warnings.empty());
  EXPECT_TRUE(std::any_of(one->warnings.begin(), one->warnings.end(), [](const std::string& w) {
    return w.find("/meshes/0/primitives/0") != std::string::npos;
  })) << one->warnings[0];
}

/// A directional light's own extras say under which angle it is seen.
TEST_F(Gltf, DirectionalLightsOfSomeSize) {
  const Json good = doc_;
  const auto sun = [&](const char* size, const char* type) {
    doc_ = good;
    doc_["extensionsUsed"] = Json::array({"KHR_lights_punctual"});
    doc_["extensions"]["KHR_lights_punctual"]["lights"] =
        Json::array({Json::parse(std::string(R"({"name":"sun","type":")") + type + R"(","extras":{"gobo_light":{"angularSize":)" + size + "}}}")});
    doc_["nodes"].push_back(Json::parse(R"({"name":"sun","extensions":{"KHR_lights_punctual":{"light":0}}})"));
    doc_["scenes"][0]["nodes"].push_back(doc_["nodes"].size() - 1);
  };
  sun("0.00925", "directional");
  const ScenePtr s = load();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->lights[s->findLight("sun")].shape.angularSize, 0.00925f);
  sun("0.00925", "point");
  EXPECT_EQ(load()->lights[s->findLight("sun")].shape.angularSize, 0.0f);
  for (const char* bad : {"-0.1", "1.6", "1e-9", "\"wide\""}) {
    sun(bad, "directional");
    expectRefused("/extensions/KHR_lights_punctual/lights/0/extras/gobo_light/angularSize", "");
  }
}

/// `extras` may be anything: what is no object says nothing.
TEST_F(Gltf, ExtrasOfDirectionalLightsMayBeAnything) {
  doc_["extensionsUsed"] = Json::array({"KHR_lights_punctual"});
  doc_["extensions"]["KHR_lights_punctual"]["lights"] = Json::array({Json::parse(R"({"name":"sun","type":"directional"})")});
  doc_["nodes"].push_back(Json::parse(R"({"name":"sun","extensions":{"KHR_lights_punctual":{"light":0}}})"));
  doc_["scenes"][0]["nodes"].push_back(1);
  for (const char* extras : {"null", "\"said\"", "[1,2]", "3", "{}"}) {
    doc_["extensions"]["KHR_lights_punctual"]["lights"][0]["extras"] = Json::parse(extras);
    const ScenePtr s = load();
    ASSERT_TRUE(s) << extras;
    EXPECT_EQ(s->lights[s->findLight("sun")].shape.angularSize, 0.0f) << extras;
  }
}

/// Equal names get the first number that is free, however many there are.
TEST_F(Gltf, EqualNamesAreNumbered) {
  const Json good = doc_;
  const auto named = [&](const std::vector<std::string>& names) {
    doc_ = good;
    doc_["extensionsUsed"] = Json::array({"KHR_materials_variants"});
    doc_["cameras"] = Json::parse(R"([{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}])");
    Json materials = Json::array(), variants = Json::array(), nodes = doc_["nodes"], roots = doc_["scenes"][0]["nodes"];
    for (const std::string& name : names) {
      materials.push_back(Json::object({{"name", name}}));
      variants.push_back(Json::object({{"name", name}}));
      roots.push_back(nodes.size());
      nodes.push_back(Json::object({{"name", name}, {"camera", 0}}));
    }
    doc_["materials"] = materials;
    doc_["extensions"]["KHR_materials_variants"]["variants"] = variants;
    doc_["nodes"] = nodes;
    doc_["scenes"][0]["nodes"] = roots;
    return load();
  };
  const std::vector<std::string> wanted = {"a", "a", "a#2", "a", "default", "a#5", "a", "a", "a#2"},
                                 given = {"a", "a#2", "a#2#2", "a#3", "default", "a#5", "a#4", "a#6", "a#2#3"};
  const ScenePtr s = named(wanted);
  ASSERT_TRUE(s);
  ASSERT_EQ(s->materials.size(), given.size() + 1);
  ASSERT_EQ(s->cameras.size(), given.size());
  for (size_t i = 0; i < given.size(); ++i) {
    EXPECT_EQ(s->materials[i].name, given[i]);
    EXPECT_EQ(s->cameras[i].name, given[i]);
  }
  EXPECT_EQ(s->materials.back().name, "default#2");
  EXPECT_EQ(s->variants.names, given);

  constexpr size_t kMany = 10000;  // numbers from 2 on for each would be minutes
  const ScenePtr many = named(std::vector<std::string>(kMany, "a"));
  ASSERT_TRUE(many);
  ASSERT_EQ(many->cameras.size(), kMany);
  EXPECT_EQ(many->materials[kMany - 1].name, "a#10000");
  EXPECT_EQ(many->cameras[kMany - 1].name, "a#10000");
  EXPECT_EQ(many->variants.names[kMany - 1], "a#10000");
}

/// Watts are what leaves the shape at the node's size: pi L area a side.
TEST_F(Gltf, AreaLightsByRadianceAndByPower) {
  const Json good = doc_;
  const auto lamp = [&](const char* light) {
    doc_ = good;
    doc_["nodes"].push_back(Json::parse(std::string(R"({"name":"lamp","scale":[2,3,1],"extras":{"gobo_light":)") + light + "}}"));
    doc_["scenes"][0]["nodes"].push_back(doc_["nodes"].size() - 1);
  };
  struct Case {
    const char* light;
    double area;
  };
  for (const Case& c : {Case{R"({"type":"rect","width":3,"height":4,"power_w":[10,20,0]})", 6.0 * 12.0},
                        Case{R"({"type":"rect","width":3,"height":4,"twoSided":true,"power_w":[10,20,0]})", 2 * 6.0 * 12.0},
                        Case{R"({"type":"disk","radius":0.5,"power_w":[10,20,0]})", M_PI},
                        Case{R"({"type":"sphere","radius":0.5,"twoSided":true,"power_w":[10,20,0]})", 4 * M_PI}}) {
    lamp(c.light);
    const ScenePtr s = load();
    ASSERT_TRUE(s) << c.light;
    EXPECT_TRUE(s->warnings.empty());
    const Light& l = s->lights[s->findLight("lamp")];
    EXPECT_NEAR(l.power.x * M_PI * c.area, 10.0, 1e-5) << c.light;
    EXPECT_NEAR(l.power.y * M_PI * c.area, 20.0, 2e-5) << c.light;
    const double shape = l.shape.kind == LightKind::Rect ? 4.0 * glm::length(l.shape.u) * glm::length(l.shape.v) * (l.shape.twoSided ? 2 : 1)
                                                         : l.shape.radius * l.shape.radius * M_PI * (l.shape.kind == LightKind::Sphere ? 4 : 1);
    EXPECT_NEAR(shape, c.area, 1e-5) << c.light;
  }
  lamp(R"({"type":"disk","radius":0.5,"power":[1,2,3]})");
  const ScenePtr old = load();
  ASSERT_TRUE(old);
  EXPECT_EQ(old->lights[old->findLight("lamp")].power, Vec3(1, 2, 3));
  ASSERT_EQ(old->warnings.size(), 1u);
  EXPECT_NE(old->warnings[0].find("/extras/gobo_light/power"), std::string::npos) << old->warnings[0];
  EXPECT_NE(old->warnings[0].find("power_w"), std::string::npos) << old->warnings[0];
  lamp(R"({"type":"disk","radiance":[1,2,3],"power_w":[1,2,3]})");
  expectRefused("/nodes/1/extras/gobo_light/power_w", "\"radiance\" as well");
  lamp(R"({"type":"disk","radius":1e-9,"power_w":[1e30,0,0]})");
  expectRefused("/nodes/1/extras/gobo_light/power_w", "too small");
  lamp(R"({"type":"disk","power_w":[-1,0,0]})");
  expectRefused("/nodes/1/extras/gobo_light/power_w", "negative");
}

TEST_F(Gltf, RepairsNormalsAndRefusesBadPositions) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(bin_.data() + 60, &nan, 4);
  const ScenePtr s = load();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->meshes[0]->normals[0], Vec3(0, 0, 1));  // from its triangles
  ASSERT_EQ(s->warnings.size(), 2u);                   // what is wrong, and what was done about it
  EXPECT_EQ(s->warnings[0], "/accessors/2: number 0 of the accessor is NaN");
  EXPECT_NE(s->warnings[1].find("/meshes/0/primitives/0/attributes/NORMAL"), std::string::npos);
  std::memcpy(bin_.data() + 12, &nan, 4);
  expectRefused("/meshes/0/primitives/0/attributes/POSITION", "mesh \"square\": position of vertex 1");
}

TEST_F(Gltf, FaultsNameFileAndPointer) {
  const Json good = doc_;
  const std::vector<uint8_t> bytes = bin_;
  auto fresh = [&] {
    doc_ = good;
    bin_ = bytes;
  };
  bin_[48] = 9;
  expectRefused("/meshes/0/primitives/0/indices", "index 9 at 0 is out of range");
  fresh();
  doc_["accessors"][0]["count"] = 5;
  expectRefused("/accessors/0/bufferView", "needs 60 bytes");
  fresh();
  doc_["accessors"][0]["byteOffset"] = 4;
  expectRefused("/accessors/0/bufferView", "needs 52 bytes");
  fresh();
  doc_["accessors"][0]["count"] = 4294967296ull;
  doc_["bufferViews"][0]["byteStride"] = 252;  // wraps in sums of 32 bits
  expectRefused("/accessors/0/bufferView", "needs");
  fresh();
  doc_["accessors"][0]["count"] = 1ull << 62;
  expectRefused("/accessors/0/count", "out of range");
  fresh();
  doc_["bufferViews"][0]["byteStride"] = 4;
  expectRefused("/bufferViews/0/byteStride", "less than an element");
  fresh();
  doc_["bufferViews"][2]["byteLength"] = 1000;
  expectRefused("/bufferViews/2", "outside buffer 0 of 108 bytes");
  fresh();
  doc_["bufferViews"][0]["buffer"] = 3;
  expectRefused("/bufferViews/0/buffer", "index 3 is out of range");
  fresh();
  doc_["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 7;
  expectRefused("/meshes/0/primitives/0/attributes/POSITION", "index 7 is out of range");
  fresh();
  doc_["meshes"][0]["primitives"][0]["material"] = 0;
  expectRefused("/meshes/0/primitives/0/material", "index 0 is out of range");
  fresh();
  doc_["nodes"][0]["children"] = {0};
  expectRefused("/nodes/0", "cycle");
  fresh();
  doc_["nodes"][0]["mesh"] = "zero";
  expectRefused("/nodes/0/mesh", "not an index");
  fresh();
  doc_["nodes"][0]["translation"] = {1, 2};
  expectRefused("/nodes/0/translation", "3 numbers");
  fresh();
  doc_["extensionsRequired"] = {"KHR_texture_basisu"};
  expectRefused("/extensionsRequired/0", "KHR_texture_basisu");
  fresh();
  doc_["asset"]["version"] = "1.0";
  expectRefused("/asset/version", "1.0");
}

TEST_F(Gltf, OptionalExtensionsAreWarnings) {
  doc_["extensionsUsed"] = {"KHR_animation_pointer"};
  const ScenePtr s = load();
  ASSERT_EQ(s->warnings.size(), 1u);
  EXPECT_NE(s->warnings[0].find("KHR_animation_pointer"), std::string::npos);
}

TEST_F(Gltf, UrisStayInTheFolder) {
  // The file exists outside: only the rule keeps it out. A link out of the folder is no way round it.
  const fs::path secret = folder_.parent_path() / (folder_.filename().string() + "-secret.bin");
  std::ofstream(secret, std::ios::binary).write(reinterpret_cast<const char*>(bin_.data()), 108);
  fs::create_symlink(secret, folder_ / "link.bin");
  for (const std::string& uri :
       {"../" + secret.filename().string(), secret.string(), "file://" + secret.string(), std::string("%2e%2e/") + secret.filename().string(),
        std::string("http://example.com/a.bin"), std::string("link.bin"), std::string("$(touch x).bin/../") + secret.filename().string()}) {
    doc_["buffers"][0]["uri"] = uri;
    const std::string path = writeText("scene.gltf");
    const auto scene = loadGltf(path);
    ASSERT_FALSE(scene.ok()) << uri;
    EXPECT_EQ(scene.status().code(), Code::InvalidArgument) << scene.status().toString();
    EXPECT_EQ(scene.status().location(), path + "#/buffers/0/uri");
  }
  fs::remove(secret);
  doc_["buffers"][0]["uri"] = "absent.bin";
  expectRefused(writeText("scene.gltf"), "#/buffers/0/uri", "absent.bin");
  write("short.bin", bin_.data(), 50);
  doc_["buffers"][0]["uri"] = "short.bin";
  expectRefused(writeText("scene.gltf"), "#/buffers/0/byteLength", "has 50 bytes");
}

TEST_F(Gltf, LimitsAndCutFiles) {
  const std::string path = writeGlb();
  LoadOptions few;
  few.maxTriangles = 1;
  EXPECT_EQ(loadGltf(path, few).status().code(), Code::ResourceExhausted);
  LoadOptions small;
  small.maxBytes = 100;  // less than the file
  EXPECT_EQ(loadGltf(path, small).status().code(), Code::ResourceExhausted);
  EXPECT_EQ(loadGltf((folder_ / "none.glb").string()).status().code(), Code::NotFound);
  std::ifstream in(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  for (size_t n = 0; n < whole.size(); n += 7) {  // every cut is refused, none is read past
    const auto cut = loadGltf(write("cut.glb", whole.data(), n));
    EXPECT_FALSE(cut.ok()) << n;
  }
  const std::string deep = "{\"asset\":{\"version\":\"2.0\",\"extras\":" + std::string(100000, '[') + std::string(100000, ']') + "}}";
  EXPECT_NE(loadGltf(write("deep.gltf", deep.data(), deep.size())).status().message().find("nested"), std::string::npos);
}

}  // namespace
}  // namespace gobo
