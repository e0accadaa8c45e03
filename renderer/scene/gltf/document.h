// SPDX-License-Identifier: Apache-2.0
// Internal to the glTF reader: the parsed document, its bytes, and typed access to its JSON.
// tinygltf opens the container (GLB chunks, base64, buffers and encoded images) and is handed only files that were resolved
// and read here. Typed fields are read from the JSON by Cursor instead, because tinygltf drops wrongly typed fields in
// silence and knows no places: here every error carries file + JSON pointer. Errors are sticky: the first one is kept in
// Document::status and getters return their default from then on, so callers check once per object.
#pragma once

#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "scene/load.h"

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
  Cursor operator[](const char* key) const;   ///< member; error if this is not an object
  Cursor at(size_t i) const;                  ///< element i of an array of that size
  size_t size() const;                        ///< of an array (error if not one); 0 when absent
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
    if (size() != size_t(Vector::length())) { fail("is not an array of " + std::to_string(Vector::length()) + " numbers"); return otherwise; }
    for (int i = 0; i < Vector::length(); ++i) otherwise[i] = float(at(size_t(i)).number(0.0));
    return otherwise;
  }
  Cursor extension(const char* name) const { return (*this)["extensions"][name]; }
};

struct Document {
  std::string path;
  LoadOptions options;
  FileSource* files = nullptr;         ///< while the document is being opened
  Json json;
  std::vector<std::vector<uint8_t>> buffers;
  struct EncodedImage { std::vector<uint8_t> bytes; std::string name, problem; };  ///< problem: why there are no bytes
  std::vector<EncodedImage> images;
  std::vector<std::string> warnings;
  Status status;
  uint64_t bytesUsed = 0;

  Cursor root() { return {this, &json, ""}; }
  Cursor list(const char* name) { return root()[name]; }
  Cursor item(const char* name, int i) { return root()[name].at(size_t(i)); }
  bool ok() const { return status.ok(); }
  void warn(const std::string& pointer, const std::string& message) { if (warnings.size() < 1000) warnings.push_back(pointer + ": " + message); }
  /// Counts memory against options.maxBytes; false and an error when it would be exceeded.
  bool account(uint64_t bytes, const Cursor& where);
};

/// Reads the file and everything it names. Refuses absolute URIs, "..", and files outside the glTF's folder.
Status openDocument(const std::string& path, const LoadOptions& options, Document& document);

/// Accessor contents as floats (normalised integers scaled), `components` a vertex; false on error.
bool readFloats(Document& d, int accessor, int components, std::vector<float>& out);
bool readIndices(Document& d, int accessor, std::vector<uint32_t>& out);
size_t accessorCount(Document& d, int accessor);
int accessorComponents(Document& d, int accessor);

/// Materials and the textures they use; scene.materials[i] is glTF material i, and one default material is last.
Status readMaterials(Document& d, Scene& scene);
/// Meshes: scene meshes of glTF mesh i are parts[i].
Status readMeshes(Document& d, Scene& scene, std::vector<std::vector<int>>& parts);
/// Nodes of the default scene: instances, cameras, lights.
Status readNodes(Document& d, Scene& scene, const std::vector<std::vector<int>>& parts);

}  // namespace gobo::gltf
