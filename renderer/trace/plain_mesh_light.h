// SPDX-License-Identifier: Apache-2.0
// PlainMeshLight: the commonest lamp, an untextured opaque mesh that is the only light. Next-event estimation for it runs on 8
// lanes at once; its density is MeshLight's (uniform over the area), so that both give the same MIS weights.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace gobo {

struct PlainMeshLight {
  struct Triangle { Vec3 p, e1, e2, n; };
  std::vector<Triangle> triangles;         ///< world space; n: unit outside normal
  struct Entry { float keep = 1.0f; uint32_t alias = 0; };
  std::vector<Entry> table;                ///< alias table over areas
  float area = 0.0f;
  bool doubleSided = false;

  /// False if the light's instance is textured, has coverage, or has no area.
  bool build(const SceneView& view, const LightShape& shape);
  const Triangle& pick(float u) const {
    const float scaled = u * float(table.size());
    const size_t slot = size_t(scaled) < table.size() ? size_t(scaled) : table.size() - 1;
    return triangles[scaled - float(slot) < table[slot].keep ? slot : table[slot].alias];
  }
};

}  // namespace gobo
