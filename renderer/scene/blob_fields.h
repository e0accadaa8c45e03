// SPDX-License-Identifier: Apache-2.0
// Field lists of the scene's own structs, names included, for the scene blob. A test counts the members of each struct
// (blob_format.cpp): one that no list names fails it.
#pragma once

#include "scene/fields.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {

template <Same<Mesh> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("indices", s.indices);
  v("positions", s.positions);
  v("normals", s.normals);
  v("tangents", s.tangents);
  v("uv", s.uv);
  v("colours", s.colours);
  v("material", s.material);
  v("topologyHash", s.topologyHash);
  v("positionsHash", s.positionsHash);
  v("shadingHash", s.shadingHash);
}
template <Same<Instance> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("mesh", s.mesh);
  v("toWorld", s.toWorld);
}
template <Same<Light> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("shape", s.shape);
  v("power", s.power);
  v("cameraVisible", s.cameraVisible);
  v("color", s.color);
  v("intensity", s.intensity);
}
template <Same<Texture> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("width", s.width);
  v("height", s.height);
  v("channels", s.channels);
  v("srgb", s.srgb);
  v("wrapU", s.wrapU);
  v("wrapV", s.wrapV);
  v("nearest", s.nearest);
  v("levels", s.levels);
  v("tile", s.tile);
  v("texels8", s.texels8);
  v("texelsF", s.texelsF);
  v("content", s.content);
  v("lowest", s.lowest);
}
template <Same<LightProfile> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("kind", s.kind);
  v("width", s.width);
  v("height", s.height);
  v("values", s.values);
  v("vertical", s.vertical);
  v("horizontal", s.horizontal);
  v("content", s.content);
}
template <Same<Environment> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("width", s.width);
  v("height", s.height);
  v("texels", s.texels);
  v("rotation", s.rotation);
  v("repairedTexels", s.repairedTexels);
  v("content", s.content);
}

/// Materials and cameras with their names, which fields.h leaves out because no facet's digest has them.
template <typename T, typename V>
void visitNamed(T& item, V&& v) {
  v("name", item.name);
  visitFields(item, v);
}
/// The rig with its digest.
template <typename T, typename V>
void visitSealed(T& item, V&& v) {
  v("content", item.content);
  visitFields(item, v);
}

/// What a scene is made of. Digests and bounds are made again by seal().
template <Same<Scene> S, typename V>
void visitFields(S& s, V&& v) {
  v("name", s.name);
  v("meshes", s.meshes);
  v("instances", s.instances);
  v("materials", s.materials);
  v("textures", s.textures);
  v("lights", s.lights);
  v("profiles", s.profiles);
  v("environment", s.environment);
  v("cameras", s.cameras);
  v("rig", s.rig);
  v("variants", s.variants);
  v("origin", s.origin);
  v("warnings", s.warnings);
}

}  // namespace scene
}  // namespace gobo
