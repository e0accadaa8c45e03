// SPDX-License-Identifier: Apache-2.0
#include "plan/material_kinds.h"

#include <algorithm>

#include "plan/planner.h"
#include "trace/interior.h"
#include "trace/surface.h"

namespace gobo {

namespace {

/// Smooth enough to be a mirror. A roughness texture may reach 0 where the factor does not: where is not looked for.
bool smooth(float roughness) { return roughness * roughness < kDeltaAlpha; }
/// Anisotropy widens the lobe along the tangent.
bool smooth(const Bsdf& b) { return smooth(b.roughness) && !(b.anisotropy * b.anisotropy >= kDeltaAlpha); }

/// Where volumes overlap, some boundaries change nothing (trace/interior.h). Judged by boxes; O(vertices) of the volumes if there are several.
bool volumesOverlap(const Scene& scene) {
  struct Box { Vec3 lo{3e38f}, hi{-3e38f}; };
  std::vector<const Instance*> volumes;
  for (const Instance& i : scene.instances)
    if (boundsVolume(scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)].bsdf)) volumes.push_back(&i);
  if (volumes.size() < 2) return false;
  std::vector<Box> boxes(volumes.size());
  for (size_t k = 0; k < volumes.size(); ++k)
    for (const Vec3& v : scene.meshes[size_t(volumes[k]->mesh)]->positions) {
      const Vec3 p(volumes[k]->toWorld * Vec4(v, 1.0f));
      boxes[k].lo = glm::min(boxes[k].lo, p);
      boxes[k].hi = glm::max(boxes[k].hi, p);
    }
  std::sort(boxes.begin(), boxes.end(), [](const Box& a, const Box& b) { return a.lo.x < b.lo.x; });
  for (size_t a = 0; a < boxes.size(); ++a)
    for (size_t b = a + 1; b < boxes.size() && boxes[b].lo.x <= boxes[a].hi.x; ++b)
      if (boxes[b].lo.y <= boxes[a].hi.y && boxes[a].lo.y <= boxes[b].hi.y && boxes[b].lo.z <= boxes[a].hi.z && boxes[a].lo.z <= boxes[b].hi.z) return true;
  return false;
}

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
    if (b.unlit) { kinds.unlit = true; continue; }
    const SurfaceMaterial s = makeSurfaceMaterial(scene.materials[m].albedo, b, scene.textures);
    // Light goes straight through an index of 1, however rough the surface; and through smooth thin walls, which reflect too.
    const bool clear = b.transmission > 0.0f, one = std::fabs(b.ior - 1.0f) < kStraightIor, solid = boundsVolume(b);
    const bool opaque = b.transmission < 1.0f || b.transmissionTexture.valid();
    const bool interface = b.metallic > 0.0f || b.iridescence > 0.0f || (clear && !one) || (opaque && b.specular > 0.0f);
    const bool coat = b.clearcoat > 0.0f, layers = coat || maxComponent(b.sheenColor) > 0.0f || b.diffuseTransmission > 0.0f;
    kinds.extended = kinds.extended || s.extended;
    kinds.translucent = kinds.translucent || b.diffuseTransmission > 0.0f || (clear && !smooth(b) && !one);
    kinds.volumes = kinds.volumes || solid;
    kinds.scatters = kinds.scatters || (solid && makeInterior(b).scatters);
    kinds.boundary = kinds.boundary || (clear && one && solid);
    kinds.pane = kinds.pane || (clear && one && (!solid || interface || layers)) || (clear && !solid && smooth(b.roughness));
    kinds.specular = kinds.specular || (interface && smooth(b.roughness)) || (coat && smooth(b.clearcoatRoughness));
  }
  kinds.pane = kinds.pane || (kinds.volumes && volumesOverlap(scene));
  return kinds;
}

std::vector<std::string> classesNotCovered(const Scene& scene, bool caustics) {
  const MaterialKinds kinds = materialKinds(scene);
  static constexpr struct { LightKind kind; const char* name; } kNames[] = {
      {LightKind::Point, "point"}, {LightKind::Spot, "spot"}, {LightKind::Directional, "directional"}, {LightKind::Rect, "rectangle"},
      {LightKind::Disk, "disk"}, {LightKind::Sphere, "sphere"}, {LightKind::Mesh, "mesh"}, {LightKind::Environment, "environment"}};
  static constexpr const char* kThrough[] = {"open ways", "boundaries of index 1", "clear panes", "mirrors and smooth refraction (caustics)"};
  std::vector<std::string> missing;
  for (const Receiver r : kReceivers) {
    if (r == Receiver::Volume && !kinds.scatters) continue;
    bool kind[std::size(kNames)] = {}, way[std::size(kPassages)] = {};
    for (const Light& l : scene.lights)
      for (const Passage p : kPassages) {
        if (!kinds.occurs(p) || !outOfReach(l.shape.kind, l.cameraVisible, r, p, caustics)) continue;
        for (size_t k = 0; k < std::size(kNames); ++k) kind[k] = kind[k] || kNames[k].kind == l.shape.kind;
        way[size_t(p)] = true;
      }
    std::vector<std::string> lights, ways;
    for (size_t k = 0; k < std::size(kNames); ++k) if (kind[k]) lights.push_back(kNames[k].name);
    for (size_t p = 0; p < std::size(kPassages); ++p) if (way[p]) ways.push_back(kThrough[p]);
    if (!lights.empty()) missing.push_back(listed(lights) + " lights through " + listed(ways) + (r == Receiver::Volume ? ", scattered by volumes" : ", on surfaces"));
  }
  return missing;
}

}  // namespace gobo
