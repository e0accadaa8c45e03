// SPDX-License-Identifier: Apache-2.0
#include <cstring>

#include "base/check.h"
#include "fuzz/properties.h"
#include "import/load.h"
#include "tests/support/small_gltf.h"

namespace gobo::fuzz {

/// Three corners with a skin of two joints and one morph target, moved by an animation of each kind of path.
std::string richGltf() {
  struct {
    float positions[9] = {-1, 0, 0, 1, 0, 0, 0, 1, 0}, morph[9] = {0, 0, 1, 0, 0, 0, 0, 0, 0}, uv[6] = {0, 0, 1, 0, 0, 1};           // 0, 36, 72
    uint8_t joints[12] = {0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0};                                                                       // 96
    float weights[12] = {0.5f, 0.5f, 0, 0, 1, 0, 0, 0, 0.25f, 0.75f, 0, 0};                                                          // 108
    float bind[32] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -0.5f, 0, 1};           // 156
    float times[2] = {0, 1}, slide[6] = {0, 0, 0, 0, 1, 0}, turn[8] = {0, 0, 0, 1, 0, 0, 0.7071068f, 0.7071068f}, fade[2] = {0, 1};  // 284, 292, 316, 348
  } data;                                                                                                                            // 356 bytes
  static_assert(sizeof data == 356);
  const std::string png = smallPng(200, 40, 90);
  const auto uri = [](const std::string& kind, const void* p, size_t n) { return "\"data:" + kind + ";base64," + base64(p, n) + "\""; };
  const auto view = [](int at, int n) { return R"({"buffer":0,"byteOffset":)" + std::to_string(at) + R"(,"byteLength":)" + std::to_string(n) + "}"; };
  const auto accessor = [](int v, int type, int n, const char* kind, const char* more = "") {
    return R"({"bufferView":)" + std::to_string(v) + R"(,"componentType":)" + std::to_string(type) + R"(,"count":)" + std::to_string(n) + R"(,"type":")" +
           kind + "\"" + more + "}";
  };
  const auto channel = [](int s, int node, const char* path) {
    return R"({"sampler":)" + std::to_string(s) + R"(,"target":{"node":)" + std::to_string(node) + R"(,"path":")" + path + "\"}}";
  };
  return R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0,1,3,4,5]}],"extensionsUsed":["KHR_lights_punctual","KHR_materials_variants"],
    "extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","intensity":10,"spot":{"outerConeAngle":0.7}},{"type":"directional"}]},
      "KHR_materials_variants":{"variants":[{"name":"plain"},{"name":"glowing"}]}},
    "nodes":[{"mesh":0,"skin":0,"name":"body"},{"name":"root","children":[2]},{"name":"tip","translation":[0,0.5,0]},
      {"name":"lamp","translation":[0,0,2],"extensions":{"KHR_lights_punctual":{"light":0}}},{"name":"sun","extensions":{"KHR_lights_punctual":{"light":1}}},
      {"name":"eye","camera":0,"translation":[0,0,4]}],
    "cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}],"skins":[{"joints":[1,2],"inverseBindMatrices":5}],
    "meshes":[{"weights":[0.25],"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":2,"JOINTS_0":3,"WEIGHTS_0":4},"targets":[{"POSITION":1}],"material":0,
      "extensions":{"KHR_materials_variants":{"mappings":[{"material":0,"variants":[0]},{"material":1,"variants":[1]}]}}}]}],
    "materials":[{"name":"plain","pbrMetallicRoughness":{"baseColorTexture":{"index":0}},"alphaMode":"MASK"},{"name":"glowing","emissiveFactor":[1,0.5,0]}],
    "textures":[{"source":0}],"images":[{"uri":)" +
         uri("image/png", png.data(), png.size()) + R"(}],
    "accessors":[)" +
         accessor(0, 5126, 3, "VEC3", R"(,"min":[-1,0,0],"max":[1,1,0])") + "," + accessor(1, 5126, 3, "VEC3", R"(,"min":[0,0,0],"max":[0,0,1])") + "," +
         accessor(2, 5126, 3, "VEC2") + "," + accessor(3, 5121, 3, "VEC4") + "," + accessor(4, 5126, 3, "VEC4") + "," + accessor(5, 5126, 2, "MAT4") + "," +
         accessor(6, 5126, 2, "SCALAR", R"(,"min":[0],"max":[1])") + "," + accessor(7, 5126, 2, "VEC3") + "," + accessor(8, 5126, 2, "VEC4") + "," +
         accessor(9, 5126, 2, "SCALAR") + R"(],
    "bufferViews":[)" +
         view(0, 36) + "," + view(36, 36) + "," + view(72, 24) + "," + view(96, 12) + "," + view(108, 48) + "," + view(156, 128) + "," + view(284, 8) + "," +
         view(292, 24) + "," + view(316, 32) + "," + view(348, 8) + R"(],"buffers":[{"byteLength":356,"uri":)" + uri("application/octet-stream", &data, 356) +
         R"(}],
    "animations":[{"name":"all","samplers":[{"input":6,"output":7},{"input":6,"output":8},{"input":6,"output":9}],"channels":[)" +
         channel(0, 2, "translation") + "," + channel(1, 1, "rotation") + "," + channel(2, 0, "weights") + "," + channel(0, 3, "translation") + "]}]}";
}

namespace {

class Text final : public FileSource {
 public:
  explicit Text(std::string text) : text_(std::move(text)) {}
  Result<std::vector<uint8_t>> main(uint64_t) override { return std::vector<uint8_t>(text_.begin(), text_.end()); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t) override { return notFound("no \"" + name + "\""); }

 private:
  std::string text_;
};

}  // namespace

ScenePtr richScene() {
  static const ScenePtr scene = [] {
    Text files(richGltf());
    LoadOptions options;
    options.files = &files;
    const auto loaded = loadGltf("rich.gltf", options);
    if (!loaded.ok()) std::cerr << loaded.status().toString() << std::endl;
    GOBO_CHECK(loaded.ok());
    for (const std::string& w : (*loaded)->warnings) std::cerr << "rich scene: " << w << std::endl;
    GOBO_CHECK((*loaded)->warnings.empty() && (*loaded)->rig && (*loaded)->textures.size() == 1 && (*loaded)->variants.uses.size() == 2);
    auto copy = std::make_shared<Scene>(**loaded);
    Image sky(4, 2, 3);
    for (size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = float(i) / 24;
    copy->environment = makeEnvironment("sky", sky);
    GOBO_CHECK(copy->seal().ok());
    return ScenePtr(copy);
  }();
  return scene;
}

}  // namespace gobo::fuzz
