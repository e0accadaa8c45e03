// SPDX-License-Identifier: Apache-2.0
// Closed and open surfaces whose areas and volumes are known, and what tests measure of a mesh.
#pragma once

#include <map>
#include <set>
#include <utility>
#include <vector>

#include "base/sobol.h"
#include "scene/builtin/build.h"
#include "scene/mesh_view.h"

namespace gobo::tests {

inline MeshPtr sealedMesh(Mesh mesh) {
  auto out = std::make_shared<Mesh>(std::move(mesh));
  sealMesh(*out);
  return out;
}

/// Around the origin, with a seam and poles of several vertices.
inline MeshPtr ballMesh(float radius, int slices, bool smooth = true) {
  builtin::MeshBuilder b;
  b.sphere(Vec3(0.0f), radius, slices, slices / 2);
  return b.finish("ball", 0, smooth);
}

/// Faces of n x n cells with vertices of their own.
inline MeshPtr boxMesh(float half, int n) {
  builtin::MeshBuilder b;
  for (int axis = 0; axis < 3; ++axis)
    for (float side : {-1.0f, 1.0f}) {
      Vec3 m(0.0f), u(0.0f), v(0.0f);
      m[axis] = side * half;
      u[(axis + 1) % 3] = side * half;
      v[(axis + 2) % 3] = half;
      b.quad(m - u - v, 2.0f * u, 2.0f * v, n, n);
    }
  return b.finish("box", 0);
}

/// n x m quads around a ring: vertices are shared, each has six neighbours. Without attributes.
inline Mesh torusMesh(int n, int m, float ring = 2.0f, float tube = 0.7f) {
  Mesh mesh;
  std::vector<Vec3> p;
  std::vector<uint32_t> t;
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i) {
      const double a = 2.0 * M_PI * i / n, b = 2.0 * M_PI * j / m, r = ring + tube * std::cos(b);
      p.emplace_back(r * std::cos(a), tube * std::sin(b), -r * std::sin(a));
    }
  const auto at = [&](int i, int j) { return uint32_t((j % m) * n + i % n); };
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i) t.insert(t.end(), {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1)});
  mesh.positions = Array<Vec3>(std::move(p));
  mesh.indices = Array<uint32_t>(std::move(t));
  return mesh;
}

/// n x n cells of `cell` metres in the plane z = 0 from the origin.
inline MeshPtr sheetMesh(int n, float cell) {
  builtin::MeshBuilder b;
  b.quad(Vec3(0.0f), Vec3(n * cell, 0, 0), Vec3(0, n * cell, 0), n, n);
  return b.finish("sheet", 0);
}

/// Corners of triangle t.
inline std::array<DVec3, 3> cornersOf(const Mesh& m, size_t t) {
  return {DVec3(m.positions[m.indices[3 * t]]), DVec3(m.positions[m.indices[3 * t + 1]]), DVec3(m.positions[m.indices[3 * t + 2]])};
}
inline double areaOf(const Mesh& m) {
  double sum = 0;
  for (size_t t = 0; t < m.triangles(); ++t) {
    const auto [p, q, r] = cornersOf(m, t);
    sum += 0.5 * glm::length(glm::cross(q - p, r - p));
  }
  return sum;
}
/// Of a closed mesh, by the divergence theorem.
inline double volumeOf(const Mesh& m) {
  double sum = 0;
  for (size_t t = 0; t < m.triangles(); ++t) {
    const auto [p, q, r] = cornersOf(m, t);
    sum += glm::dot(p, glm::cross(q, r)) / 6.0;
  }
  return sum;
}

using Place = std::array<float, 3>;
inline Place placeOf(const Vec3& p) { return {p.x + 0.0f, p.y + 0.0f, p.z + 0.0f}; }
inline size_t placesOf(const Mesh& m) {
  std::set<Place> places;
  for (const uint32_t i : m.indices) places.insert(placeOf(std::as_const(m).positions[i]));
  return places.size();
}
/// Edges, by position, that some triangle has and none has the other way round: where a closed surface is torn.
inline size_t tornEdges(const Mesh& m) {
  std::set<std::pair<Place, Place>> edges;
  for (size_t t = 0; t < m.triangles(); ++t)
    for (int k = 0; k < 3; ++k) edges.insert({placeOf(m.positions[m.indices[3 * t + k]]), placeOf(m.positions[m.indices[3 * t + (k + 1) % 3]])});
  size_t torn = 0;
  for (const auto& [a, b] : edges) torn += a != b && !edges.count({b, a});
  return torn;
}
inline bool finiteMesh(const Mesh& m) {
  bool ok = true;
  for (const Vec3& p : m.positions) ok = ok && isFinite(p);
  for (const Vec3& n : m.normals) ok = ok && isFinite(n) && std::fabs(glm::length(n) - 1.0f) < 1e-4f;
  for (const Vec4& t : m.tangents) ok = ok && isFinite(Vec3(t)) && std::fabs(t.w) == 1.0f;
  for (const auto& set : m.uv)
    for (const Vec2& v : set) ok = ok && std::isfinite(v.x) && std::isfinite(v.y);
  return ok;
}

}  // namespace gobo::tests
