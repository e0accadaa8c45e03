// SPDX-License-Identifier: Apache-2.0
#include "trace/plain_mesh_light.h"

#include <algorithm>

namespace gobo {
inline namespace trace {

bool PlainMeshLight::build(const SceneView& view, const LightShape& shape) {
  const Instance& instance = view.instances()[shape.instance];
  const auto mesh = view.mesh<Facet::Topology | Facet::Pose>(instance.mesh);
  const Coverage& coverage = view.coverage(mesh.material);
  if (coverage.mode != AlphaMode::Opaque || view.emission(mesh.material).texture.valid()) return false;
  if (mesh.triangles() > (1u << 16)) return false;  // a draw has 24 bits: they must do for the triangle and its share
  doubleSided = coverage.doubleSided;
  const glm::dmat4 m(instance.toWorld);
  const double flip = glm::determinant(glm::dmat3(m)) < 0 ? -1.0 : 1.0;
  std::vector<double> areas;
  double total = 0;
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    DVec3 v[3];
    for (int c = 0; c < 3; ++c) v[c] = DVec3(m * glm::dvec4(DVec3(mesh.positions[mesh.indices[3 * t + c]]), 1.0));
    const DVec3 n = glm::cross(v[1] - v[0], v[2] - v[0]);
    const double length = glm::length(n);
    if (!(length > 0)) continue;
    triangles.push_back({Vec3(v[0]), Vec3(v[1] - v[0]), Vec3(v[2] - v[0]), Vec3(n * (flip / length))});
    areas.push_back(0.5 * length);
    total += 0.5 * length;
  }
  area = float(total);
  // Squares of distances must stay inside float: lamps of ordinary size only (a millionth of a metre to a thousand kilometres).
  if (!(area > 1e-12f && area < 1e12f)) return false;
  // By all triangles, those without area too, as MeshLight decides: draws here are weighed against its densities.
  if (!doubleSided && mesh.triangles() <= FacingTriangles::kMost)
    for (size_t t = 0; t < triangles.size(); ++t) facing.add(triangles[t].p, triangles[t].n, areas[t]);
  const size_t n = areas.size();
  table.resize(n);
  std::vector<size_t> small, large;
  for (size_t i = 0; i < n; ++i) {
    areas[i] *= double(n) / total;
    (areas[i] < 1.0 ? small : large).push_back(i);
  }
  while (!small.empty() && !large.empty()) {  // Vose 1991
    const size_t s = small.back(), l = large.back();
    small.pop_back();
    table[s] = {float(areas[s]), uint32_t(l)};
    areas[l] -= 1.0 - areas[s];
    if (areas[l] < 1.0) {
      large.pop_back();
      small.push_back(l);
    }
  }
  return true;
}

bool PlainMeshLight::sampleNear(const Triangle& t, const SphericalTriangle& near, float visible, const Vec2& u, LightSample& out) const {
  if (!(visible > 0.0f)) return false;
  Vec2 b;
  const DVec3 d = near.sample(u.x, u.y, b);
  const double length = glm::length(d), side = glm::dot(d, DVec3(t.n)) / length;
  if (!(length > 0) || (doubleSided ? std::fabs(side) < 1e-9 : side > -1e-9)) return false;
  out = {Vec3(d / length), float(length), Vec3(1.0f), float(std::min(near.area() / near.solidAngle() / double(visible), 1e37)), false};
  return out.distance > 0.0f && out.pdf > 0.0f;
}

}  // namespace trace
}  // namespace gobo
