// SPDX-License-Identifier: Apache-2.0
// A small glTF scene made on the spot: a floor, a sliding quad, a moving and a still point light, a moving camera, two material
// variants. Each animation goes from the rest pose at 0 s linearly to another place at 1 s.
#pragma once

#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace gobo::testing {

inline std::string writeAnimatedScene(const std::string& name) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / ("gobo-animated-" + name + "-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const float data[] = {-1, 0,    -1, -1,   0,    1,    1, 0, 1, 1, 0, -1,  // a square on the floor
                        0,  1,                                              // key times
                        0,  0.5f, 0,  0.6f, 0.5f, 0,                        // slide
                        0,  2,    0,  0.5f, 2,    0.3f,                     // lamp
                        0,  1,    4,  0.5f, 1,    4};                       // dolly
  const uint16_t corners[] = {0, 1, 2, 0, 2, 3};
  std::vector<char> bin(sizeof data + sizeof corners);
  std::memcpy(bin.data(), data, sizeof data);
  std::memcpy(bin.data() + sizeof data, corners, sizeof corners);
  std::ofstream(folder / "data.bin", std::ios::binary).write(bin.data(), std::streamsize(bin.size()));
  auto channel = [](const char* title, int node, int output) {
    return std::string("{\"name\":\"") + title + "\",\"samplers\":[{\"input\":2,\"output\":" + std::to_string(output) +
           "}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":" + std::to_string(node) + ",\"path\":\"translation\"}}]}";
  };
  const std::string text = R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0,1,2,3,4]}],"extensionsUsed":["KHR_lights_punctual","KHR_materials_variants"],
    "extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":8}]},"KHR_materials_variants":{"variants":[{"name":"grey"},{"name":"red"}]}},
    "nodes":[{"name":"floor","mesh":0},{"name":"board","mesh":0,"translation":[0,0.5,0],"scale":[0.3,0.3,0.3]},
      {"name":"lamp","translation":[0,2,0],"extensions":{"KHR_lights_punctual":{"light":0}}},
      {"name":"still","translation":[-1,2,0],"extensions":{"KHR_lights_punctual":{"light":0}}},
      {"name":"eye","camera":0,"translation":[0,1,4]}],
    "cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}],
    "materials":[{"name":"grey","pbrMetallicRoughness":{"baseColorFactor":[0.5,0.5,0.5,1],"metallicFactor":0}},
      {"name":"red","pbrMetallicRoughness":{"baseColorFactor":[0.8,0.1,0.1,1],"metallicFactor":0}}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0,"extensions":{"KHR_materials_variants":{"mappings":[
      {"material":0,"variants":[0]},{"material":1,"variants":[1]}]}}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,0,-1],"max":[1,0,1]},
      {"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"},
      {"bufferView":0,"byteOffset":48,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},
      {"bufferView":0,"byteOffset":56,"componentType":5126,"count":2,"type":"VEC3"},
      {"bufferView":0,"byteOffset":80,"componentType":5126,"count":2,"type":"VEC3"},
      {"bufferView":0,"byteOffset":104,"componentType":5126,"count":2,"type":"VEC3"}],
    "bufferViews":[{"buffer":0,"byteLength":128},{"buffer":0,"byteOffset":128,"byteLength":12}],
    "buffers":[{"uri":"data.bin","byteLength":140}],
    "animations":[)" + channel("slide", 1, 3) +
                           "," + channel("lamp", 2, 4) + "," + channel("dolly", 4, 5) + "]}";
  const fs::path file = folder / "moving.gltf";
  std::ofstream(file) << text;
  return file.string();
}

}  // namespace gobo::testing
