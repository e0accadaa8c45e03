// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace gobo {

/// The smallest .glb that is a scene: one emissive triangle.
inline std::string triangleGlb() {
  const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  std::string json = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"name":"tri"}],)"
                     R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],)"
                     R"("materials":[{"name":"glow","emissiveFactor":[1,1,1]}],)"
                     R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],)"
                     R"("bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]})";
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string out;
  const auto word = [&](uint32_t v) { out.append(reinterpret_cast<const char*>(&v), 4); };
  word(0x46546c67);
  word(2);
  word(uint32_t(12 + 8 + json.size() + 8 + sizeof positions));
  word(uint32_t(json.size()));
  word(0x4e4f534a);
  out += json;
  word(sizeof positions);
  word(0x004e4942);
  out.append(reinterpret_cast<const char*>(positions), sizeof positions);
  return out;
}

}  // namespace gobo
