// SPDX-License-Identifier: Apache-2.0
// PlainMeshLight: the commonest lamp, an untextured opaque mesh that is the only light. Next-event estimation for it runs on 8
// lanes at once where the picked triangle is far, and by sampleNear where it is near; its density is MeshLight's, so that both give the
// same MIS weights.
#pragma once

#include <vector>

#include "scene/scene.h"
#include "trace/facing_triangles.h"
#include "trace/light_sampling.h"
#include "trace/spherical_triangle.h"

namespace gobo {
inline namespace trace {

struct PlainMeshLight {
  struct Triangle {
    Vec3 p, e1, e2, n;
  };
  std::vector<Triangle> triangles;  ///< world space; n: unit outside normal
  struct Entry {
    float keep = 1.0f;
    uint32_t alias = 0;
  };
  std::vector<Entry> table;  ///< alias table over areas
  FacingTriangles facing;    ///< weights: areas; empty: the table alone decides
  float area = 0.0f;
  bool doubleSided = false;

  /// False if the light's instance is textured, has coverage, or has no area.
  bool build(const SceneView& view, const LightShape& shape);
  /// A direction to the triangle `t`, `near` as the receiver sees it (valid), that was picked from `visible` m^2; `u` is the place in it. False: none.
  bool sampleNear(const Triangle& t, const SphericalTriangle& near, float visible, const Vec2& u, LightSample& out) const;
  /// `visible`: the area that the choice was made from, 0 where the receiver p sees no front.
  const Triangle& pick(float u, const Vec3& p, float& visible) const {
    if (!facing.empty()) {
      const double mass = facing.mass(DVec3(p));
      visible = float(mass);
      return triangles[mass > 0 ? facing.pick(DVec3(p), mass, u) : 0];
    }
    visible = area;
    const float scaled = u * float(table.size());
    const size_t slot = size_t(scaled) < table.size() ? size_t(scaled) : table.size() - 1;
    return triangles[scaled - float(slot) < table[slot].keep ? slot : table[slot].alias];
  }
};

}  // namespace trace
}  // namespace gobo
