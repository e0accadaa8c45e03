// SPDX-License-Identifier: Apache-2.0
// What a primitive needs to deform: morph targets, and all its JOINTS_n / WEIGHTS_n sets.
#include <cstring>

#include "import/gltf/document.h"

namespace gobo::gltf {
namespace {

constexpr int kMaxSets = 64;

/// Displacements of one attribute of a target; those that are not finite become 0.
template <typename V>
void readDelta(Document& d, const Cursor& target, const char* name, bool base, size_t vertices, Array<V>& out) {
  const Cursor at = target[name];
  if (!at.exists() || !d.ok()) return;
  if (!base) {
    d.warn(at.pointer, std::string(name) + " moves but the primitive has none; ignored");
    return;
  }
  std::vector<float> values;
  int components = V::length();
  if constexpr (V::length() == 4) components = accessorComponents(d, std::max(0, at.index("accessors"))) == 3 ? 3 : 4;  // colours
  if (!readAttribute(d, target, nullptr, name, components, vertices, values)) return;
  size_t bad = 0;
  std::vector<V> deltas(vertices, V(0.0f));
  for (size_t i = 0; i < vertices; ++i)
    for (int c = 0; c < components; ++c) {
      const float v = values[i * size_t(components) + size_t(c)];
      if (std::isfinite(v)) deltas[i][c] = v;
      else ++bad;
    }
  if (bad) d.warn(at.pointer, std::to_string(bad) + " displacements were not finite and are 0 now");
  out = std::move(deltas);
}

RigTarget readTarget(Document& d, const Cursor& target, const Mesh& mesh) {
  RigTarget t;
  const size_t n = mesh.positions.size();
  readDelta(d, target, "POSITION", true, n, t.positions);
  readDelta(d, target, "NORMAL", !mesh.normals.empty(), n, t.normals);
  readDelta(d, target, "TANGENT", !mesh.tangents.empty(), n, t.tangents);
  for (int k = 0; k < kUvSets; ++k) readDelta(d, target, ("TEXCOORD_" + std::to_string(k)).c_str(), !mesh.uv[k].empty(), n, t.uv[k]);
  readDelta(d, target, "COLOR_0", !mesh.colours.empty(), n, t.colours);
  return t;
}

/// Joint indices of a set, whatever unsigned type they are of; Draco hands out floats, which hold them exactly.
bool readJoints(Document& d, const Cursor& attributes, const DracoData* draco, const std::string& name, size_t vertices, std::vector<uint32_t>& out) {
  const int index = attributes[name.c_str()].index("accessors");
  if (index < 0 || !d.ok()) return false;
  if (draco && draco->attributes.count(name)) {
    const std::vector<float>& values = draco->attributes.at(name);
    if (values.size() != vertices * 4) {
      attributes[name.c_str()].fail("joints are not VEC4");
      return false;
    }
    out.clear();
    for (const float v : values) out.push_back(v >= 0.0f && v < 65536.0f ? uint32_t(v) : 65535u);
    return true;
  }
  if (accessorCount(d, index) != vertices) {
    attributes[name.c_str()].fail("has " + std::to_string(accessorCount(d, index)) + " elements but POSITION has " + std::to_string(vertices));
    return false;
  }
  return readIntegers(d, index, 4, out);
}

/// Weights of a vertex are made to sum to 1; where all are 0 the first joint has it.
void normaliseWeights(Document& d, const Cursor& attributes, size_t influences, std::vector<float>& weights) {
  size_t odd = 0, none = 0;
  for (size_t at = 0; at + influences <= weights.size(); at += influences) {
    double sum = 0;
    for (size_t k = 0; k < influences; ++k) {
      float& w = weights[at + k];
      if (!(w >= 0.0f && std::isfinite(w))) {
        w = 0.0f;
        ++odd;
      }
      sum += w;
    }
    if (!(sum > 0.0)) {
      weights[at] = 1.0f;
      ++none;
      continue;
    }
    odd += std::fabs(sum - 1.0) > 2e-3 * double(influences);
    for (size_t k = 0; k < influences; ++k) weights[at + k] = float(weights[at + k] / sum);
  }
  if (odd) d.warn(attributes["WEIGHTS_0"].pointer, "weights of " + std::to_string(odd) + " vertices did not sum to 1 and were scaled");
  if (none) d.warn(attributes["WEIGHTS_0"].pointer, std::to_string(none) + " vertices have no weight and follow their first joint");
}

/// Joints of the largest skin.
size_t mostJoints(Document& d) {
  if (d.mostJoints) return *d.mostJoints;
  size_t most = 0;
  const Cursor skins = d.list("skins");
  for (size_t k = 0; k < skins.size(); ++k) most = std::max(most, skins.at(k)["joints"].size());
  d.mostJoints = most;
  return most;
}

}  // namespace

void readDeformation(Document& d, const Cursor& primitive, const DracoData* draco, Rig& rig, Part& part) {
  const Cursor attributes = primitive["attributes"], targets = primitive["targets"];
  const size_t vertices = part.mesh->positions.size();
  RigSource source;
  for (size_t t = 0; t < targets.size() && d.ok(); ++t) source.targets.push_back(readTarget(d, targets.at(t), *part.mesh));
  std::vector<std::vector<uint32_t>> joints;
  std::vector<std::vector<float>> weights;
  for (int set = 0; set < kMaxSets && d.ok(); ++set) {
    const std::string j = "JOINTS_" + std::to_string(set), w = "WEIGHTS_" + std::to_string(set);
    if (!attributes[j.c_str()].exists() && !attributes[w.c_str()].exists()) break;
    if (!attributes[j.c_str()].exists() || !attributes[w.c_str()].exists()) {
      d.warn(attributes.pointer, "JOINTS_" + std::to_string(set) + " and WEIGHTS_" + std::to_string(set) + " must come together; ignored");
      break;
    }
    joints.emplace_back();
    weights.emplace_back();
    if (!readJoints(d, attributes, draco, j, vertices, joints.back()) || !readAttribute(d, attributes, draco, w, 4, vertices, weights.back())) return;
  }
  if (!d.ok() || (source.targets.empty() && joints.empty())) return;
  if (!joints.empty()) {
    const size_t sets = joints.size(), influences = sets * 4;
    if (!d.account(uint64_t(vertices) * influences * 6, attributes)) return;
    source.influences = int(influences);
    std::vector<uint16_t> all(vertices * influences, 0);
    std::vector<float> shares(vertices * influences, 0.0f);
    const size_t most = mostJoints(d);
    size_t beyond = 0, twice = 0;
    for (size_t i = 0; i < vertices; ++i)
      for (size_t s = 0; s < sets; ++s)
        for (size_t c = 0; c < 4; ++c) {
          const uint32_t joint = joints[s][i * 4 + c];
          const float share = weights[s][i * 4 + c];
          beyond += share == 0.0f && most > 0 && joint >= most;
          for (size_t e = 0; e < s * 4 + c && sets <= 4 && share != 0.0f; ++e)
            twice += joints[e / 4][i * 4 + e % 4] == joint && weights[e / 4][i * 4 + e % 4] != 0.0f;
          if (joint > 65535) {
            attributes["JOINTS_0"].fail("joint " + std::to_string(joint) + " is out of range");
            return;
          }
          shares[i * influences + s * 4 + c] = share;
          all[i * influences + s * 4 + c] = share != 0.0f ? uint16_t(joint) : 0;  // joints without weight may be anything
        }
    if (beyond) d.warn(attributes["JOINTS_0"].pointer, std::to_string(beyond) + " joints without weight are out of range of every skin");
    if (twice) d.warn(attributes["JOINTS_0"].pointer, std::to_string(twice) + " joints move their vertex twice; the weights add up");
    normaliseWeights(d, attributes, influences, shares);
    source.joints = std::move(all);
    source.weights = std::move(shares);
  }
  source.mesh = int(rig.meshes.size());
  rig.meshes.push_back(part.mesh);
  part.source = int(rig.sources.size());
  rig.sources.push_back(std::move(source));
}

}  // namespace gobo::gltf
