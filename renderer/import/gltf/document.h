// SPDX-License-Identifier: Apache-2.0
// Internal to the glTF reader: the parsed document, its bytes, and typed access to its JSON.
// Typed fields are read from the JSON by Cursor: every error carries file + JSON pointer. Errors are sticky: the first one is
// kept in Document::status and getters return their default from then on, so callers check once per object.
#pragma once

#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "import/ies.h"
#include "import/load.h"

namespace gobo::gltf {

using Json = nlohmann::json;
struct Document;

/// A place in the document; absent places (null `json`) answer every getter with its default.
struct Cursor {
  Document* document = nullptr;
  const Json* json = nullptr;
  std::string pointer;

  bool exists() const { return json != nullptr; }
  void fail(const std::string& message) const;
  Cursor operator[](const char* key) const;  ///< member; error if this is not an object
  Cursor at(size_t i) const;                 ///< element i of an array of that size
  size_t size() const;                       ///< of an array (error if not one); 0 when absent
  double number(double otherwise, double lo = -3.0e38, double hi = 3.0e38) const;
  int64_t integer(int64_t otherwise, int64_t lo, int64_t hi) const;
  bool boolean(bool otherwise) const;
  std::string text(const std::string& otherwise = {}) const;
  /// Index into the array `list` of the document root; -1 when absent. Error if not an integer in range.
  int index(const char* list) const;
  int indexInto(const Cursor& list) const;
  /// Fixed-size array of finite numbers; error if another size.
  template <typename Vector>
  Vector vector(Vector otherwise) const {
    if (!exists()) return otherwise;
    if (size() != size_t(Vector::length())) {
      fail("is not an array of " + std::to_string(Vector::length()) + " numbers");
      return otherwise;
    }
    for (int i = 0; i < Vector::length(); ++i) otherwise[i] = typename Vector::value_type(at(size_t(i)).number(0.0));
    return otherwise;
  }
  Cursor extension(const char* name) const { return (*this)["extensions"][name]; }
};

struct Document {
  std::string path;
  LoadOptions options;
  FileSource* files = nullptr;  ///< while the document is being opened
  Json json;
  std::vector<std::vector<uint8_t>> buffers;
  struct EncodedImage {
    std::vector<uint8_t> bytes;
    std::string name, problem;
  };  ///< problem: why there are no bytes
  std::vector<EncodedImage> images;
  std::map<std::string, IesPhotometry> photometry;  ///< by the pointer of what names it (photometry.cpp)
  std::vector<std::string> warnings;
  std::set<std::string> warned;  ///< places that have a warning
  Status status;
  uint64_t bytesUsed = 0;
  std::map<int, std::vector<uint8_t>> unpacked;  ///< buffer views of EXT_meshopt_compression, decoded on first use
  bool thicknessSaid = false;
  std::optional<size_t> mostJoints;  ///< of a skin, once a primitive asked (deformation.cpp)
  std::set<int> boundsSeen;          ///< accessors whose min and max were compared with their data

