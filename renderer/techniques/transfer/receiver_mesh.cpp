// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/receiver_mesh.h"

#include <algorithm>
#include <cmath>

namespace gobo::transfer {

namespace {

size_t pointsOf(int cuts) { return size_t(cuts + 1) * size_t(cuts + 2) / 2; }
/// Of a cut triangle's points: that at u = i / cuts, v = j / cuts.
uint32_t numberAt(int cuts, int i, int j) { return uint32_t(j * (cuts + 1) - j * (j - 1) / 2 + i); }
Vec3 at(const Mat4& m, const Vec3& p) { return Vec3(m * Vec4(p, 1.0f)); }

}  // namespace

template <typename Visit>
void ReceiverMesh::triangles(size_t instance, Visit&& visit) const {
  const Instance& in = view_.instances()[instance];
  const auto mesh = view_.mesh<Facet::Topology | Facet::Pose>(in.mesh);
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    const uint32_t* v = mesh.indices.data() + 3 * t;
    visit(t, at(in.toWorld, mesh.positions[v[0]]), at(in.toWorld, mesh.positions[v[1]]), at(in.toWorld, mesh.positions[v[2]]));
  }
}

int ReceiverMesh::cutsOf(float longest, float spacing) { return std::clamp(int(std::min(std::ceil(longest / spacing), float(kMostCuts))), 1, kMostCuts); }

size_t ReceiverMesh::count(float spacing) const {
  size_t total = 0;
  for (const Part& part : parts_) {
    size_t own = part.welded ? part.vertices : 0;  // an upper bound: of triangles that are cut they are not points
    for (const float longest : part.longest)
      if (const int cuts = cutsOf(longest, spacing); !part.welded || cuts > 1) own += pointsOf(cuts);
    total += own * (part.both ? 2 : 1);
  }
  return total;
}

void ReceiverMesh::lay(float spacing) {
  spacing_ = spacing;
  for (size_t i = 0; i < parts_.size(); ++i) {
    Part& part = parts_[i];
    const auto mesh = view_.mesh<Facet::Topology | Facet::Pose>(view_.instances()[i].mesh);
    part.first = uint32_t(size_);
    part.ofTriangle.assign(mesh.triangles(), ~0u);
    part.cuts.assign(mesh.triangles(), 1);
    if (part.welded) part.ofVertex.assign(mesh.positions.size(), ~0u);
    for (size_t t = 0; t < part.longest.size(); ++t) {
      part.cuts[t] = uint8_t(cutsOf(part.longest[t], spacing));
      if (!part.welded || part.cuts[t] > 1) {
        part.ofTriangle[t] = part.count;
        part.count += uint32_t(pointsOf(part.cuts[t]));
      } else
        for (int k = 0; k < 3; ++k)
          if (uint32_t& point = part.ofVertex[mesh.indices[3 * t + size_t(k)]]; point == ~0u) point = part.count++;
    }
    size_ += size_t(part.count) * (part.both ? 2 : 1);
  }
}

ReceiverMesh::ReceiverMesh(const SceneView& view, uint32_t points) : view_(view), parts_(view.instances().size()) {
  double area = 0;
  float longest = 0;
  for (size_t i = 0; i < parts_.size(); ++i) {
    const int m = view.instances()[i].mesh;
    const auto mesh = view.mesh<Facet::Topology | Facet::Shading>(m);
    parts_[i].welded = !mesh.normals.empty();
    parts_[i].both = view.coverage(mesh.material).doubleSided;
    parts_[i].vertices = view.mesh<Facet::Pose>(m).positions.size();
    double own = 0;
    triangles(i, [&](size_t, const Vec3& a, const Vec3& b, const Vec3& c) {
      own += 0.5 * double(glm::length(glm::cross(b - a, c - a)));
      parts_[i].longest.push_back(std::sqrt(std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)})));
      longest = std::max(longest, parts_[i].longest.back());
    });
    area += own * (parts_[i].both ? 2 : 1);
  }
  if (!(longest > 0)) return;
  // Half a square a point, if triangles were right-angled and even.
  float spacing = std::clamp(float(std::sqrt(2.0 * area / std::max(points, 1u))), longest / float(kMostCuts), longest);
  while (spacing < longest && count(spacing) > points) spacing *= 1.2f;
  lay(spacing);
}

bool ReceiverMesh::locate(uint32_t instance, uint32_t primitive, float u, float v, bool front, Between& out) const {
  const Part& part = parts_[instance];
  if (!front && !part.both) return false;
  const uint32_t base = part.first + (front ? 0 : part.count);
  if (part.ofTriangle[primitive] == ~0u) {
    const auto mesh = view_.mesh<Facet::Topology>(view_.instances()[instance].mesh);
    const uint32_t* corner = mesh.indices.data() + 3 * size_t(primitive);
    for (int k = 0; k < 3; ++k) out.point[size_t(k)] = base + part.ofVertex[corner[k]];
    out.weight = {1.0f - u - v, u, v};
    return true;
  }
  const int n = part.cuts[primitive];
  const uint32_t own = base + part.ofTriangle[primitive];
  const float x = clamp01(u) * float(n), y = clamp01(v) * float(n);
  int i = std::min(int(x), n - 1), j = std::min(int(y), n - 1);
  if (i + j > n - 1) (i > 0 ? i : j) -= 1;  // rounding put it beyond the third edge
  const float fx = clamp01(x - float(i)), fy = clamp01(y - float(j));
  if (fx + fy <= 1.0f || i + j + 2 > n) {
    out.point = {own + numberAt(n, i, j), own + numberAt(n, i + 1, j), own + numberAt(n, i, j + 1)};
    const float rest = maxOf(1.0f - fx - fy, 0.0f), sum = rest + fx + fy;
    out.weight = {rest / sum, fx / sum, fy / sum};
  } else {
    out.point = {own + numberAt(n, i + 1, j + 1), own + numberAt(n, i, j + 1), own + numberAt(n, i + 1, j)};
    out.weight = {fx + fy - 1.0f, 1.0f - fx, 1.0f - fy};
  }
  return true;
}

