// SPDX-License-Identifier: Apache-2.0
// A mutant for each error code of the Khronos validator that the structural table does not hold: refused at that place, or loaded with
// a warning there (tests/support/gltf_rules.h says which codes are left out and why).
#include "support/gltf_rules.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <iostream>
#include <limits>
#include <set>

#include "import/load.h"
#include "support/gltf_base.h"

namespace gobo {
namespace {

using namespace testing;  // NOLINT: BaseAccessor, GltfBase, Json
using Json = nlohmann::json;

struct Case {
  const char* code;
  bool refused;
  std::string pointer;
  std::function<void(GltfBase&)> change;
};
constexpr bool kRefused = true, kWarned = false;

Json& viewOf(GltfBase& b, int accessor) { return b.doc["bufferViews"][b.doc["accessors"][size_t(accessor)]["bufferView"].get<size_t>()]; }
std::string viewAt(int accessor, const char* member = "") {
  const GltfBase b = gltfBase();
  return "/bufferViews/" + std::to_string(b.doc["accessors"][size_t(accessor)]["bufferView"].get<int>()) + member;
}
std::string pictureView(const char* member = "") { return "/bufferViews/" + std::to_string(gltfBase().doc["images"][0]["bufferView"].get<int>()) + member; }
std::string pngUri(size_t cut) {
  const std::string png = smallPng(1, 2, 3);
  return "data:image/png;base64," + base64(png.data(), png.size() - cut);
}
Json& primitive(GltfBase& b) { return b.doc["meshes"][0]["primitives"][0]; }
void stridedIndices(GltfBase& b) {
  viewOf(b, kIndices)["byteStride"] = 4;
  b.doc["accessors"][kIndices]["count"] = 3;
}
Json& accessorOf(GltfBase& b, int i) { return b.doc["accessors"][size_t(i)]; }

std::vector<Case> cases() {
  const std::string p = "/meshes/0/primitives/0", a = p + "/attributes";
  const float nan = std::numeric_limits<float>::quiet_NaN();
  return {
      {"IO_ERROR", kWarned, "/images/1/uri", [](GltfBase& b) { b.doc["images"][1]["uri"] = "missing.png"; }},
      {"IO_ERROR", kRefused, "/buffers/0/uri", [](GltfBase& b) { b.doc["buffers"][0]["uri"] = "missing.bin"; }},
      {"INVALID_URI", kWarned, "/images/1/uri", [](GltfBase& b) { b.doc["images"][1]["uri"] = "a%zz.png"; }},
      {"PATTERN_MISMATCH", kRefused, "/asset/version", [](GltfBase& b) { b.doc["asset"]["version"] = "2.x"; }},
      {"ACCESSOR_MATRIX_ALIGNMENT", kWarned, "/accessors/9",
       [](GltfBase& b) {
         b.doc["skins"][0].erase("inverseBindMatrices");
         accessorOf(b, kBinds)["byteOffset"] = 2;
         accessorOf(b, kBinds)["count"] = 2;
       }},
      {"ACCESSOR_NORMALIZED_INVALID", kWarned, "/accessors/0/normalized", [](GltfBase& b) { accessorOf(b, kPositions)["normalized"] = true; }},
      {"ACCESSOR_OFFSET_ALIGNMENT", kWarned, "/accessors/13/byteOffset",
       [](GltfBase& b) {
         accessorOf(b, kMorphWeights)["byteOffset"] = 2;
         accessorOf(b, kMorphWeights)["count"] = 1;
       }},
      {"ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE", kRefused, "/accessors/14/sparse/count", [](GltfBase& b) { accessorOf(b, kSparse)["sparse"]["count"] = 9; }},
      {"ASSET_MIN_VERSION_GREATER_THAN_VERSION", kRefused, "/asset/minVersion", [](GltfBase& b) { b.doc["asset"]["minVersion"] = "2.1"; }},
      {"BUFFER_DATA_URI_MIME_TYPE_INVALID", kWarned, "/buffers/0/uri",
       [](GltfBase& b) { b.doc["buffers"][0]["uri"] = "data:text/plain;base64," + base64(b.bytes.data(), b.bytes.size()); }},
      {"BUFFER_VIEW_INVALID_BYTE_STRIDE", kWarned, viewAt(kIndices, "/byteStride"), stridedIndices},
      {"BUFFER_VIEW_TOO_BIG_BYTE_STRIDE", kWarned, viewAt(kInstances, "/byteStride"),
       [](GltfBase& b) {
         viewOf(b, kInstances)["byteStride"] = 252;
         accessorOf(b, kInstances)["count"] = 1;
       }},
      {"CAMERA_XMAG_YMAG_ZERO", kRefused, "/cameras/1/orthographic/ymag", [](GltfBase& b) { b.doc["cameras"][1]["orthographic"]["ymag"] = 0; }},
      {"CAMERA_XMAG_YMAG_ZERO", kRefused, "/cameras/1/orthographic/xmag",
       [](GltfBase& b) {
         b.doc["cameras"][1]["orthographic"]["xmag"] = 0;
         b.doc["nodes"][6].erase("camera");
       }},
      {"CAMERA_ZFAR_LEQUAL_ZNEAR", kWarned, "/cameras/0/perspective", [](GltfBase& b) { b.doc["cameras"][0]["perspective"]["zfar"] = 0.05; }},
      {"KHR_LIGHTS_PUNCTUAL_LIGHT_SPOT_ANGLES", kRefused, "/extensions/KHR_lights_punctual/lights/0/spot/innerConeAngle",
       [](GltfBase& b) { b.doc["extensions"]["KHR_lights_punctual"]["lights"][0]["spot"]["innerConeAngle"] = 0.5; }},
      {"KHR_LIGHTS_PUNCTUAL_LIGHT_SPOT_ANGLES", kWarned, "/extensions/KHR_lights_punctual/lights/0/spot",
       [](GltfBase& b) { b.doc["extensions"]["KHR_lights_punctual"]["lights"][0]["spot"]["innerConeAngle"] = 0.4; }},
      {"MESH_INVALID_WEIGHTS_COUNT", kWarned, "/meshes/1/weights",
       [](GltfBase& b) {
         b.doc["meshes"][1]["weights"] = {0, 0};
       }},
      {"MESH_PRIMITIVES_UNEQUAL_TARGETS_COUNT", kWarned, "/meshes/1/primitives/1",
       [](GltfBase& b) {
         Json copy = b.doc["meshes"][1]["primitives"][0];
         copy.erase("targets");
         b.doc["meshes"][1]["primitives"].push_back(copy);
       }},
      {"MESH_PRIMITIVE_INDEXED_SEMANTIC_CONTINUITY", kWarned, a, [](GltfBase& b) { primitive(b)["attributes"]["TEXCOORD_2"] = kUv; }},
      {"MESH_PRIMITIVE_INVALID_ATTRIBUTE", kWarned, a + "/FOO", [](GltfBase& b) { primitive(b)["attributes"]["FOO"] = kPositions; }},
      {"MESH_PRIMITIVE_JOINTS_WEIGHTS_MISMATCH", kWarned, a, [](GltfBase& b) { primitive(b)["attributes"].erase("WEIGHTS_0"); }},
      {"NODE_MATRIX_NON_TRS", kWarned, "/nodes/6/matrix", [](GltfBase& b) { b.doc["nodes"][6]["matrix"][4] = 1; }},
      {"NODE_MATRIX_NON_TRS", kRefused, "/nodes/6/matrix", [](GltfBase& b) { b.doc["nodes"][6]["matrix"][3] = 0.5; }},
      {"NODE_MATRIX_TRS", kRefused, "/nodes/6/matrix",
       [](GltfBase& b) {
         b.doc["nodes"][6]["scale"] = {1, 1, 1};
       }},
      {"NODE_SKIN_NO_SCENE", kWarned, "/nodes/0/skin",
       [](GltfBase& b) {
         b.doc["scenes"].push_back({{"nodes", {0}}});
       }},
      {"NON_REQUIRED_EXTENSION", kWarned, "/extensionsUsed/23", [](GltfBase& b) { b.doc["extensionsUsed"].push_back("KHR_mesh_quantization"); }},
      {"ROTATION_NON_UNIT", kWarned, "/nodes/2/rotation",
       [](GltfBase& b) {
         b.doc["nodes"][2]["rotation"] = {0, 0, 0, 0.5};
       }},
      {"SKIN_NO_COMMON_ROOT", kWarned, "/skins/0/joints",
       [](GltfBase& b) {
         b.doc["skins"][0]["joints"] = {2, 3};
       }},
      {"SKIN_SKELETON_INVALID", kWarned, "/skins/0/skeleton", [](GltfBase& b) { b.doc["skins"][0]["skeleton"] = 3; }},
      {"UNKNOWN_ASSET_MAJOR_VERSION", kRefused, "/asset/version", [](GltfBase& b) { b.doc["asset"]["version"] = "3.0"; }},
      {"UNUSED_EXTENSION_REQUIRED", kWarned, "/extensionsRequired/2", [](GltfBase& b) { b.doc["extensionsRequired"].push_back("KHR_mesh_quantization"); }},
      {"ACCESSOR_SMALL_BYTESTRIDE", kRefused, viewAt(kPositions, "/byteStride"), [](GltfBase& b) { viewOf(b, kPositions)["byteStride"] = 8; }},
      {"ACCESSOR_TOO_LONG", kRefused, "/accessors/0/bufferView", [](GltfBase& b) { accessorOf(b, kPositions)["count"] = 5; }},
      {"ACCESSOR_TOO_LONG", kWarned, "/accessors/19",
       [](GltfBase& b) {
         b.doc["accessors"].push_back(accessorOf(b, kPositions));
         b.doc["accessors"].back()["count"] = 5;
       }},
      {"ACCESSOR_TOTAL_OFFSET_ALIGNMENT", kWarned, "/accessors/13",
       [](GltfBase& b) {
         Json& v = viewOf(b, kMorphWeights);
         v["byteOffset"] = v["byteOffset"].get<int>() + 2;
         v["byteLength"] = 4;
         accessorOf(b, kMorphWeights)["count"] = 1;
       }},
      {"ACCESSOR_USAGE_OVERRIDE", kWarned, "/animations/0/samplers/2/output", [](GltfBase& b) { b.doc["animations"][0]["samplers"][2]["output"] = kTimes; }},
      {"ANIMATION_CHANNEL_TARGET_NODE_MATRIX", kWarned, "/animations/0/channels/0/target",
       [](GltfBase& b) { b.doc["animations"][0]["channels"][0]["target"]["node"] = 6; }},
      {"ANIMATION_CHANNEL_TARGET_NODE_WEIGHTS_NO_MORPHS", kWarned, "/animations/0/channels/2/target",
       [](GltfBase& b) { b.doc["animations"][0]["channels"][2]["target"]["node"] = 0; }},
      {"ANIMATION_DUPLICATE_TARGETS", kWarned, "/animations/0/channels/0/target",
       [](GltfBase& b) {
         Json copy = b.doc["animations"][0]["channels"][0];
         b.doc["animations"][0]["channels"].push_back(copy);
       }},
      {"ANIMATION_SAMPLER_ACCESSOR_WITH_BYTESTRIDE", kWarned, "/animations/0/samplers/0/input", [](GltfBase& b) { viewOf(b, kTimes)["byteStride"] = 4; }},
      {"ANIMATION_SAMPLER_INPUT_ACCESSOR_INVALID_FORMAT", kWarned, "/animations/0/samplers/0/input",
       [](GltfBase& b) { b.doc["animations"][0]["samplers"][0]["input"] = kMoves; }},
      {"ANIMATION_SAMPLER_INPUT_ACCESSOR_TOO_FEW_ELEMENTS", kWarned, "/animations/0/samplers/0/input",
       [](GltfBase& b) {
         b.doc["animations"][0]["samplers"][0]["interpolation"] = "CUBICSPLINE";
         accessorOf(b, kTimes)["count"] = 1;
       }},
      {"ANIMATION_SAMPLER_INPUT_ACCESSOR_WITHOUT_BOUNDS", kWarned, "/animations/0/samplers/0/input", [](GltfBase& b) { accessorOf(b, kTimes).erase("min"); }},
      {"ANIMATION_SAMPLER_OUTPUT_ACCESSOR_INVALID_COUNT", kWarned, "/animations/0/channels/0/sampler", [](GltfBase& b) { accessorOf(b, kMoves)["count"] = 1; }},
      {"ANIMATION_SAMPLER_OUTPUT_ACCESSOR_INVALID_FORMAT", kWarned, "/animations/0/channels/0/sampler",
       [](GltfBase& b) {
         b.doc["animations"][0]["channels"][0]["target"] = {{"node", 1}, {"path", "rotation"}};
       }},
      {"BUFFER_VIEW_TARGET_OVERRIDE", kWarned, a + "/POSITION", [](GltfBase& b) { viewOf(b, kPositions)["target"] = 34963; }},
      {"BUFFER_VIEW_TOO_LONG", kRefused, pictureView(),
       [](GltfBase& b) { b.doc["bufferViews"][b.doc["images"][0]["bufferView"].get<size_t>()]["byteLength"] = 1000000; }},
      {"BUFFER_VIEW_TOO_LONG", kWarned, "/bufferViews/" + std::to_string(gltfBase().doc["bufferViews"].size()),
       [](GltfBase& b) {
         b.doc["bufferViews"].push_back({{"buffer", 0}, {"byteLength", 1000000}});
       }},
      {"IMAGE_BUFFER_VIEW_WITH_BYTESTRIDE", kWarned, "/images/0/bufferView",
       [](GltfBase& b) { b.doc["bufferViews"][b.doc["images"][0]["bufferView"].get<size_t>()]["byteStride"] = 4; }},
      {"INVALID_IBM_ACCESSOR_COUNT", kRefused, "/skins/0/inverseBindMatrices", [](GltfBase& b) { accessorOf(b, kBinds)["count"] = 1; }},
      {"KHR_MATERIALS_VARIANTS_NON_UNIQUE_VARIANT", kWarned, p + "/extensions/KHR_materials_variants/mappings/1/variants/0",
       [](GltfBase& b) {
         primitive(b)["extensions"]["KHR_materials_variants"]["mappings"].push_back({{"variants", {0}}, {"material", 0}});
       }},
      {"MESH_PRIMITIVE_ACCESSOR_UNALIGNED", kWarned, a + "/COLOR_0", [](GltfBase& b) { accessorOf(b, kColours)["type"] = "VEC3"; }},
      {"MESH_PRIMITIVE_ACCESSOR_WITHOUT_BYTESTRIDE", kWarned, a + "/POSITION",
       [](GltfBase& b) { accessorOf(b, kNormals)["bufferView"] = accessorOf(b, kPositions)["bufferView"]; }},
      {"MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT", kWarned, a + "/COLOR_0", [](GltfBase& b) { accessorOf(b, kColours)["normalized"] = false; }},
      {"MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT", kRefused, "/accessors/1/type", [](GltfBase& b) { accessorOf(b, kNormals)["type"] = "VEC2"; }},
      {"MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_UNSIGNED_INT", kWarned, a + "/TEXCOORD_0", [](GltfBase& b) { accessorOf(b, kUv)["componentType"] = 5125; }},
      {"MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID_FORMAT", kRefused, "/accessors/7/componentType",
       [](GltfBase& b) { accessorOf(b, kIndices)["componentType"] = 5122; }},
      {"MESH_PRIMITIVE_INDICES_ACCESSOR_WITH_BYTESTRIDE", kWarned, p + "/indices", stridedIndices},
      {"MESH_PRIMITIVE_MORPH_TARGET_INVALID_ATTRIBUTE_COUNT", kRefused, "/meshes/1/primitives/0/targets/0/POSITION",
       [](GltfBase& b) { accessorOf(b, kMorph)["count"] = 3; }},
      {"MESH_PRIMITIVE_MORPH_TARGET_NO_BASE_ACCESSOR", kWarned, "/meshes/1/primitives/0/targets/0/NORMAL",
       [](GltfBase& b) { b.doc["meshes"][1]["primitives"][0]["targets"][0]["NORMAL"] = kMorph; }},
      {"MESH_PRIMITIVE_NO_TANGENT_SPACE", kWarned, p + "/material",
       [](GltfBase& b) {
         primitive(b)["attributes"].erase("TANGENT");
         b.doc["materials"][0].erase("normalTexture");
       }},
      {"MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS", kWarned, a + "/POSITION", [](GltfBase& b) { accessorOf(b, kPositions).erase("min"); }},
      {"MESH_PRIMITIVE_TOO_FEW_TEXCOORDS", kWarned, p + "/material", [](GltfBase& b) { primitive(b)["attributes"].erase("TEXCOORD_0"); }},
      // A number of an extension that nobody knows, so that no rule holds it, and beyond every integer.
      {"MESH_PRIMITIVE_TOO_FEW_TEXCOORDS", kWarned, p + "/material",
       [](GltfBase& b) {
         b.doc["materials"][0]["extensions"]["VENDOR_gloss"]["glossTexture"] = {{"index", 0}, {"texCoord", 1e300}};
       }},
      {"MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT", kRefused, a + "/NORMAL", [](GltfBase& b) { accessorOf(b, kNormals)["count"] = 3; }},
      {"NODE_LOOP", kRefused, "/nodes/1", [](GltfBase& b) { b.doc["nodes"][1]["children"] = {2}; }},
      {"NODE_PARENT_OVERRIDE", kRefused, "/nodes/1", [](GltfBase& b) { b.doc["nodes"][3]["children"] = {1}; }},
      {"NODE_SKIN_WITH_NON_SKINNED_MESH", kWarned, "/nodes/4/skin", [](GltfBase& b) { b.doc["nodes"][4]["skin"] = 0; }},
      {"NODE_WEIGHTS_INVALID", kWarned, "/nodes/4/weights",
       [](GltfBase& b) {
         b.doc["nodes"][4]["weights"] = {1, 2};
       }},
      {"SCENE_NON_ROOT_NODE", kWarned, "/scenes/0/nodes/8", [](GltfBase& b) { b.doc["scenes"][0]["nodes"].push_back(1); }},
      {"SKIN_IBM_ACCESSOR_WITH_BYTESTRIDE", kWarned, "/skins/0/inverseBindMatrices", [](GltfBase& b) { viewOf(b, kBinds)["byteStride"] = 64; }},
      {"SKIN_IBM_INVALID_FORMAT", kRefused, "/accessors/9/type", [](GltfBase& b) { accessorOf(b, kBinds)["type"] = "VEC4"; }},
      {"TEXTURE_INVALID_IMAGE_MIME_TYPE", kWarned, "/textures/0/source", [](GltfBase& b) { b.doc["images"][0]["mimeType"] = "image/webp"; }},
      {"UNDECLARED_EXTENSION", kWarned, "/nodes/3/extensions/KHR_x", [](GltfBase& b) { b.doc["nodes"][3]["extensions"]["KHR_x"] = Json::object(); }},
      {"UNEXPECTED_EXTENSION_OBJECT", kWarned, "/nodes/3/extensions/KHR_materials_ior",
       [](GltfBase& b) { b.doc["nodes"][3]["extensions"]["KHR_materials_ior"] = Json::object(); }},
      {"ACCESSOR_ANIMATION_INPUT_NEGATIVE", kWarned, "/animations/0/samplers/0/input", [](GltfBase& b) { b.put(kTimes, 0, -1.0f); }},
      {"ACCESSOR_ANIMATION_INPUT_NON_INCREASING", kWarned, "/animations/0/samplers/0/input", [](GltfBase& b) { b.put(kTimes, 1, 0.0f); }},
      {"ACCESSOR_ANIMATION_SAMPLER_OUTPUT_NON_NORMALIZED_QUATERNION", kWarned, "/animations/0/channels/1/sampler", [](GltfBase& b) { b.put(kTurns, 3, 2.0f); }},
      {"ACCESSOR_ELEMENT_OUT_OF_MAX_BOUND", kWarned, "/accessors/0/max/0", [](GltfBase& b) { b.put(kPositions, 3, 3.0f); }},
      {"ACCESSOR_ELEMENT_OUT_OF_MIN_BOUND", kWarned, "/accessors/0/min/0", [](GltfBase& b) { b.put(kPositions, 0, -3.0f); }},
      {"ACCESSOR_INDEX_OOB", kRefused, p + "/indices", [](GltfBase& b) { b.put(kIndices, 0, uint16_t(9)); }},
      {"ACCESSOR_INDEX_PRIMITIVE_RESTART", kRefused, p + "/indices", [](GltfBase& b) { b.put(kIndices, 0, uint16_t(0xffff)); }},
      {"ACCESSOR_INVALID_FLOAT", kWarned, "/accessors/1", [nan](GltfBase& b) { b.put(kNormals, 0, nan); }},
      {"ACCESSOR_INVALID_FLOAT", kRefused, a + "/POSITION", [nan](GltfBase& b) { b.put(kPositions, 4, nan); }},
      {"ACCESSOR_INVALID_IBM", kWarned, "/skins/0/inverseBindMatrices", [](GltfBase& b) { b.put(kBinds, 3, 1.0f); }},
      {"ACCESSOR_INVALID_SIGN", kWarned, a + "/TANGENT", [](GltfBase& b) { b.put(kTangents, 3, 0.5f); }},
      {"ACCESSOR_JOINTS_INDEX_DUPLICATE", kWarned, a + "/JOINTS_0", [](GltfBase& b) { b.put(kJoints, 1, uint8_t(0)); }},
      {"ACCESSOR_JOINTS_INDEX_OOB", kRefused, "/nodes/0/mesh", [](GltfBase& b) { b.put(kJoints, 1, uint8_t(9)); }},
      {"ACCESSOR_JOINTS_INDEX_OOB", kWarned, a + "/JOINTS_0", [](GltfBase& b) { b.put(kJoints, 3, uint8_t(9)); }},
      {"ACCESSOR_MAX_MISMATCH", kWarned, "/accessors/0/max/0", [](GltfBase& b) { accessorOf(b, kPositions)["max"][0] = 5; }},
      {"ACCESSOR_MAX_MISMATCH", kWarned, "/accessors/10/max/0", [](GltfBase& b) { b.put(kTimes, 1, std::numeric_limits<float>::infinity()); }},
      {"ACCESSOR_MIN_MISMATCH", kWarned, "/accessors/0/min/0", [](GltfBase& b) { accessorOf(b, kPositions)["min"][0] = -5; }},
      {"ACCESSOR_NON_CLAMPED", kWarned, a + "/COLOR_0",
       [](GltfBase& b) {
         primitive(b)["attributes"]["COLOR_0"] = kTangents;
         b.put(kTangents, 0, 2.0f);
       }},
      {"ACCESSOR_SPARSE_INDEX_OOB", kRefused, "/accessors/14/sparse/indices",
       [](GltfBase& b) { b.bytes[viewOf(b, kSparse)["byteOffset"].get<size_t>() + 48 + 1] = 9; }},
      {"ACCESSOR_SPARSE_INDICES_NON_INCREASING", kWarned, "/accessors/14/sparse/indices",
       [](GltfBase& b) { b.bytes[viewOf(b, kSparse)["byteOffset"].get<size_t>() + 48 + 1] = 1; }},
      {"ACCESSOR_VECTOR3_NON_UNIT", kWarned, a + "/NORMAL", [](GltfBase& b) { b.put(kNormals, 2, 2.0f); }},
      {"ACCESSOR_WEIGHTS_NEGATIVE", kWarned, a + "/WEIGHTS_0", [](GltfBase& b) { b.put(kWeights, 0, -0.5f); }},
      {"ACCESSOR_WEIGHTS_NON_NORMALIZED", kWarned, a + "/WEIGHTS_0", [](GltfBase& b) { b.put(kWeights, 0, 0.9f); }},
      {"BUFFER_BYTE_LENGTH_MISMATCH", kRefused, "/buffers/0/byteLength", [](GltfBase& b) { b.doc["buffers"][0]["byteLength"] = 1000000; }},
      {"IMAGE_DATA_INVALID", kWarned, "/images/1",
       [](GltfBase& b) {
         b.doc["images"][1]["uri"] = "data:image/png;base64," + base64("\x89PNG\r\n\x1a\nxxxxxxxxxxxxxxxxxxxx", 28);
         b.doc["textures"][0]["source"] = 1;
       }},
      {"IMAGE_UNEXPECTED_EOS", kWarned, "/images/1",
       [](GltfBase& b) {
         b.doc["images"][1]["uri"] = pngUri(40);
         b.doc["textures"][0]["source"] = 1;
       }},
      {"IMAGE_MIME_TYPE_INVALID", kWarned, "/images/0/bufferView", [](GltfBase& b) { b.doc["images"][0]["mimeType"] = "image/jpeg"; }},
      {"IMAGE_NON_ENABLED_MIME_TYPE", kWarned, "/textures/1/source",
       [](GltfBase& b) { b.doc["images"][1]["uri"] = "data:image/webp;base64," + base64("RIFF\x04\0\0\0WEBP", 12); }},
  };
}

TEST(GltfRules, EveryCodeIsAnswered) {
  const GltfBase base = gltfBase();
  std::set<std::string> held;
  size_t refused = 0, warned = 0;
  for (const Case& c : cases()) {
    GltfBase mutant = base;
    c.change(mutant);
    MemoryFile file(mutant.text());
    LoadOptions options;
    options.files = &file;
    const auto scene = loadGltf("base.gltf", options);
    held.insert(c.code);
    if (c.refused) {
      ++refused;
      if (scene.ok()) {
        ADD_FAILURE() << c.code << " loads";
        continue;
      }
      EXPECT_EQ(scene.status().code() == Code::InvalidArgument || scene.status().code() == Code::NotFound, true) << c.code << ": " << scene.status().toString();
      EXPECT_EQ(scene.status().location(), "base.gltf#" + c.pointer) << c.code << ": " << scene.status().toString();
      continue;
    }
    ++warned;
    if (!scene.ok()) {
      ADD_FAILURE() << c.code << ": " << scene.status().toString();
      continue;
    }
    const auto& w = (*scene)->warnings;
    EXPECT_TRUE(std::any_of(w.begin(), w.end(), [&](const std::string& s) { return s.compare(0, c.pointer.size() + 2, c.pointer + ": ") == 0; }))
        << c.code << ": no warning at " << c.pointer;
  }
  for (const CodeRule& r : kRules) {
    if (r.held == Held::LeftOut) {
      EXPECT_GT(std::string(r.note).size(), 10u) << r.code << " is left out without a reason";
      continue;
    }
    const bool elsewhere =
        r.held == Held::Structure || r.held == Held::Container || std::string(r.code) == "BUFFER_MISSING_GLB_DATA";  // GltfSchema, GltfContainer
    EXPECT_TRUE(elsewhere || held.count(r.code)) << "no mutant for " << r.code;
  }
  std::cout << "  " << std::size(kRules) << " codes; " << refused << " mutants refused, " << warned << " warned of\n";
}

}  // namespace
}  // namespace gobo
