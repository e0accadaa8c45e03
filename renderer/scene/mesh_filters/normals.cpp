// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/normals.h"

#include <cmath>

#include "scene/mesh_filters/numbering.h"

namespace gobo {
inline namespace scene {

bool joinSimilarNormals(const Mesh& mesh, const WeldedMesh& welded, const std::function<void(uint32_t, uint32_t)>& join, const StopToken& stop) {
  const size_t n = welded.pointOf.size(), points = welded.points.size();
  // Vertices of each point, in their order.
  std::vector<uint32_t> first(points + 1, 0), vertices(n);
  for (const uint32_t p : welded.pointOf) ++first[p + 1];
  for (size_t i = 0; i < points; ++i) first[i + 1] += first[i];
  std::vector<uint32_t> at(first.begin(), first.end() - 1);
  for (size_t v = 0; v < n; ++v) vertices[at[welded.pointOf[v]]++] = uint32_t(v);
  const Array<Vec3>& normals = mesh.normals;
  std::vector<uint32_t> sides;
  for (size_t i = 0; i < points; ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
    sides.clear();
    for (uint32_t k = first[i]; k < first[i + 1]; ++k) {
      const uint32_t v = vertices[k];
      bool found = false;
      for (const uint32_t side : sides) {
        if (!(glm::dot(normals[side], normals[v]) > kSameSide)) continue;
        join(side, v);
        found = true;
        break;
      }
      if (!found) sides.push_back(v);
    }
  }
  return true;
}

DVec3 turned(const DVec3& v, const DVec3& from, const DVec3& to) {
  const DVec3 sum = from + to;
  const double c = 1.0 + glm::dot(from, to);
  if (!(c > 1e-12)) return -v;
  return v - sum * (glm::dot(sum, v) / c) + to * (2.0 * glm::dot(from, v));
}

bool turnNormals(Mesh& mesh, const WeldedMesh& welded, const std::vector<DVec3>& before, const glm::dmat3& stretch, const StopToken& stop) {
  if (mesh.normals.empty()) return true;
  const size_t n = welded.pointOf.size();
  std::vector<uint32_t> side(n);
  for (size_t v = 0; v < n; ++v) side[v] = uint32_t(v);
  if (!joinSimilarNormals(
          mesh, welded, [&](uint32_t a, uint32_t b) { side[b] = a; }, stop))
    return false;
  std::vector<DVec3> was(n, DVec3(0.0)), is(n, DVec3(0.0));
  for (size_t t = 0; t < welded.triangles(); ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t c[] = {welded.corner(t, 0), welded.corner(t, 1), welded.corner(t, 2)};
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = c[k], b = c[(k + 1) % 3], d = c[(k + 2) % 3], s = side[welded.indices[3 * t + size_t(k)]];
      was[s] += cornerNormal(before[a], before[b], before[d]);
      is[s] += cornerNormal(welded.points[a], welded.points[b], welded.points[d]);
    }
  }
  const glm::dmat3 shrink = glm::inverse(stretch);
  std::vector<Vec3> normals(mesh.normals.begin(), mesh.normals.end());
  std::vector<Vec4> tangents(mesh.tangents.begin(), mesh.tangents.end());
  for (size_t v = 0; v < n; ++v) {
    if (v % kFilterPoll == 0 && stop.stopRequested()) return false;
    const DVec3 &from = was[side[v]], &to = is[side[v]];
    const double a = glm::length(from), b = glm::length(to);
    if (!(a > kLeastNormal && b > kLeastNormal)) continue;
    // Normals are stretched by the inverse, and tangents as the surface is.
    const auto turn = [&](const Vec3& vector, const glm::dmat3& in, const glm::dmat3& out) {
      const DVec3 unit = glm::normalize(in * DVec3(vector)), moved = out * turned(unit, from / a, to / b);
      const Vec3 result(glm::normalize(moved));
      return isFinite(result) ? result : vector;
    };
    normals[v] = turn(normals[v], shrink, stretch);
    if (!tangents.empty()) tangents[v] = Vec4(turn(Vec3(tangents[v]), stretch, shrink), tangents[v].w);
  }
  mesh.normals = Array<Vec3>(std::move(normals));
  if (!tangents.empty()) mesh.tangents = Array<Vec4>(std::move(tangents));
  return true;
}

}  // namespace scene
}  // namespace gobo
