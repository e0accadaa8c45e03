// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/cluster.h"

#include <algorithm>
#include <cmath>

#include "scene/mesh_filters/normals.h"
#include "scene/mesh_filters/numbering.h"
#include "scene/mesh_filters/quadric.h"

namespace gobo {
inline namespace scene {

namespace {

/// Sets that grow together, each named by its least member: the result does not depend on the order of unions.
class ClusterSets {
 public:
  explicit ClusterSets(size_t n) : parent_(n) {
    for (size_t i = 0; i < n; ++i) parent_[i] = uint32_t(i);
  }
  uint32_t find(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(uint32_t a, uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parent_;
};

uint64_t bitsOfIndex(double whole) { return std::bit_cast<uint64_t>(whole + 0.0); }  // -0 is 0

/// Sums of one attribute over the members of a set.
template <typename V>
struct ClusterMean {
  std::vector<glm::vec<V::length(), double>> sum;
  explicit ClusterMean(size_t sets) : sum(sets, glm::vec<V::length(), double>(0.0)) {}
};

/// One value a set, the weighted mean of its members'.
template <typename V>
Array<V> meansOf(const Array<V>& values, const std::vector<uint32_t>& setOf, const std::vector<double>& weight, const std::vector<double>& total) {
  if (values.empty()) return {};
  ClusterMean<V> mean(total.size());
  for (size_t i = 0; i < values.size(); ++i)
    if (setOf[i] != kNoPoint) mean.sum[setOf[i]] += weight[i] * glm::vec<V::length(), double>(values[i]);
  std::vector<V> out(total.size());
  for (size_t s = 0; s < out.size(); ++s) out[s] = V(mean.sum[s] / total[s]);
  return Array<V>(std::move(out));
}

/// Directions: of unit length, the heaviest member's where they cancel.
void unitMeans(Array<Vec3>& values, const std::vector<uint32_t>& setOf, const std::vector<double>& weight, const std::vector<double>& total) {
  const Array<Vec3> members = values;
  values = meansOf(members, setOf, weight, total);
  std::vector<uint32_t> heaviest(total.size(), kNoPoint);
  for (size_t i = 0; i < members.size(); ++i) {
    const uint32_t s = setOf[i];
    if (s != kNoPoint && (heaviest[s] == kNoPoint || weight[i] > weight[heaviest[s]])) heaviest[s] = uint32_t(i);
  }
  for (size_t s = 0; s < total.size(); ++s) {
    const double length = glm::length(DVec3(values[s]));
    values[s] = length > kLeastMeanDirection ? Vec3(DVec3(values[s]) / length) : members[heaviest[s]];
  }
}

bool bare(const Mesh& m) {
  return m.normals.empty() && m.tangents.empty() && m.colours.empty() && std::all_of(m.uv.begin(), m.uv.end(), [](const auto& set) { return set.empty(); });
}

}  // namespace

bool clusterPoints(const WeldedMesh& mesh, const PointGraph& graph, double side, const StopToken& stop, VertexClusters& out) {
  out = {};
  out.side = side;
  out.of.assign(mesh.points.size(), kNoPoint);
  double farthest = 0.0;
  for (const DVec3& p : mesh.points) farthest = std::max({farthest, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  const bool lattice = farthest / side < 0x1p52;  // beyond, whole numbers are not next to each other any more
  Numbering numbers(mesh.points.size());
  std::vector<DVec3> sum;
  std::vector<uint32_t> members;
  for (size_t k = 0; k < mesh.indices.size(); ++k) {
    if (k % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t point = mesh.pointOf[mesh.indices[k]];
    if (out.of[point] != kNoPoint) continue;
    const DVec3& p = mesh.points[point];
    const DVec3 index(std::round(p.x / side), std::round(p.y / side), std::round(p.z / side));
    const uint32_t cube = lattice ? numbers.of(bitsOfIndex(index.x), bitsOfIndex(index.y), bitsOfIndex(index.z)) : numbers.of(point, 0, 0);
    out.of[point] = cube;
    if (cube == out.centre.size()) {
      out.centre.push_back(lattice ? index * side : p);
      sum.emplace_back(0.0);
      members.push_back(0);
    }
    sum[cube] += p;
    ++members[cube];
  }

  std::vector<Quadric> quadrics(out.centre.size());  // about the cube's centre, so that far from the origin no digits are lost
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t c[] = {mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2)}, q[] = {out.of[c[0]], out.of[c[1]], out.of[c[2]]};
    const DVec3 n = glm::cross(mesh.points[c[1]] - mesh.points[c[0]], mesh.points[c[2]] - mesh.points[c[0]]);
    for (int k = 0; k < 3; ++k)
      if (std::find(q, q + k, q[k]) == q + k) quadrics[q[k]].add(n, mesh.points[c[0]] - out.centre[q[k]]);
  }
  for (size_t e = 0; e < graph.rimOf.size(); ++e) {
    if (e % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t a = graph.rim[2 * e], b = graph.rim[2 * e + 1], t = graph.rimOf[e];
    const DVec3 n =
        glm::cross(mesh.points[mesh.corner(t, 1)] - mesh.points[mesh.corner(t, 0)], mesh.points[mesh.corner(t, 2)] - mesh.points[mesh.corner(t, 0)]);
    const double length = glm::length(n);
    if (!(length > 0.0)) continue;
    const DVec3 edge = mesh.points[b] - mesh.points[a], wall = glm::cross(edge, n / length) * glm::length(edge);  // as long as a square on the edge is large
    quadrics[out.of[a]].add(wall, mesh.points[a] - out.centre[out.of[a]]);
    if (out.of[b] != out.of[a]) quadrics[out.of[b]].add(wall, mesh.points[a] - out.centre[out.of[b]]);
  }

  out.representative.resize(out.centre.size());
  for (size_t c = 0; c < out.centre.size(); ++c) {
    if (c % kFilterPoll == 0 && stop.stopRequested()) return false;
    if (members[c] == 1) out.representative[c] = sum[c];
    else out.representative[c] = out.centre[c] + leastInBox(quadrics[c], sum[c] / double(members[c]) - out.centre[c], DVec3(0.0), 0.5 * side);
  }
  return true;
}

bool mergeClusters(const VertexClusters& clusters, Mesh& mesh, WeldedMesh& welded, const StopToken& stop) {
  const size_t vertices = mesh.positions.size();
  const auto cubeOf = [&](uint32_t vertex) { return clusters.of[welded.pointOf[vertex]]; };
  std::vector<uint32_t> kept;  // triangles
  Numbering once(welded.triangles());
  std::vector<double> weight(vertices, 0.0);  // a third of the area around
  ClusterSets sets(vertices), directions(vertices);
  for (size_t t = 0; t < welded.triangles(); ++t) {
    if (t % kFilterPoll == 0 && stop.stopRequested()) return false;
    const uint32_t* v = &welded.indices[3 * t];
    const uint32_t c[] = {cubeOf(v[0]), cubeOf(v[1]), cubeOf(v[2])};
    const DVec3 &p = welded.points[welded.pointOf[v[0]]], &q = welded.points[welded.pointOf[v[1]]], &r = welded.points[welded.pointOf[v[2]]];
    const double area = 0.5 * glm::length(glm::cross(q - p, r - p));
    for (int k = 0; k < 3; ++k) {
      weight[v[k]] += area / 3.0;
      if (c[k] != c[(k + 1) % 3]) continue;
      sets.join(v[k], v[(k + 1) % 3]);
      directions.join(v[k], v[(k + 1) % 3]);
    }
    if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) continue;
    const int least = c[0] < c[1] ? (c[0] < c[2] ? 0 : 2) : (c[1] < c[2] ? 1 : 2);
    const size_t before = once.size();
    once.of(c[least], c[(least + 1) % 3], c[(least + 2) % 3]);
    if (once.size() > before) kept.push_back(uint32_t(t));
  }
  // Both sides of a seam in texture coordinates have one normal: joined for its mean, or the seam would show.
  if (!mesh.normals.empty() && !joinSimilarNormals(
                                   mesh, welded, [&](uint32_t a, uint32_t b) { directions.join(a, b); }, stop))
    return false;

  const bool oneACube = bare(mesh);
  std::vector<uint32_t> setOf(vertices, kNoPoint), directionOf(vertices, kNoPoint), cubes, like;
  Numbering numbers(kept.size()), directionNumbers(kept.size());
  std::vector<uint32_t> indices;
  indices.reserve(3 * kept.size());
  for (size_t k = 0; k < kept.size(); ++k) {
    if (k % kFilterPoll == 0 && stop.stopRequested()) return false;
    for (int j = 0; j < 3; ++j) {
      const uint32_t v = welded.indices[3 * size_t(kept[k]) + size_t(j)];
      const uint32_t set = oneACube ? numbers.of(cubeOf(v), 0, 0) : numbers.of(sets.find(v), 1, 0);
      indices.push_back(set);
      if (set < cubes.size()) continue;
      cubes.push_back(cubeOf(v));
      like.push_back(directionNumbers.of(directions.find(v), 0, 0));
    }
  }
  std::vector<double> total(cubes.size(), 0.0), directionTotal(directionNumbers.size(), 0.0);
  const size_t used = numbers.size(), usedDirections = directionNumbers.size();
  for (size_t i = 0; i < vertices; ++i) {
    if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
    if (clusters.of[welded.pointOf[i]] == kNoPoint) continue;
    weight[i] = std::max(weight[i], 1e-300);  // of triangles without area alone: they share
    const uint32_t set = oneACube ? numbers.of(cubeOf(uint32_t(i)), 0, 0) : numbers.of(sets.find(uint32_t(i)), 1, 0);
    if (set < used) total[setOf[i] = set] += weight[i];
    const uint32_t direction = directionNumbers.of(directions.find(uint32_t(i)), 0, 0);
    if (direction < usedDirections) directionTotal[directionOf[i] = direction] += weight[i];
  }

  const auto spread = [&](const Array<Vec3>& means) {
    std::vector<Vec3> out(cubes.size());
    for (size_t s = 0; s < out.size(); ++s) out[s] = means[like[s]];
    return Array<Vec3>(std::move(out));
  };
  if (!mesh.normals.empty()) {
    Array<Vec3> means = mesh.normals;
    unitMeans(means, directionOf, weight, directionTotal);
    mesh.normals = spread(means);
  }
  if (!mesh.tangents.empty()) {
    std::vector<Vec3> along(vertices);
    std::vector<float> hand(cubes.size(), 1.0f);
    for (size_t i = vertices; i-- > 0;) {  // the first member's handedness: sides of a mirrored seam are in sets of their own
      along[i] = Vec3(mesh.tangents[i]);
      if (setOf[i] != kNoPoint) hand[setOf[i]] = mesh.tangents[i].w;
    }
    Array<Vec3> means(std::move(along));
    unitMeans(means, setOf, weight, total);
    std::vector<Vec4> tangents(cubes.size());
    for (size_t s = 0; s < tangents.size(); ++s) tangents[s] = Vec4(means[s], hand[s]);
    mesh.tangents = Array<Vec4>(std::move(tangents));
  }
  for (Array<Vec2>& set : mesh.uv) set = meansOf(set, setOf, weight, total);
  mesh.colours = meansOf(mesh.colours, setOf, weight, total);

  // Points are the cubes that are left.
  WeldedMesh out;
  Numbering cubeNumbers(cubes.size());
  std::vector<uint32_t> restOf(clusters.centre.size(), kNoPoint);
  for (size_t i = welded.points.size(); i-- > 0;)
    if (clusters.of[i] != kNoPoint) restOf[clusters.of[i]] = uint32_t(i);
  for (const uint32_t cube : cubes) {
    const uint32_t point = cubeNumbers.of(cube, 0, 0);
    out.pointOf.push_back(point);
    if (point < out.points.size()) continue;
    out.points.push_back(clusters.representative[cube]);
    out.rest.push_back(welded.rest[restOf[cube]]);
  }
  out.indices = std::move(indices);
  mesh.indices = Array<uint32_t>(std::vector<uint32_t>(out.indices));
  std::vector<Vec3> positions(out.pointOf.size());
  for (size_t i = 0; i < positions.size(); ++i) positions[i] = out.rest[out.pointOf[i]];
  mesh.positions = Array<Vec3>(std::move(positions));
  welded = std::move(out);
  return !stop.stopRequested();
}

}  // namespace scene
}  // namespace gobo
