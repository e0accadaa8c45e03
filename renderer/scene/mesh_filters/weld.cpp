// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/weld.h"

#include <algorithm>
#include <cmath>

#include "scene/mesh_filters/numbering.h"

namespace gobo {
inline namespace scene {

bool weld(const Mesh& mesh, const glm::dmat3& stretch, const StopToken& stop, WeldedMesh& out) {
  const size_t n = mesh.positions.size();
  out.indices.assign(mesh.indices.begin(), mesh.indices.end());
  out.pointOf.resize(n);
  out.rest.clear();
  out.points.clear();
  float farthest = 0.0f;
  for (const Vec3& p : mesh.positions) farthest = std::max({farthest, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  // Points by cells much larger than the tolerance: who is near a wall is looked for on both sides of it.
  const double near = kWeldTolerance * double(farthest), cell = 16.0 * near;
  Numbering cells(n);
  std::vector<uint32_t> first, next;
  const auto index = [&](double x) { return farthest > 0.0f ? uint64_t(int64_t(std::floor(x / cell))) : 0; };
  for (size_t i = 0; i < n; ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
    const Vec3 p = mesh.positions[i];
    const DVec3 at(p);
    uint64_t lo[3], hi[3];
    for (int k = 0; k < 3; ++k) {
      lo[k] = index(at[k] - near);
      hi[k] = index(at[k] + near);
    }
    uint32_t point = kNoPoint;  // the first of those that are near
    for (uint64_t x = lo[0]; x != hi[0] + 1; ++x)
      for (uint64_t y = lo[1]; y != hi[1] + 1; ++y)
        for (uint64_t z = lo[2]; z != hi[2] + 1; ++z) {
          const uint32_t c = cells.find(x, y, z);
          for (uint32_t q = c == Numbering::kNone ? kNoPoint : first[c]; q != kNoPoint; q = next[q]) {
            const DVec3 away = glm::abs(DVec3(out.rest[q]) - at);
            if (std::max({away.x, away.y, away.z}) <= near) point = std::min(point, q);
          }
        }
    if (point == kNoPoint) {
      point = uint32_t(out.rest.size());
      out.rest.push_back(p + 0.0f);  // -0 becomes 0
      out.points.push_back(stretch * at);
      const uint32_t c = cells.of(index(at.x), index(at.y), index(at.z));
      if (c == first.size()) first.push_back(kNoPoint);
      next.push_back(first[c]);
      first[c] = point;
    }
    out.pointOf[i] = point;
  }
  return true;
}

bool connect(const WeldedMesh& mesh, const StopToken& stop, PointGraph& out) {
  const size_t points = mesh.points.size(), triangles = mesh.triangles();
  const auto flat = [&](size_t t) {
    return mesh.corner(t, 0) == mesh.corner(t, 1) || mesh.corner(t, 1) == mesh.corner(t, 2) || mesh.corner(t, 2) == mesh.corner(t, 0);
  };
  // Each triangle tells each corner of both others: an edge of two triangles is told twice to both of its ends, one of the rim once.
  std::vector<uint32_t> first(points + 1, 0);
  for (size_t t = 0; t < triangles; ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    if (flat(t)) continue;
    for (int k = 0; k < 3; ++k) first[mesh.corner(t, k) + 1] += 2;
  }
  for (size_t i = 0; i < points; ++i) first[i + 1] += first[i];
  struct Told {
    uint32_t point, triangle;
    bool out;  ///< the triangle goes from here to `point`
  };
  std::vector<Told> told(first[points]);
  std::vector<uint32_t> at(first.begin(), first.end() - 1);
  for (size_t t = 0; t < triangles; ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    if (flat(t)) continue;
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = mesh.corner(t, k);
      told[at[a]++] = {mesh.corner(t, (k + 1) % 3), uint32_t(t), true};
      told[at[a]++] = {mesh.corner(t, (k + 2) % 3), uint32_t(t), false};
    }
  }
  out = {};
  out.first.assign(1, 0);
  std::vector<uint32_t> all, rim;
  for (size_t i = 0; i < points; ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
    const auto begin = told.begin() + first[i], end = told.begin() + first[i + 1];
    std::sort(begin, end, [](const Told& a, const Told& b) { return a.point != b.point ? a.point < b.point : a.triangle < b.triangle; });
    all.clear();
    rim.clear();
    for (auto a = begin; a != end;) {
      const auto b = std::find_if(a, end, [&](const Told& other) { return other.point != a->point; });
      all.push_back(a->point);
      if (b - a == 1) {
        rim.push_back(a->point);
        if (a->out) {
          out.rim.insert(out.rim.end(), {uint32_t(i), a->point});
          out.rimOf.push_back(a->triangle);
        }
      }
      a = b;
    }
    const std::vector<uint32_t>& neighbours = rim.empty() ? all : rim;
    out.neighbour.insert(out.neighbour.end(), neighbours.begin(), neighbours.end());
    out.first.push_back(uint32_t(out.neighbour.size()));
  }
  return true;
}

DVec3 cornerNormal(const DVec3& at, const DVec3& next, const DVec3& last) {
  const DVec3 u = next - at, v = last - at, n = glm::cross(u, v);
  const double length = glm::length(n);
  return length > 0.0 ? n * (std::atan2(length, glm::dot(u, v)) / length) : DVec3(0.0);
}

bool pointNormals(const WeldedMesh& mesh, const StopToken& stop, std::vector<DVec3>& out) {
  out.assign(mesh.points.size(), DVec3(0.0));
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t c[] = {mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2)};
    for (int k = 0; k < 3; ++k) out[c[k]] += cornerNormal(mesh.points[c[k]], mesh.points[c[(k + 1) % 3]], mesh.points[c[(k + 2) % 3]]);
  }
  for (size_t i = 0; i < out.size(); ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
    const double length = glm::length(out[i]);
    out[i] = length > kLeastNormal ? out[i] / length : DVec3(0.0);
  }
  return true;
}

}  // namespace scene
}  // namespace gobo