  Cursor root() { return {this, &json, ""}; }
  Cursor list(const char* name) { return root()[name]; }
  Cursor item(const char* name, int i) { return root()[name].at(size_t(i)); }
  bool ok() const { return status.ok(); }
  void warn(const std::string& pointer, const std::string& message) {
    if (warnings.size() < 1000) {
      warnings.push_back(pointer + ": " + message);
      warned.insert(pointer);
    }
  }
  /// Unless something was said about the place already.
  void warnOnce(const std::string& pointer, const std::string& message) {
    if (!warned.count(pointer)) warn(pointer, message);
  }
  /// Counts memory against options.maxBytes; false and an error when it would be exceeded.
  bool account(uint64_t bytes, const Cursor& where);
};

/// A key as a step of a JSON pointer; a value as text of at most 60 bytes, for messages.
std::string escaped(std::string_view key);
std::string shown(const Json& value);

/// Reads the file and everything it names. Refuses absolute URIs, "..", and files outside the glTF's folder.
Status openDocument(const std::string& path, const LoadOptions& options, Document& document);

/// Bytes of a view: of its buffer, or decoded where EXT_meshopt_compression says so. `stride` 0: not given.
struct ViewBytes {
  const uint8_t* data = nullptr;
  uint64_t size = 0, stride = 0;
};
bool viewBytes(Document& d, int view, ViewBytes& out);
/// Decodes the EXT_meshopt_compression data of a view (meshopt.cpp).
bool unpackView(Document& d, const Cursor& extension, uint64_t viewLength, std::vector<uint8_t>& out);

/// Accessor contents as floats (normalised integers scaled), `components` a vertex; false on error.
bool readFloats(Document& d, int accessor, int components, std::vector<float>& out);
bool readIndices(Document& d, int accessor, std::vector<uint32_t>& out);
/// Unsigned integers as they are, `components` a vertex (joints).
bool readIntegers(Document& d, int accessor, int components, std::vector<uint32_t>& out);
size_t accessorCount(Document& d, int accessor);
int accessorComponents(Document& d, int accessor);

/// What a primitive with KHR_draco_mesh_compression holds: attribute values by name, and corners.
struct DracoData {
  std::map<std::string, std::vector<float>> attributes;
  std::vector<uint32_t> corners;
};
/// Decodes it; sizes are those of the accessors, which the stream must agree with (draco.cpp).
bool decodeDraco(Document& d, const Cursor& primitive, DracoData& out);

/// Materials and the textures they use; scene.materials[i] is glTF material i, and one default material is last.
Status readMaterials(Document& d, Scene& scene);

/// A primitive that was read. Plain ones are one scene mesh; those that can deform are a source of the rig, from which each
/// node that deforms them gets a scene mesh of its own.
struct Part {
  MeshPtr mesh;
  int sceneMesh = -1;                ///< made when a node first shows it undeformed
  int source = -1;                   ///< in Rig::sources
  std::vector<VariantUse> variants;  ///< without `mesh`
  std::vector<float> weights;        ///< of the glTF mesh
  DVec3 centre{0.0};                 ///< taken from its positions, given back by its instances (origin.h)
};
using Parts = std::vector<std::vector<Part>>;  ///< a list for each glTF mesh

Status readMeshes(Document& d, Scene& scene, Rig& rig, Parts& parts);
/// Morph targets, joints and weights of a primitive into the rig; part.source stays -1 when it has none.
void readDeformation(Document& d, const Cursor& primitive, const DracoData* draco, Rig& rig, Part& part);
/// Points and lines (mode 0..3, mesh.indices in the file's order) into triangles (points_lines.cpp). False, with a warning: nothing to draw.
bool thicken(Document& d, const Cursor& primitive, int64_t mode, Mesh& mesh);
/// Attribute `name` with as many elements as there are vertices (0: any), from Draco data where they have it.
bool readAttribute(Document& d, const Cursor& attributes, const DracoData* draco, const std::string& name, int components, size_t vertices,
                   std::vector<float>& out);

/// The node tree as rig nodes, parents first. place[i] = rig node of glTF node i. Refuses cycles and shared children.
Status readHierarchy(Document& d, Rig& rig, std::vector<int>& place);
Status readSkins(Document& d, Rig& rig, const std::vector<int>& place);
Status readAnimations(Document& d, Rig& rig, const std::vector<int>& place);
/// Nodes of the default scene: instances, cameras, lights, and what of them follows or deforms.
Status readNodes(Document& d, Scene& scene, Rig& rig, Parts& parts, const std::vector<int>& place);

/// The object "gobo_light" in the extras of a node or a light; absent where it has none.
Cursor goboLight(const Cursor& at);
/// Warns of faults against the format that the readers need not care about (audit.cpp). O(document).
void audit(Document& d);
void auditBounds(Document& d);  ///< min and max of accessors that nothing read
/// True when the extension is one that this loader knows.
bool supported(const std::string& extension);

}  // namespace gobo::gltf
