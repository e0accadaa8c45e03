// SPDX-License-Identifier: Apache-2.0
// Primitives into meshes: triangles, strips, fans; checked indices; repaired normals, tangents, texture coordinates, colours.
#include <cstring>

#include "import/gltf/document.h"
#include "import/gltf/unique_names.h"

namespace gobo::gltf {
namespace {

template <typename V>
void copyInto(Array<V>& out, const std::vector<float>& in) {
  out.resize(in.size() / size_t(V::length()));
  std::memcpy(static_cast<void*>(out.data()), in.data(), in.size() * sizeof(float));
}

template <typename V>
bool finite(const V& v) {
  for (int i = 0; i < V::length(); ++i)
    if (!std::isfinite(v[i])) return false;
  return true;
}

/// Replaces elements that are not finite; returns how many.
template <typename V>
size_t repair(Array<V>& values, const V& by) {
  size_t n = 0;
  for (V& v : values)
    if (!finite(v)) {
      v = by;
      ++n;
    }
  return n;
}

/// Corner indices of the primitive's triangles. False: nothing to draw, or an error.
bool triangulate(Document& d, const Cursor& primitive, const DracoData* draco, int64_t mode, size_t vertices, std::vector<uint32_t>& out) {
  std::vector<uint32_t> order;
  const int index = primitive["indices"].index("accessors");
  if (index >= 0 || draco) {
    if (draco) {
      order = draco->corners;
      mode = mode == 5 ? 4 : mode;
    } else if (!readIndices(d, index, order)) return false;
    const int64_t type = index < 0 || draco ? 0 : d.item("accessors", index)["componentType"].integer(0, 0, 1 << 20);
    const uint32_t restart = type == 5121 ? 0xffu : type == 5123 ? 0xffffu : 0xffffffffu;  // cuts strips on a GPU: a triangle here, none there
    for (size_t k = 0; k < order.size(); ++k)
      if (type && order[k] == restart) {
        primitive["indices"].fail("index " + std::to_string(order[k]) + " at " + std::to_string(k) + " is the primitive restart value of its type");
        return false;
      } else if (order[k] >= vertices) {
        primitive["indices"].fail("index " + std::to_string(order[k]) + " at " + std::to_string(k) + " is out of range: the primitive has " +
                                  std::to_string(vertices) + " vertices");
        return false;
      }
  } else {
    if (!d.account(vertices * 4, primitive)) return false;
    order.resize(vertices);
    for (size_t k = 0; k < vertices; ++k) order[k] = uint32_t(k);
  }
  if (!d.ok()) return false;
  if (mode < 4) {
    out = std::move(order);
    return true;
  }  // thicken() makes triangles of them
  if (mode == 4) {
    if (order.size() % 3) d.warn(primitive.pointer, std::to_string(order.size()) + " corners are not whole triangles; the rest is dropped");
    order.resize(order.size() / 3 * 3);
    out = std::move(order);
  } else if (order.size() >= 3) {
    if (!d.account(order.size() * 12, primitive)) return false;
    out.reserve((order.size() - 2) * 3);
    for (size_t i = 0; i + 2 < order.size(); ++i) {
      if (mode == 5) out.insert(out.end(), {order[i], order[i + 1 + i % 2], order[i + 2 - i % 2]});
      else out.insert(out.end(), {order[i + 1], order[i + 2], order[0]});
    }
  }
  if (out.empty()) d.warn(primitive.pointer, "primitive has no triangles");
  return !out.empty();
}

/// Unit normals; those that are not finite or have no length become the mean of their triangles' normals.
void repairNormals(Document& d, const Cursor& primitive, Mesh& mesh) {
  std::vector<char> bad(mesh.normals.size(), 0);
  size_t count = 0, odd = 0;
  for (size_t i = 0; i < mesh.normals.size(); ++i) {
    const float length = finite(mesh.normals[i]) ? glm::length(mesh.normals[i]) : 0.0f;
    if (length > 1e-12f && std::isfinite(length)) {
      odd += std::fabs(length - 1.0f) > 0.01f;
      mesh.normals[i] /= length;
      continue;
    }
    mesh.normals[i] = Vec3(0.0f);
    bad[i] = 1;
    ++count;
  }
  if (odd) d.warn(primitive.pointer + "/attributes/NORMAL", std::to_string(odd) + " normals were not of unit length and were scaled");
  if (!count) return;
  for (size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    const uint32_t* v = &mesh.indices[t];
    if (!bad[v[0]] && !bad[v[1]] && !bad[v[2]]) continue;
    const DVec3 p0(mesh.positions[v[0]]), n = glm::cross(DVec3(mesh.positions[v[1]]) - p0, DVec3(mesh.positions[v[2]]) - p0);
    const double length = glm::length(n);
    if (!(length > 0.0)) continue;
    for (int k = 0; k < 3; ++k)
      if (bad[v[k]]) mesh.normals[v[k]] += Vec3(n / length);
  }
  for (size_t i = 0; i < mesh.normals.size(); ++i)
    if (bad[i]) {
      const float length = glm::length(mesh.normals[i]);
      mesh.normals[i] = length > 1e-6f ? mesh.normals[i] / length : Vec3(0, 1, 0);
    }
  d.warn(primitive.pointer + "/attributes/NORMAL", std::to_string(count) + " normals were not finite or had no length and were rebuilt");
}

void repairTangents(Document& d, const Cursor& primitive, Mesh& mesh) {
  size_t count = 0, odd = 0, signs = 0;
  for (size_t i = 0; i < mesh.tangents.size(); ++i) {
    Vec4& t = mesh.tangents[i];
    const float length = finite(t) ? glm::length(Vec3(t)) : 0.0f;
    odd += length > 1e-12f && std::fabs(length - 1.0f) > 0.01f;
    signs += std::fabs(std::fabs(t.w) - 1.0f) > 0.01f;
    if (length > 1e-12f && std::isfinite(length)) {
      t = Vec4(Vec3(t) / length, t.w < 0.0f ? -1.0f : 1.0f);
      continue;
    }
    t = Vec4(Frame(mesh.normals[i]).x, 1.0f);
    ++count;
  }
  if (odd) d.warn(primitive.pointer + "/attributes/TANGENT", std::to_string(odd) + " tangents were not of unit length and were scaled");
  if (signs) d.warn(primitive.pointer + "/attributes/TANGENT", std::to_string(signs) + " tangents have a handedness that is neither 1 nor -1; its sign counts");
  if (count) d.warn(primitive.pointer + "/attributes/TANGENT", std::to_string(count) + " tangents were not finite or had no length and were replaced");
}

/// Formats that the format allows for the attributes that are read; others are read too where they make sense.
void warnFormat(Document& d, const Cursor& attributes, const char* name, bool quantized) {
  const int index = attributes[name].index("accessors");
  if (index < 0 || !d.ok()) return;
  const Cursor a = d.item("accessors", index);
  const int64_t type = a["componentType"].integer(5126, 0, 1 << 20);
  const bool normalised = a["normalized"].boolean(false), vertex = std::string_view(name) == "POSITION", uv = std::string_view(name).substr(0, 8) == "TEXCOORD";
  const bool colour = std::string_view(name) == "COLOR_0", small = type >= 5120 && type <= 5123, isUnsigned = type == 5121 || type == 5123;
  const bool core = type == 5126 || ((uv || colour) && isUnsigned && normalised);
  const bool extended = quantized && (vertex || uv ? small : !colour && (type == 5120 || type == 5122) && normalised);
  if (!core && !extended)
    d.warn(attributes[name].pointer, "component type " + std::to_string(type) + (normalised ? ", normalised," : "") + " is not allowed for " + name +
                                         (quantized ? "" : " without KHR_mesh_quantization"));
}

std::shared_ptr<Mesh> readPrimitive(Document& d, const Cursor& primitive, const std::string& name, bool quantized, DracoData& draco, bool& packed) {
  auto mesh = std::make_shared<Mesh>();
  mesh->name = name;
  const int64_t mode = primitive["mode"].integer(4, 0, 6);
  if (!d.ok()) return nullptr;
  const bool thin = mode < 4;  // points and lines
  const Cursor attributes = primitive["attributes"];
  if (!attributes["POSITION"].exists()) {
    d.warn(primitive.pointer, "primitive without POSITION is not drawn");
    return nullptr;
  }
  packed = primitive.extension("KHR_draco_mesh_compression").exists();
  if (packed && thin) {
    d.warn(primitive.pointer + "/mode", "compressed points and lines are not drawn");
    return nullptr;
  }
  if (packed && !decodeDraco(d, primitive, draco)) return nullptr;
  const DracoData* data = packed ? &draco : nullptr;
  for (const char* n : {"POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1", "TEXCOORD_2", "TEXCOORD_3", "COLOR_0"})
    warnFormat(d, attributes, n, quantized);
  std::vector<float> values;
  if (!readAttribute(d, attributes, data, "POSITION", 3, 0, values)) return nullptr;
  copyInto(mesh->positions, values);
  for (size_t i = 0; i < mesh->positions.size(); ++i)
    if (!finite(std::as_const(mesh->positions)[i])) {
      attributes["POSITION"].fail("mesh \"" + name + "\": position of vertex " + std::to_string(i) + " is not finite");
      return nullptr;
    }
  const size_t vertices = mesh->positions.size();
  std::vector<uint32_t> corners;
  if (!triangulate(d, primitive, data, mode, vertices, corners)) return nullptr;
  mesh->indices = std::move(corners);
  if (!thin && readAttribute(d, attributes, data, "NORMAL", 3, vertices, values)) {
    copyInto(mesh->normals, values);
    repairNormals(d, primitive, *mesh);
  }
  if (!thin && readAttribute(d, attributes, data, "TANGENT", 4, vertices, values)) {
    if (mesh->normals.empty()) d.warn(attributes["TANGENT"].pointer, "tangents without normals are ignored");
    else {
      copyInto(mesh->tangents, values);
      repairTangents(d, primitive, *mesh);
    }
  }
  size_t repaired = 0, outside = 0;
  for (int k = 0; k < kUvSets; ++k)
    if (readAttribute(d, attributes, data, "TEXCOORD_" + std::to_string(k), 2, vertices, values)) {
      copyInto(mesh->uv[k], values);
      repaired += repair(mesh->uv[k], Vec2(0.0f));
    }
  const int colour = attributes["COLOR_0"].index("accessors");
  if (colour >= 0 && d.ok()) {
    const int components = accessorComponents(d, colour);
    if (components != 3 && components != 4) attributes["COLOR_0"].fail("colour is neither VEC3 nor VEC4");
    else if (readAttribute(d, attributes, data, "COLOR_0", components, vertices, values)) {
      std::vector<Vec4> colours(vertices, Vec4(1.0f));
      for (size_t i = 0; i < vertices; ++i)
        for (int c = 0; c < components; ++c) colours[i][c] = values[i * size_t(components) + c];
      for (Vec4& c : colours) {
        if (!finite(c)) {
          c = Vec4(1.0f);
          ++repaired;
        }
        const Vec4 clamped = glm::clamp(c, Vec4(0.0f), Vec4(1.0f));
        outside += clamped != c;
        c = clamped;
      }
      mesh->colours = std::move(colours);
    }
  }
  if (repaired) d.warn(attributes.pointer, std::to_string(repaired) + " texture coordinates or colours were not finite and were replaced");
  if (outside) d.warn(attributes["COLOR_0"].pointer, std::to_string(outside) + " colours were clamped to 0..1");
  const int material = primitive["material"].index("materials");
  if (!d.ok()) return nullptr;
  mesh->material = material < 0 ? int(d.list("materials").size()) : material;  // the default material is last
  if (thin && !thicken(d, primitive, mode, *mesh)) return nullptr;
  sealMesh(*mesh);
  return mesh;
}

/// KHR_materials_variants of a primitive: which material each variant gives it.
std::vector<VariantUse> readVariants(Document& d, const Cursor& primitive, const Cursor& names) {
  std::vector<VariantUse> uses;
  const Cursor mappings = primitive.extension("KHR_materials_variants")["mappings"];
  for (size_t i = 0; i < mappings.size() && d.ok(); ++i) {
    const Cursor list = mappings.at(i)["variants"];
    const int material = mappings.at(i)["material"].index("materials");
    for (size_t k = 0; k < list.size() && d.ok() && material >= 0; ++k) uses.push_back({list.at(k).indexInto(names), 0, material});
  }
  return uses;
}

}  // namespace

bool readAttribute(Document& d, const Cursor& attributes, const DracoData* draco, const std::string& name, int components, size_t vertices,
                   std::vector<float>& out) {
  const Cursor at = attributes[name.c_str()];
  const int index = at.index("accessors");
  if (index < 0 || !d.ok()) return false;
  if (draco) {
    const auto packed = draco->attributes.find(name);
    if (packed != draco->attributes.end()) {
      if (accessorComponents(d, index) != components) {
        at.fail("accessor has not " + std::to_string(components) + " components");
        return false;
      }
      out = packed->second;
      return true;
    }
  }
  const size_t count = accessorCount(d, index);
  if (d.ok() && vertices && count != vertices) {
    at.fail(name + " has " + std::to_string(count) + " elements but POSITION has " + std::to_string(vertices));
    return false;
  }
  return readFloats(d, index, components, out);
}

Status readMeshes(Document& d, Scene& scene, Rig& rig, Parts& parts) {
  const Cursor list = d.list("meshes"), used = d.list("extensionsUsed"), variants = d.root().extension("KHR_materials_variants")["variants"];
  bool quantized = false;
  for (size_t i = 0; i < used.size(); ++i) quantized = quantized || used.at(i).text() == "KHR_mesh_quantization";
  UniqueNames names;
  for (size_t i = 0; i < variants.size() && d.ok(); ++i) {
    scene.variants.names.push_back(names.take(variants.at(i)["name"].text("variant" + std::to_string(i))));
  }
  uint64_t triangles = 0;
  parts.resize(list.size());
  for (size_t i = 0; i < list.size() && d.ok(); ++i) {
    const Cursor primitives = list.at(i)["primitives"], weights = list.at(i)["weights"];
    if (!primitives.exists()) primitives.fail("primitives are missing");
    const std::string base = list.at(i)["name"].text("mesh" + std::to_string(i));
    std::vector<float> rest;
    for (size_t k = 0; k < weights.size() && d.ok(); ++k) rest.push_back(float(weights.at(k).number(0.0)));
    for (size_t k = 0; k < primitives.size() && d.ok(); ++k) {
      const Cursor primitive = primitives.at(k);
      DracoData draco;
      bool packed = false;
      if (d.options.stop.stopRequested()) return Status(Code::Cancelled, "the load was cancelled", d.path);
      auto mesh = readPrimitive(d, primitive, k ? base + "#" + std::to_string(k + 1) : base, quantized, draco, packed);
      if (!mesh) continue;
      triangles += mesh->triangles();
      if (triangles > d.options.maxTriangles)
        return Status(Code::ResourceExhausted, "more than " + std::to_string(d.options.maxTriangles) + " triangles", d.path + "#" + primitive.pointer);
      Part part;
      part.mesh = std::move(mesh);
      part.variants = readVariants(d, primitive, variants);
      part.weights = rest;
      const Cursor attributes = primitive["attributes"];
      if (primitive["mode"].integer(4, 0, 6) >= 4) readDeformation(d, primitive, packed ? &draco : nullptr, rig, part);
      else if (primitive["targets"].size() > 0 || attributes["JOINTS_0"].exists())
        d.warn(primitive.pointer, "points and lines are drawn as they rest: without morph targets and skin");
      if (part.source < 0) {
        part.sceneMesh = int(scene.meshes.size());
        scene.meshes.push_back(part.mesh);
        for (VariantUse use : part.variants) {
          use.mesh = part.sceneMesh;
          scene.variants.uses.push_back(use);
        }
      }
      parts[i].push_back(std::move(part));
    }
  }
  return d.status;
}

}  // namespace gobo::gltf
