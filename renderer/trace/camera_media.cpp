// SPDX-License-Identifier: Apache-2.0
#include "trace/camera_media.h"

#include <algorithm>

#include "trace/interior.h"

namespace gobo {
inline namespace trace {

std::vector<int> volumesAround(const SceneView& view, const Vec3& p, const StopToken& stop) {
  struct Found {
    double size;
    int material;
  };
  std::vector<Found> found;
  for (const Instance& instance : view.instances()) {
    const auto mesh = view.mesh<Facet::Topology | Facet::Pose>(instance.mesh);
    if (mesh.positions.empty() || !boundsVolume(view.bsdf(mesh.material))) continue;
    const glm::dmat4 toWorld(instance.toWorld);
    if (stop.stopRequested()) return {};
    DVec3 lo(1e300), hi(-1e300);
    for (const Vec3& v : mesh.positions) {
      const DVec3 w(toWorld * glm::dvec4(DVec3(v), 1.0));
      lo = glm::min(lo, w);
      hi = glm::max(hi, w);
    }
    const DVec3 q(p);
    if (glm::any(glm::lessThan(q, lo)) || glm::any(glm::greaterThan(q, hi))) continue;
    double angle = 0;
    for (size_t t = 0; t < mesh.triangles(); ++t) {
      if (t % 4096 == 0 && stop.stopRequested()) return {};
      DVec3 r[3];
      double l[3];
      for (int c = 0; c < 3; ++c) {
        r[c] = DVec3(toWorld * glm::dvec4(DVec3(mesh.positions[mesh.indices[3 * t + c]]), 1.0)) - q;
        l[c] = glm::length(r[c]);
      }
      angle += 2.0 * std::atan2(glm::dot(r[0], glm::cross(r[1], r[2])),
                                l[0] * l[1] * l[2] + glm::dot(r[0], r[1]) * l[2] + glm::dot(r[1], r[2]) * l[0] + glm::dot(r[2], r[0]) * l[1]);
    }
    if (glm::determinant(glm::dmat3(toWorld)) < 0) angle = -angle;  // outside stays outside under a mirroring transform (glTF 3.7.4)
    if (angle > 0.5 * 4.0 * M_PI) found.push_back({glm::length(hi - lo), mesh.material});
  }
  std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.size > b.size; });
  std::vector<int> materials;
  for (const Found& f : found) materials.push_back(f.material);
  return materials;
}

Vec3 cameraPoint(const Camera& c) {
  const Vec3 position(c.toWorld[3]);
  if (c.perspective) return position;
  return position + (Vec3(c.toWorld[0]) * c.centre.x + Vec3(c.toWorld[1]) * c.centre.y) * c.yheight;
}

}  // namespace trace
}  // namespace gobo
