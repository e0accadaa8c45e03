// SPDX-License-Identifier: Apache-2.0
// Small glTF files and pictures as text and bytes, for tests that go through files.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "base/image_io.h"
#include "scene/blob.h"

namespace gobo {

inline std::string base64(const void* data, size_t size) {
  static const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto* p = static_cast<const uint8_t*>(data);
  std::string out;
  for (size_t i = 0; i < size; i += 3) {
    const uint32_t v = uint32_t(p[i]) << 16 | (i + 1 < size ? uint32_t(p[i + 1]) << 8 : 0) | (i + 2 < size ? p[i + 2] : 0);
    for (int k = 0; k < 4; ++k) out += i + size_t(k) > size ? '=' : digits[(v >> (18 - 6 * k)) & 63];
  }
  return out;
}

/// A quad of four vertices under a lamp; textured by the file `picture` unless that is empty. `extra` goes into the root object.
inline std::string smallGltf(const std::string& picture, const std::string& extra = {}) {
  struct {
    float p[12], t[8];
    uint16_t i[6];
  } data = {{-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0}, {0, 1, 1, 1, 1, 0, 0, 0}, {0, 1, 2, 0, 2, 3}};
  std::string s = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],)"
                  R"("nodes":[{"mesh":0,"name":"quad"},{"name":"lamp","translation":[0,0,2],"extensions":{"KHR_lights_punctual":{"light":0}}}],)"
                  R"("extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":10}]}},)"
                  R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}],)"
                  R"("accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,-1,0],"max":[1,1,0]},)"
                  R"({"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"},{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}],)"
                  R"("bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":32},{"buffer":0,"byteOffset":80,"byteLength":12}],)"
                  R"("buffers":[{"byteLength":92,"uri":"data:application/octet-stream;base64,)" +
                  base64(&data, 92) + "\"}],";
  if (!picture.empty()) s += R"("images":[{"uri":")" + picture + R"("}],"textures":[{"source":0}],)";
  s += R"("materials":[{"name":"paint","pbrMetallicRoughness":{)" + std::string(picture.empty() ? "" : R"("baseColorTexture":{"index":0},)") +
       R"("metallicFactor":0}}])";
  return s + (extra.empty() ? "" : "," + extra) + "}";
}

/// A 4 x 4 PNG of one colour (different colours may differ in size).
inline std::string smallPng(uint8_t r, uint8_t g, uint8_t b) {
  Image image(4, 4, 3);
  const auto linear = [](uint8_t v) {
    const double c = v / 255.0;
    return float(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
  };
  for (int i = 0; i < 16; ++i) {
    float* p = image.at(i % 4, i / 4);
    p[0] = linear(r);
    p[1] = linear(g);
    p[2] = linear(b);
  }
  const auto bytes = encodePng(image);
  return bytes.ok() ? std::string(bytes->begin(), bytes->end()) : std::string();
}

inline std::vector<uint8_t> blobOfScene(const Scene& scene) {
  std::vector<uint8_t> out;
  const Status s = writeBlob(scene, [&](const void* p, size_t n) {
    const auto* c = static_cast<const uint8_t*>(p);
    out.insert(out.end(), c, c + n);
    return Status();
  });
  return s.ok() ? out : std::vector<uint8_t>();
}

}  // namespace gobo
