// SPDX-License-Identifier: Apache-2.0
#include "plan/material_kinds.h"

#include "plan/planner.h"
#include "trace/bsdf.h"
#include "trace/interior.h"
#include "trace/straight.h"
#include "trace/surface.h"

namespace gobo {

namespace {

/// Smooth enough to be a mirror. A roughness texture may reach 0 where the factor does not: where is not looked for.
bool smooth(float roughness) { return roughness * roughness < kDeltaAlpha; }
/// Anisotropy widens the lobe along the tangent.
bool smooth(const Bsdf& b) { return smooth(b.roughness) && !(b.anisotropy * b.anisotropy >= kDeltaAlpha); }

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
    // Light goes straight through an index of 1, however rough the surface, and nothing is reflected where that is all: shadow rays reach it.
    const bool straight = b.transmission > 0.0f && std::fabs(b.ior - 1.0f) < kStraightIor;
    const bool nothingElse = straight && b.transmission >= 1.0f && !b.transmissionTexture.valid();
    const bool interface = b.metallic > 0.0f || (!nothingElse && (b.transmission > 0.0f || b.specular > 0.0f || b.iridescence > 0.0f));
    kinds.clear = kinds.clear || maySendStraight(b);
    kinds.extended = kinds.extended || s.extended;
    kinds.translucent = kinds.translucent || b.diffuseTransmission > 0.0f || (b.transmission > 0.0f && !smooth(b) && !straight);
    kinds.volumes = kinds.volumes || boundsVolume(b);
    kinds.scatters = kinds.scatters || (boundsVolume(b) && makeInterior(b).scatters);
    kinds.delta = kinds.delta || (interface && smooth(b.roughness)) || (b.clearcoat > 0.0f && smooth(b.clearcoatRoughness));
  }
  return kinds;
}

std::vector<std::string> classesNotCovered(const Scene& scene, bool caustics) {
  bool delta = false;
  for (const Light& l : scene.lights) delta = delta || isDeltaLight(l.shape.kind);
  const MaterialKinds kinds = materialKinds(scene);
  if (!delta || !kinds.delta) return {};
  if (!caustics) return {"point, spot and directional lights seen through a specular chain (their caustics and mirror images)"};
  if (kinds.scatters) return {"caustics of point, spot and directional lights inside scattering volumes"};
  return {};
}

}  // namespace gobo