ReceiverMesh::Points ReceiverMesh::points() const {
  Points out;
  out.position.resize(size_);
  out.normal.resize(size_);
  out.instance.resize(size_);
  out.primitive.resize(size_);
  out.bary.resize(size_);
  out.cell.resize(size_);
  for (size_t p = 0; p < parts_.size(); ++p) {
    const Part& part = parts_[p];
    const Instance& in = view_.instances()[p];
    const auto mesh = view_.mesh<Facet::Topology | Facet::Pose | Facet::Shading>(in.mesh);
    const Mat3 linear(in.toWorld);
    const Mat3 cofactor(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]), glm::cross(linear[0], linear[1]));
    const float turned = glm::dot(cofactor[0], linear[0]) < 0 ? -1.0f : 1.0f;
    std::vector<Vec3> middle(part.ofVertex.size(), Vec3(0.0f));  // sums over the triangles about a vertex
    std::vector<float> about(part.ofVertex.size(), 0.0f), edges(part.ofVertex.size(), 0.0f);
    std::vector<Vec3> faces(part.ofVertex.size(), Vec3(0.0f));
    const auto put = [&](uint32_t local, const Vec3& position, const Vec3& normal, size_t t, const Vec2& bary, float cell) {
      for (int side = 0; side < (part.both ? 2 : 1); ++side) {
        const size_t i = part.first + local + (side ? part.count : 0);
        out.position[i] = position;
        out.normal[i] = side ? -normal : normal;
        out.instance[i] = uint32_t(p);
        out.primitive[i] = uint32_t(t);
        out.bary[i] = bary;
        out.cell[i] = cell;
      }
    };
    const auto unit = [](const Vec3& n, const Vec3& otherwise) {
      const float l = glm::dot(n, n);
      return l > 1e-24f && l < 1e24f ? n / std::sqrt(l) : otherwise;
    };
    triangles(p, [&](size_t t, const Vec3& a, const Vec3& b, const Vec3& c) {
      const uint32_t* v = mesh.indices.data() + 3 * t;
      const Vec3 cross = glm::cross(b - a, c - a) * turned, flat = unit(cross, Vec3(0, 1, 0)), centre = (a + b + c) / 3.0f;
      const float edge = std::sqrt(std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)}));
      const int n = part.cuts[t];
      if (part.ofTriangle[t] == ~0u) {
        for (int k = 0; k < 3; ++k) {
          middle[v[k]] += centre;
          about[v[k]] += 1.0f;
          edges[v[k]] += edge;
          faces[v[k]] += cross;
          const Vec2 bary(k == 1 ? 1.0f : 0.0f, k == 2 ? 1.0f : 0.0f);
          put(part.ofVertex[v[k]], at(in.toWorld, mesh.positions[v[k]]), flat, t, bary, edge);  // position and normal follow
        }
        return;
      }
      for (int j = 0; j <= n; ++j)
        for (int i = 0; i + j <= n; ++i) {
          const float u = float(i) / float(n), w = float(j) / float(n), r = 1.0f - u - w;
          Vec3 normal = flat;
          if (part.welded) {
            const Vec3 smooth = cofactor * (mesh.normals[v[0]] * r + mesh.normals[v[1]] * u + mesh.normals[v[2]] * w) * turned;
            normal = unit(smooth, flat);
            if (glm::dot(normal, flat) < 0.0f) normal = -normal;
          }
          const float in5 = 0.05f / float(n);  // towards the middle
          const Vec2 bary(u + in5 * (1.0f / 3.0f - u), w + in5 * (1.0f / 3.0f - w));
          put(part.ofTriangle[t] + numberAt(n, i, j), a * (1.0f - bary.x - bary.y) + b * bary.x + c * bary.y, normal, t, bary, edge / float(n));
        }
    });
    for (size_t v = 0; v < part.ofVertex.size(); ++v) {
      if (part.ofVertex[v] == ~0u) continue;
      const Vec3 flat = unit(faces[v], Vec3(0, 1, 0));
      Vec3 normal = unit(cofactor * mesh.normals[v] * turned, flat);
      if (glm::dot(normal, flat) < 0.0f) normal = -normal;
      const Vec3 position = at(in.toWorld, mesh.positions[v]);
      Vec3 inwards = middle[v] / about[v] - position;
      inwards -= normal * glm::dot(inwards, normal);
      for (int side = 0; side < (part.both ? 2 : 1); ++side) {
        const size_t i = part.first + part.ofVertex[v] + (side ? part.count : 0);
        out.position[i] = position + 0.05f * inwards;
        out.normal[i] = side ? -normal : normal;
        out.cell[i] = edges[v] / about[v];
      }
    }
  }
  return out;
}

}  // namespace gobo::transfer
