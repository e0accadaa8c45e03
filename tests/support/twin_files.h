// SPDX-License-Identifier: Apache-2.0
// One small glTF, and for every texture and every accessor of it a file that differs in one texel or one element of that alone.
#pragma once

#include <string>
#include <vector>

#include "support/gltf_base.h"

namespace gobo::testing {

struct TwinFile {
  std::string change, text;
};

/// A floor (base colour, metallic-roughness, normal map, vertex colours), a masked single-sided card by its second texture
/// coordinates, and a lamp with a texture. The first file is the one that the others differ from.
inline std::vector<TwinFile> twinFiles() {
  struct Numbers {
    const char* name;
    const char* type;
    size_t components;
    std::vector<float> values;
    size_t at;
    float by;
  };
  static const std::vector<Numbers> kNumbers{
      {"floor positions", "VEC3", 3, {-1.5f, 0, 1.5f, 1.5f, 0, 1.5f, 1.5f, 0, -1.5f, -1.5f, 0.2f, -1.5f}, 4, 0.1f},
      {"floor normals", "VEC3", 3, {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0}, 3, 0.4f},
      {"floor texture coordinates", "VEC2", 2, {0, 1, 1, 1, 1, 0, 0, 0}, 2, 0.6f},
      {"floor colours", "VEC4", 4, {1, 1, 1, 1, 0.9f, 1, 1, 1, 1, 0.8f, 1, 1, 1, 1, 0.7f, 1}, 5, -0.5f},
      {"card positions", "VEC3", 3, {-0.7f, 0.6f, 0.7f, 0.7f, 0.6f, 0.7f, 0.7f, 0.6f, -0.7f, -0.7f, 0.6f, -0.7f}, 0, 0.3f},
      {"card texture coordinates", "VEC2", 2, {0, 0, 1, 0, 1, 1, 0, 1}, 4, 0.7f},
      {"lamp positions", "VEC3", 3, {-0.3f, 1.8f, -0.9f, 0.3f, 1.8f, -0.9f, 0.3f, 1.8f, -0.3f, -0.3f, 1.8f, -0.3f}, 2, 0.2f},
      {"lamp texture coordinates", "VEC2", 2, {0, 0, 1, 0, 1, 1, 0, 1}, 3, 0.5f},
  };
  static const char* const kPictures[] = {"colour", "roughness", "bumps", "mask", "glow"};
  const auto make = [](int number, int picture, bool turned) {
    GltfBase b;
    b.doc = Json::parse(R"({"asset":{"version":"2.0"},"buffers":[{}],"scene":0,"scenes":[{"nodes":[0,1,2,3]}],
      "nodes":[{"name":"floor","mesh":0},{"name":"card","mesh":1},{"name":"lampshade","mesh":2},{"name":"eye","camera":0,"translation":[0,2.4,3.4],"rotation":[-0.2588,0,0,0.9659]}],
      "cameras":[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}}],
      "meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"COLOR_0":3},"indices":8,"material":0}]},
        {"primitives":[{"attributes":{"POSITION":4,"TEXCOORD_0":5,"TEXCOORD_1":5},"indices":8,"material":1}]},{"primitives":[{"attributes":{"POSITION":6,"TEXCOORD_0":7},"indices":8,"material":2}]}],
      "materials":[{"name":"floor","doubleSided":true,"pbrMetallicRoughness":{"baseColorTexture":{"index":0},"metallicRoughnessTexture":{"index":1}},"normalTexture":{"index":2}},
        {"name":"card","alphaMode":"MASK","pbrMetallicRoughness":{"metallicFactor":0,"baseColorTexture":{"index":3,"texCoord":1}}},
        {"name":"glow","doubleSided":true,"emissiveFactor":[1,1,1],"emissiveTexture":{"index":4}}]})");
    for (size_t k = 0; k < kNumbers.size(); ++k) {
      std::vector<float> values = kNumbers[k].values;
      if (int(k) == number) values[kNumbers[k].at] += kNumbers[k].by;
      if (std::string(kNumbers[k].name) == "floor normals")
        for (size_t i = 0; i < values.size(); i += 3) {
          const Vec3 n = glm::normalize(Vec3(values[i], values[i + 1], values[i + 2]));
          for (int c = 0; c < 3; ++c) values[i + size_t(c)] = n[c];
        }
      b.accessor(values, 5126, kNumbers[k].type, kNumbers[k].components, 0, std::string(kNumbers[k].name).find("positions") != std::string::npos);
    }
    b.accessor(turned ? std::vector<uint16_t>{0, 1, 3, 1, 2, 3} : std::vector<uint16_t>{0, 1, 2, 0, 2, 3}, 5123, "SCALAR", 1);
    for (int p = 0; p < 5; ++p) {
      Image image(4, 4, 4);
      for (int i = 0; i < 16; ++i)
        for (int c = 0; c < 4; ++c)
          image.data[size_t(4 * i + c)] = c == 3   ? (p != 3 || (i + i / 4) % 2 ? 1.0f : 0.0f)
                                          : p == 2 ? (c == 2 ? 0.9f : 0.2f + 0.02f * float((i * 7 + c) % 5))
                                                   : 0.1f + 0.05f * float((i * 5 + c * 3 + p) % 16);
      if (p == picture)
        for (int c = 0; c < 4; ++c) {
          float& v = image.data[size_t(4 * 6 + c)];
          v = c == 3 && p != 3 ? 1.0f : v > 0.5f ? 0.0f : 1.0f;
        }
      const auto png = encodePng(image);
      EXPECT_TRUE(png.ok()) << png.status().toString();
      b.doc["images"].push_back({{"uri", "data:image/png;base64," + base64(png->data(), png->size())}});
      b.doc["textures"].push_back({{"source", p}});
    }
    b.doc["buffers"][0]["byteLength"] = b.bytes.size();
    return b.text();
  };
  std::vector<TwinFile> out{{"nothing", make(-1, -1, false)}};
  for (size_t k = 0; k < kNumbers.size(); ++k) out.push_back({kNumbers[k].name, make(int(k), -1, false)});
  for (int p = 0; p < 5; ++p) out.push_back({kPictures[p], make(-1, p, false)});
  out.push_back({"indices", make(-1, -1, true)});
  return out;
}

}  // namespace gobo::testing
