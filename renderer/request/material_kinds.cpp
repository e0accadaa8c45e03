// SPDX-License-Identifier: Apache-2.0
#include "request/material_kinds.h"

#include <algorithm>

#include "trace/interior.h"
#include "trace/straight.h"
#include "trace/surface.h"

namespace gobo {
inline namespace request {

namespace {

bool smooth(float roughness) { return roughness * roughness < kDeltaAlpha; }
/// Smooth enough somewhere to be a mirror: by the texture's lowest texel (G), whether or not a triangle shows it.
bool maySmooth(float roughness, const TextureRef& texture, const Scene& scene) {
  return smooth(texture.valid() ? roughness * maxOf(scene.textures[size_t(texture.texture)]->lowest.y, 0.0f) : roughness);
}
/// Rough somewhere: a texture may make the whole smoother, never rougher. Anisotropy widens the lobe along the tangent.
bool mayRough(const Bsdf& b) { return !smooth(b.roughness) || b.anisotropy * b.anisotropy >= kDeltaAlpha; }

/// "a, b and c"
std::string listed(const std::vector<std::string>& parts) {
  std::string all;
  for (size_t k = 0; k < parts.size(); ++k) all += (k == 0 ? "" : k + 1 == parts.size() ? " and " : ", ") + parts[k];
  return all;
}

}  // namespace

MaterialKinds materialKinds(const Scene& scene) {
  MaterialKinds kinds;
  std::vector<char> used(scene.materials.size(), 0);
  for (const Instance& i : scene.instances) used[size_t(scene.meshes[size_t(i.mesh)]->material)] = 1;
  for (size_t m = 0; m < used.size(); ++m) {
    if (!used[m]) continue;
    const Bsdf& b = scene.materials[m].bsdf;
    if (b.unlit) {
      kinds.unlit = true;
      continue;
    }
    const SurfaceMaterial s = makeSurfaceMaterial(scene.materials[m].albedo, b, scene.textures);
    // Light goes straight through an index of 1, however rough the surface, and nothing is reflected where that is all; and through smooth thin walls, which
    // reflect too.
    const bool clear = b.transmission > 0.0f, one = clear && std::fabs(b.ior - 1.0f) < kStraightIor, solid = boundsVolume(b);
    const bool nothingElse = one && b.transmission >= 1.0f && !b.transmissionTexture.valid();
    const bool interface = b.metallic > 0.0f || (!nothingElse && (clear || b.specular > 0.0f || b.iridescence > 0.0f));
    const bool coat = b.clearcoat > 0.0f, layers = coat || maxComponent(b.sheenColor) > 0.0f || b.diffuseTransmission > 0.0f;
    kinds.clear = kinds.clear || maySendStraight(b);
    kinds.extended = kinds.extended || s.extended;
    kinds.lambert = kinds.lambert && s.lambert;
    kinds.translucent = kinds.translucent || b.diffuseTransmission > 0.0f || (clear && mayRough(b) && !one);
    kinds.volumes = kinds.volumes || solid;
    kinds.scatters = kinds.scatters || (solid && makeInterior(b).scatters);
    kinds.boundary = kinds.boundary || (one && solid && nothingElse && !layers);
    const bool somewhere = maySmooth(b.roughness, b.metallicRoughness, scene);
    kinds.pane = kinds.pane || (one && !(solid && nothingElse && !layers)) || (clear && !solid && somewhere);
    kinds.specular = kinds.specular || (interface && somewhere) || (coat && maySmooth(b.clearcoatRoughness, b.clearcoatRoughnessTexture, scene));
  }
  return kinds;
}

std::vector<std::string> classesNotCovered(const Scene& scene, bool caustics) {
  const MaterialKinds kinds = materialKinds(scene);
  static constexpr struct {
    LightKind kind;
    const char* name;
  } kNames[] = {{LightKind::Point, "point"},
                {LightKind::Spot, "spot"},
                {LightKind::Directional, "directional"},
                {LightKind::Rect, "rectangle"},
                {LightKind::Disk, "disk"},
                {LightKind::Sphere, "sphere"},
                {LightKind::Mesh, "mesh"},
                {LightKind::Environment, "environment"}};
  static constexpr const char* kThrough[] = {"open ways", "boundaries of index 1", "clear panes", "mirrors and smooth refraction (caustics)"};
  std::vector<std::string> missing;
  for (const Receiver r : kReceivers) {
    if (r == Receiver::Volume && !kinds.scatters) continue;
    bool kind[std::size(kNames)] = {}, way[std::size(kPassages)] = {};
    for (const Light& l : scene.lights)
      for (const Passage p : kPassages) {
        if (!kinds.occurs(p) || !outOfReach(l.shape, l.cameraVisible, r, p, caustics)) continue;
        for (size_t k = 0; k < std::size(kNames); ++k) kind[k] = kind[k] || kNames[k].kind == l.shape.kind;
        way[size_t(p)] = true;
      }
    std::vector<std::string> lights, ways;
    for (size_t k = 0; k < std::size(kNames); ++k)
      if (kind[k]) lights.push_back(kNames[k].name);
    for (size_t p = 0; p < std::size(kPassages); ++p)
      if (way[p]) ways.push_back(kThrough[p]);
    if (!lights.empty())
      missing.push_back(listed(lights) + " lights through " + listed(ways) + (r == Receiver::Volume ? ", scattered by volumes" : ", on surfaces"));
  }
  return missing;
}

}  // namespace request
}  // namespace gobo
