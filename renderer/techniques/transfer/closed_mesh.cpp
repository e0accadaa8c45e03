// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/closed_mesh.h"

#include <algorithm>
#include <vector>

#include "scene/mesh_filters/weld.h"

namespace gobo::transfer {

namespace {

/// Of the cube about a mesh, six times: a sheet that lies on its own back encloses nothing, but for rounding.
constexpr double kNoVolume = 1e-12;

}  // namespace

bool hidesBacks(const Array<uint32_t>& indices, const Array<Vec3>& positions) {
  Mesh bare;
  bare.indices = indices;
  bare.positions = positions;
  WeldedMesh mesh;
  if (!weld(bare, glm::dmat3(1.0), {}, mesh) || mesh.points.empty()) return false;
  std::vector<uint64_t> there, back;  // directed edges, and the same turned round
  there.reserve(3 * mesh.triangles());
  back.reserve(3 * mesh.triangles());
  DVec3 lo = mesh.points[0], hi = lo;
  double volume = 0;  // six times
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    DVec3 from[3];
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = mesh.corner(t, k), b = mesh.corner(t, (k + 1) % 3);
      there.push_back(uint64_t(a) << 32 | b);
      back.push_back(uint64_t(b) << 32 | a);
      lo = glm::min(lo, mesh.points[a]);
      hi = glm::max(hi, mesh.points[a]);
      from[k] = mesh.points[a] - mesh.points[0];
    }
    volume += glm::dot(from[0], glm::cross(from[1], from[2]));
  }
  const DVec3 size = hi - lo;
  if (!(volume > kNoVolume * std::max({size.x * size.x * size.x, size.y * size.y * size.y, size.z * size.z * size.z}))) return false;
  std::sort(there.begin(), there.end());
  std::sort(back.begin(), back.end());
  return there == back;
}

}  // namespace gobo::transfer
