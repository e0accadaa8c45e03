// SPDX-License-Identifier: Apache-2.0
// One valid glTF with an instance of every object of the structural table (renderer/import/gltf/schema.h): what the mutants of the
// input tests are made from. The Khronos validator finds no error in it. Buffers and pictures are data URIs.
#pragma once

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <meshoptimizer.h>

#include <nlohmann/json.hpp>

#include "scene/file_source.h"
#include "support/small_gltf.h"

namespace gobo::testing {

using Json = nlohmann::json;

/// A file that lies in memory, with no file beside it.
class MemoryFile final : public FileSource {
 public:
  explicit MemoryFile(std::string text) : text_(std::move(text)) {}
  Result<std::vector<uint8_t>> main(uint64_t) override { return std::vector<uint8_t>(text_.begin(), text_.end()); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t) override {
    return Status(Code::NotFound, "file \"" + name + "\" does not exist beside the glTF");
  }

 private:
  std::string text_;
};

/// Document and buffer bytes while they are made and changed.
struct GltfBase {
  Json doc;
  std::vector<uint8_t> bytes;  ///< of buffer 0

  int view(const void* data, size_t size, int target = 0) {
    while (bytes.size() % 4) bytes.push_back(0);
    Json v = {{"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", size}};
    if (target) v["target"] = target;
    doc["bufferViews"].push_back(v);
    bytes.insert(bytes.end(), static_cast<const uint8_t*>(data), static_cast<const uint8_t*>(data) + size);
    return int(doc["bufferViews"].size()) - 1;
  }
  template <typename T>
  int accessor(const std::vector<T>& data, int component, const char* type, size_t components, int target = 0, bool bounds = false) {
    const int v = view(data.data(), data.size() * sizeof(T), target);
    Json a = {{"bufferView", v}, {"byteOffset", 0}, {"componentType", component}, {"type", type}, {"count", data.size() / components}};
    for (size_t c = 0; bounds && c < components; ++c) {
      T lo = data[c], hi = data[c];
      for (size_t i = c; i < data.size(); i += components) {
        lo = std::min(lo, data[i]);
        hi = std::max(hi, data[i]);
      }
      a["min"].push_back(lo);
      a["max"].push_back(hi);
    }
    doc["accessors"].push_back(a);
    return int(doc["accessors"].size()) - 1;
  }
  /// Where the bytes of an accessor begin in buffer 0.
  size_t start(int accessor) const {
    const Json& a = doc["accessors"][size_t(accessor)];
    return doc["bufferViews"][a["bufferView"].get<size_t>()]["byteOffset"].get<size_t>() + a.value("byteOffset", size_t(0));
  }
  template <typename T>
  void put(int accessor, size_t number, T value) {
    std::memcpy(bytes.data() + start(accessor) + number * sizeof(T), &value, sizeof value);
  }
  std::string text() const {
    Json copy = doc;
    if (copy.contains("buffers") && copy["buffers"].is_array() && !copy["buffers"].empty() && copy["buffers"][0].is_object() &&
        !copy["buffers"][0].contains("uri"))
      copy["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(bytes.data(), bytes.size());
    return copy.dump();
  }
};

/// Accessors of the base by what they hold.
enum BaseAccessor : int {
  kPositions,
  kNormals,
  kTangents,
  kUv,
  kColours,
  kJoints,
  kWeights,
  kIndices,
  kMorph,
  kBinds,
  kTimes,
  kMoves,
  kTurns,
  kMorphWeights,
  kSparse,
  kInstances,
  kPackedPositions,
  kPackedIndices,
  kMeshopt
};

inline std::vector<char> dracoSquare() {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2);
  const int at = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const float p[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  builder.SetAttributeValuesForFace(at, draco::FaceIndex(0), p[0], p[1], p[2]);
  builder.SetAttributeValuesForFace(at, draco::FaceIndex(1), p[0], p[2], p[3]);
  const auto mesh = builder.Finalize();
  draco::EncoderBuffer out;
  draco::Encoder encoder;
  encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING);
  return encoder.EncodeMeshToBuffer(*mesh, &out).ok() ? std::vector<char>(out.data(), out.data() + out.size()) : std::vector<char>();
}

inline GltfBase gltfBase() {
  GltfBase b;
  b.doc = Json::parse(R"({"asset":{"version":"2.0","minVersion":"2.0","generator":"test","copyright":"none"},"buffers":[{"name":"bytes"},
    {"byteLength":64,"extensions":{"EXT_meshopt_compression":{"fallback":true}}}],
    "scene":0,"scenes":[{"name":"all","nodes":[0,2,4,5,6,7,8,9]}],
    "nodes":[{"name":"skinned","mesh":0,"skin":0},{"name":"joint 1","translation":[0,1,0]},{"name":"joint 0","children":[1],"translation":[0,0,0],"rotation":[0,0,0,1],"scale":[1,1,1]},
      {"name":"free"},{"name":"morphed","mesh":1,"weights":[0.5]},{"name":"eye","camera":0,"translation":[0,0,5]},{"name":"plan","camera":1,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,4,1]},
      {"name":"lamp","extensions":{"KHR_lights_punctual":{"light":0}}},{"name":"copies","mesh":2,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":15}}}},
      {"name":"measured","extensions":{"EXT_lights_ies":{"light":0,"multiplier":2,"color":[1,1,0.5]}}}],
    "cameras":[{"type":"perspective","name":"p","perspective":{"yfov":0.7,"znear":0.1,"zfar":100,"aspectRatio":1}},{"type":"orthographic","orthographic":{"xmag":2,"ymag":3,"znear":0,"zfar":9}}],
    "skins":[{"name":"s","joints":[2,1],"skeleton":2,"inverseBindMatrices":9}],
    "animations":[{"name":"a","samplers":[{"input":10,"output":11,"interpolation":"LINEAR"},{"input":10,"output":12},{"input":10,"output":13}],
      "channels":[{"sampler":0,"target":{"node":1,"path":"translation"}},{"sampler":1,"target":{"node":2,"path":"rotation"}},{"sampler":2,"target":{"node":4,"path":"weights"}}]}],
    "meshes":[{"name":"m","primitives":[{"mode":4,"indices":7,"material":0,"attributes":{"POSITION":0,"NORMAL":1,"TANGENT":2,"TEXCOORD_0":3,"COLOR_0":4,"JOINTS_0":5,"WEIGHTS_0":6},
        "extensions":{"KHR_materials_variants":{"mappings":[{"variants":[0],"material":1,"name":"v"}]}}}]},
      {"weights":[0],"primitives":[{"indices":7,"material":1,"attributes":{"POSITION":0},"targets":[{"POSITION":8}]}]},
      {"primitives":[{"indices":17,"attributes":{"POSITION":16},"extensions":{"KHR_draco_mesh_compression":{}}},{"indices":7,"attributes":{"POSITION":14}},{"indices":7,"attributes":{"POSITION":18}}]}],
    "samplers":[{"name":"s","magFilter":9729,"minFilter":9987,"wrapS":10497,"wrapT":33071}],
    "images":[{"name":"in a view","mimeType":"image/png"},{"name":"in a uri"}],
    "textures":[{"name":"t","sampler":0,"source":0},{"source":1,"extensions":{"EXT_texture_webp":{},"KHR_texture_basisu":{}}}],
    "materials":[{"name":"rich","alphaMode":"MASK","alphaCutoff":0.5,"doubleSided":true,"emissiveFactor":[0.5,0,0],
        "pbrMetallicRoughness":{"baseColorFactor":[1,1,1,1],"metallicFactor":0,"roughnessFactor":0.5,
          "baseColorTexture":{"index":0,"texCoord":0,"extensions":{"KHR_texture_transform":{"offset":[0,0],"rotation":0,"scale":[1,1],"texCoord":0}}}},
        "normalTexture":{"index":0,"scale":1},"occlusionTexture":{"index":0,"strength":1},
        "extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":0.1},"KHR_materials_clearcoat":{"clearcoatFactor":0.1},"KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.1},
          "KHR_materials_dispersion":{"dispersion":0.1},"KHR_materials_emissive_strength":{"emissiveStrength":1},"KHR_materials_ior":{"ior":1.4},"KHR_materials_iridescence":{"iridescenceFactor":0.1},
          "KHR_materials_sheen":{"sheenRoughnessFactor":0.1},"KHR_materials_specular":{"specularFactor":0.9},"KHR_materials_transmission":{"transmissionFactor":0.1},
          "KHR_materials_volume":{"attenuationDistance":1},"KHR_materials_volume_scatter":{"scatterAnisotropy":0.1}}},
      {"name":"unlit","extensions":{"KHR_materials_unlit":{}}},{"name":"glossy","extensions":{"KHR_materials_pbrSpecularGlossiness":{"glossinessFactor":0.5}}}],
    "extensions":{"KHR_lights_punctual":{"lights":[{"name":"l","type":"spot","color":[1,1,1],"intensity":3,"range":9,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.4}}]},
      "EXT_lights_ies":{"lights":[{"name":"downlight","mimeType":"application/x-ies-lm-63","uri":"data:application/x-ies-lm-63,TILT=NONE%0A1%201000%201%202%201%201%202%200%200%200%0A1%201%2050%0A0%2090%0A0%0A100%200%0A"}]},
      "KHR_materials_variants":{"variants":[{"name":"one"},{"name":"two"}]}},
    "extensionsRequired":["KHR_draco_mesh_compression","EXT_meshopt_compression"]})");
  for (const char* name : {"KHR_lights_punctual",
                           "EXT_lights_ies",
                           "KHR_materials_anisotropy",
                           "KHR_materials_clearcoat",
                           "KHR_materials_diffuse_transmission",
                           "KHR_materials_dispersion",
                           "KHR_materials_emissive_strength",
                           "KHR_materials_ior",
                           "KHR_materials_iridescence",
                           "KHR_materials_pbrSpecularGlossiness",
                           "KHR_materials_sheen",
                           "KHR_materials_specular",
                           "KHR_materials_transmission",
                           "KHR_materials_unlit",
                           "KHR_materials_variants",
                           "KHR_materials_volume",
                           "KHR_materials_volume_scatter",
                           "KHR_texture_transform",
                           "KHR_texture_basisu",
                           "EXT_texture_webp",
                           "KHR_draco_mesh_compression",
                           "EXT_meshopt_compression",
                           "EXT_mesh_gpu_instancing"})
    b.doc["extensionsUsed"].push_back(name);
  constexpr int vertices = 34962, corners = 34963;
  const std::vector<float> square{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  const std::vector<uint16_t> faces{0, 1, 2, 0, 2, 3};
  b.accessor(square, 5126, "VEC3", 3, vertices, true);
  b.accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, 5126, "VEC3", 3, vertices);
  b.accessor(std::vector<float>{1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1}, 5126, "VEC4", 4, vertices);
  b.accessor(std::vector<float>{0, 0, 1, 0, 1, 1, 0, 1}, 5126, "VEC2", 2, vertices);
  b.accessor(std::vector<uint8_t>{255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 9, 9, 9, 255}, 5121, "VEC4", 4, vertices);
  b.doc["accessors"].back()["normalized"] = true;
  b.accessor(std::vector<uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}, 5121, "VEC4", 4, vertices);
  b.accessor(std::vector<float>{0.5, 0.5, 0, 0, 0.5, 0.5, 0, 0, 0.5, 0.5, 0, 0, 0.5, 0.5, 0, 0}, 5126, "VEC4", 4, vertices);
  b.accessor(faces, 5123, "SCALAR", 1, corners);
  b.accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, 5126, "VEC3", 3, vertices, true);
  std::vector<float> binds(48, 0.0f);  // one more than joints
  for (size_t i = 0; i < binds.size(); i += i % 16 == 15 ? 1 : 5) binds[i] = 1.0f;
  b.accessor(binds, 5126, "MAT4", 16);
  b.accessor(std::vector<float>{0, 1}, 5126, "SCALAR", 1, 0, true);
  b.accessor(std::vector<float>{0, 1, 0, 0, 2, 0}, 5126, "VEC3", 3);
  b.accessor(std::vector<float>{0, 0, 0, 1, 0, 0, 1, 0}, 5126, "VEC4", 4);
  b.accessor(std::vector<float>{0, 1}, 5126, "SCALAR", 1);
  b.accessor(square, 5126, "VEC3", 3, vertices, true);
  const uint8_t moved[] = {1, 2};
  const float to[] = {1, 0, 0, 1, 1, 0};  // where they were: the stated bounds stay true
  const int indices = b.view(moved, sizeof moved), values = b.view(to, sizeof to);
  b.doc["accessors"].back()["sparse"] = {{"count", 2},
                                         {"indices", {{"bufferView", indices}, {"byteOffset", 0}, {"componentType", 5121}}},
                                         {"values", {{"bufferView", values}, {"byteOffset", 0}}}};
  b.accessor(std::vector<float>{0, 0, 0, 2, 0, 0}, 5126, "VEC3", 3);
  for (int k = 0; k < 2; ++k) {  // Draco's: no views of their own
    b.doc["accessors"].push_back(k ? Json{{"componentType", 5123}, {"type", "SCALAR"}, {"count", 6}}
                                   : Json{{"componentType", 5126}, {"type", "VEC3"}, {"count", 4}, {"min", {0, 0, 0}}, {"max", {1, 1, 0}}});
  }
  const std::vector<char> packed = dracoSquare();
  const int draco = b.view(packed.data(), packed.size());
  b.doc["meshes"][2]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", draco}, {"attributes", {{"POSITION", 0}}}};
  std::vector<uint8_t> coded(meshopt_encodeVertexBufferBound(4, 12));
  meshopt_encodeVertexVersion(0);
  coded.resize(meshopt_encodeVertexBuffer(coded.data(), coded.size(), square.data(), 4, 12));
  const int meshopt = b.view(coded.data(), coded.size());
  const Json offset = b.doc["bufferViews"][size_t(meshopt)]["byteOffset"];
  b.doc["bufferViews"][size_t(meshopt)] = {{"name", "packed"},
                                           {"buffer", 1},
                                           {"byteOffset", 0},
                                           {"byteLength", 48},
                                           {"byteStride", 12},
                                           {"target", vertices},
                                           {"extensions",
                                            {{"EXT_meshopt_compression",
                                              {{"buffer", 0},
                                               {"byteOffset", offset},
                                               {"byteLength", coded.size()},
                                               {"byteStride", 12},
                                               {"count", 4},
                                               {"mode", "ATTRIBUTES"},
                                               {"filter", "NONE"}}}}}};
  b.doc["accessors"].push_back(
      {{"bufferView", meshopt}, {"componentType", 5126}, {"type", "VEC3"}, {"count", 4}, {"min", {0, 0, 0}}, {"max", {1, 1, 0}}, {"name", "packed"}});
  const std::string png = smallPng(200, 40, 90);
  const int picture = b.view(png.data(), png.size());
  b.doc["images"][0]["bufferView"] = picture;
  b.doc["images"][1]["uri"] = "data:image/png;base64," + base64(png.data(), png.size());
  const std::string ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 50\n0 90\n0\n100 0\n";
  const int photometry = b.view(ies.data(), ies.size());
  b.doc["extensions"]["EXT_lights_ies"]["lights"].push_back({{"bufferView", photometry}, {"mimeType", "application/x-ies-lm-63"}});
  b.doc["buffers"][0]["byteLength"] = b.bytes.size();
  return b;
}

}  // namespace gobo::testing
