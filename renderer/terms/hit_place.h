// SPDX-License-Identifier: Apache-2.0
// Where a ray hit a surface, and how that is turned: what G-buffers write of a hit.
#pragma once

#include <cmath>

#include "trace/accel.h"
#include "trace/accel_impl.h"

namespace gobo {
inline namespace terms {

/// From the triangle's vertices: closer to the surface than origin + t direction.
inline Vec3 hitPosition(const Accel& accel, const Hit& hit) {
  const InstanceGeometry& g = accel.impl().instances[hit.instance];
  const uint32_t* tri = g.indices + 3 * size_t(hit.primitive);
  const float b[3] = {1.0f - hit.u - hit.v, hit.u, hit.v};
  Vec3 p(0.0f);
  for (int k = 0; k < 3; ++k) p += b[k] * g.positions[tri[k]];
  return g.world ? p : Vec3(g.toWorld * Vec4(p, 1.0f));
}

struct HitNormals {
  Vec3 shading, geometric;  ///< unit, towards where the ray came from
};
/// `normals`: of the mesh's vertices; may be empty.
template <class Normals>
HitNormals hitNormals(const Normals& normals, const InstanceGeometry& g, const Vec3& direction, const Hit& hit) {
  const uint32_t* tri = g.indices + 3 * size_t(hit.primitive);
  const float b[3] = {1.0f - hit.u - hit.v, hit.u, hit.v};
  Vec3 n(0.0f);
  if (!normals.empty())
    for (int k = 0; k < 3; ++k) n += b[k] * normals[tri[k]];
  const Vec3 ng = glm::dot(hit.Ng, direction) < 0 ? hit.Ng : -hit.Ng;
  n = g.normalToWorld * n;
  const float length = glm::length(n);
  // Cofactors are of the scale squared: a mesh in micrometres has normals of 1e-12. Below 1e-18 squares leave float's range.
  n = length > 1e-18f && std::isfinite(length) ? n / length : ng;
  if (glm::dot(n, ng) < 0) n = -n;
  if (glm::dot(n, direction) >= 0) n = ng;  // a shading normal that faces away from the viewer shades nothing
  return {n, ng};
}

}  // namespace terms
}  // namespace gobo
