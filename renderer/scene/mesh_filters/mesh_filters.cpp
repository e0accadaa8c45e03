// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/mesh_filters.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "scene/coordinates.h"
#include "scene/mesh_filters/cluster.h"
#include "scene/mesh_filters/normals.h"
#include "scene/mesh_filters/numbering.h"
#include "scene/mesh_filters/quadric.h"
#include "scene/mesh_filters/smooth.h"

namespace gobo {
inline namespace scene {

namespace {

// Of the longest axis of an object.
constexpr double kThinnest = 1e-7, kRoundable = 0x1p-12;

bool hasArea(const Array<uint32_t>& indices, const Array<Vec3>& positions) {
  for (size_t t = 0; t + 2 < indices.size(); t += 3) {
    const DVec3 p(positions[indices[t]]), q(positions[indices[t + 1]]), r(positions[indices[t + 2]]);
    if (glm::length(glm::cross(q - p, r - p)) > 0.0) return true;
  }
  return false;
}

}  // namespace

glm::dmat3 stretchOf(const Mat4& toWorld) {
  glm::dmat3 m{glm::mat3(toWorld)};
  if (m == glm::dmat3(0.0)) return glm::dmat3(1.0);
  const SymmetricEigen e = symmetricEigen(glm::transpose(m) * m);
  const double largest = std::sqrt(std::max({e.value.x, e.value.y, e.value.z}));
  double smallest = largest;
  glm::dmat3 s(0.0);
  for (int k = 0; k < 3; ++k) {
    // Flat objects (scene/rig_pose.cpp makes them 1e-6 thick) have an inverse.
    const double value = std::max(std::sqrt(std::max(e.value[k], 0.0)), kThinnest * largest);
    smallest = std::min(smallest, value);
    s += glm::outerProduct(e.vector[k], e.vector[k]) * value;
  }
  if (smallest > kRoundable * largest) {  // or rounding could take the thin axis away
    const double unit = std::ldexp(1.0, std::ilogb(largest) - 17);
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) s[c][r] = std::round(s[c][r] / unit) * unit;
  }
  return s;
}

Result<FilteredMesh> filterMesh(const MeshPtr& mesh, const MeshFilter& filter, const StopToken& stop) {
  const Status stopped(Code::Cancelled, "stopped");
  if (filter.identity() || !hasArea(mesh->indices, mesh->positions)) return FilteredMesh{FilteredMesh::End::Made, mesh};
  auto made = std::make_shared<Mesh>(*mesh);  // arrays are shared until they change
  WeldedMesh welded;
  PointGraph graph;
  if (!weld(*mesh, filter.stretch, stop, welded)) return stopped;
  const bool smooths = filter.smooth > 0 && filter.step > 0.0;
  if (filter.cluster > 0.0) {
    VertexClusters clusters;
    if (!connect(welded, stop, graph) || !clusterPoints(welded, graph, filter.cluster, stop, clusters)) return stopped;
    if (!mergeClusters(clusters, *made, welded, stop)) return stopped;
    if (welded.indices.empty()) return FilteredMesh{FilteredMesh::End::Clustered, nullptr};
  }
  if (smooths || filter.inflate != 0.0) {
    const std::vector<DVec3> before = welded.points;
    if (smooths) {
      if (!connect(welded, stop, graph)) return stopped;
      const double out = filter.smoothing == MeshSmoothing::Taubin ? taubinStepOut(filter.step) : 0.0;
      if (!smoothPoints(welded.points, graph, filter.smooth, filter.step, out, stop)) return stopped;
    }
    if (filter.inflate != 0.0) {
      std::vector<DVec3> normals;
      if (!pointNormals(welded, stop, normals)) return stopped;
      for (size_t i = 0; i < normals.size(); ++i) welded.points[i] += normals[i] * filter.inflate;
    }
    if (!turnNormals(*made, welded, before, filter.stretch, stop)) return stopped;
  }

  // Back to the object's coordinates as a displacement: what did not move keeps its bits.
  const glm::dmat3 shrink = glm::inverse(filter.stretch);
  std::vector<Vec3> at(welded.points.size());
  for (size_t i = 0; i < at.size(); ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return stopped;
    const DVec3 rest(welded.rest[i]), p = rest + shrink * (welded.points[i] - filter.stretch * rest);
    if (!isCoordinate(p)) return FilteredMesh{FilteredMesh::End::Beyond, nullptr};
    at[i] = Vec3(p);
  }
  std::vector<Vec3> positions(welded.pointOf.size());
  for (size_t v = 0; v < positions.size(); ++v) positions[v] = at[welded.pointOf[v]];
  made->positions = Array<Vec3>(std::move(positions));
  if (!hasArea(std::as_const(*made).indices, std::as_const(*made).positions))
    return FilteredMesh{smooths ? FilteredMesh::End::Smoothed : FilteredMesh::End::Clustered, nullptr};
  sealMesh(*made);
  if (stop.stopRequested()) return stopped;
  return FilteredMesh{FilteredMesh::End::Made, std::move(made)};
}

}  // namespace scene
}  // namespace gobo
