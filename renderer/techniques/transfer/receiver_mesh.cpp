// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/receiver_mesh.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>

#include "base/hash.h"
#include "base/latest_map.h"
#include "techniques/transfer/closed_mesh.h"

namespace gobo::transfer {

namespace {

constexpr int kMostSteps = 60;  // of spacing: 1.2^60 is 56 000

Vec3 at(const Mat4& m, const Vec3& p) { return Vec3(m * Vec4(p, 1.0f)); }
/// Cofactors are of the scale squared, and `l` is of its fourth power.
Vec3 unit(const Vec3& n, const Vec3& otherwise) {
  const float l = glm::dot(n, n);
  return l > 1e-36f && l < 1e24f ? n / std::sqrt(l) : otherwise;
}

/// An instance's matrix for normals, and whether it mirrors.
struct Turned {
  Mat3 cofactor;
  float sign;
  explicit Turned(const Mat4& toWorld) {
    const Mat3 linear(toWorld);
    cofactor = Mat3(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]), glm::cross(linear[0], linear[1]));
    sign = glm::dot(cofactor[0], linear[0]) < 0 ? -1.0f : 1.0f;
  }
  /// A mesh's normal in the world, on the side of the face.
  Vec3 normal(const Vec3& n, const Vec3& flat) const {
    const Vec3 out = unit(cofactor * n * sign, flat);
    return glm::dot(out, flat) < 0.0f ? -out : out;
  }
};

/// Whether back faces of a mesh may be seen, by who looks or by light: reflection is the same from both sides, whatever a material says of doubleSided.
bool showsBacks(const SceneView& view, int mesh) {
  const auto of = view.mesh<Facet::Topology | Facet::Pose>(mesh);
  const Coverage& coverage = view.coverage(of.material);
  if (coverage.doubleSided || coverage.mode != AlphaMode::Opaque) return true;
  // Known for the meshes of late: a scene is asked for each pose of its objects, and while requests are planned.
  static std::mutex mutex;
  static LatestMap<Hash128, std::optional<bool>> known(4096);
  const Hash128 key = Hasher("hides-backs").addArray(of.indices).addArray(of.positions).digest();
  {
    const std::lock_guard lock(mutex);
    if (const std::optional<bool>* hides = known.find(key); hides && *hides) return !**hides;
  }
  const bool hides = hidesBacks(of.indices, of.positions);
  const std::lock_guard lock(mutex);
  known.touch(key) = hides;
  return !hides;
}

}  // namespace

struct ReceiverMesh::Source {
  std::vector<Size> sizes;                      // of triangles
  std::vector<std::array<uint32_t, 3>> corner;  // slots
  std::vector<Vec3> position, normal;           // by slot
  double area = 0;
  float longest = 0;
  bool both = false;
};

/// Slots of meshes with normals are vertices; of flat ones each triangle has its own.
ReceiverMesh::Source ReceiverMesh::sourceOf(const SceneView& view, size_t instance, bool both) {
  Source out;
  out.both = both;
  const Instance& in = view.instances()[instance];
  const auto mesh = view.mesh<Facet::Topology | Facet::Pose | Facet::Shading>(in.mesh);
  const bool welded = !mesh.normals.empty();
  const Turned turned(in.toWorld);
  const size_t slots = welded ? mesh.positions.size() : 3 * mesh.triangles();
  out.position.resize(slots);
  out.normal.assign(slots, Vec3(0.0f));
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    const uint32_t* v = mesh.indices.data() + 3 * t;
    const Vec3 p[3] = {at(in.toWorld, mesh.positions[v[0]]), at(in.toWorld, mesh.positions[v[1]]), at(in.toWorld, mesh.positions[v[2]])};
    const Vec3 cross = glm::cross(p[1] - p[0], p[2] - p[0]) * turned.sign;
    const float twice = glm::length(cross), edge[3] = {glm::length(p[1] - p[0]), glm::length(p[2] - p[1]), glm::length(p[0] - p[2])};
    const size_t most = size_t(std::max_element(edge, edge + 3) - edge);
    out.area += 0.5 * double(twice);
    out.longest = std::max(out.longest, edge[most]);
    out.sizes.push_back({edge[most], edge[most] > 0 ? twice / edge[most] : 0.0f, uint8_t(most)});
    std::array<uint32_t, 3> slot;
    for (size_t k = 0; k < 3; ++k) {
      slot[k] = welded ? v[k] : uint32_t(3 * t + k);
      out.position[slot[k]] = p[k];
      out.normal[slot[k]] += cross;
    }
    out.corner.push_back(slot);
  }
  for (size_t s = 0; s < slots; ++s) {
    const Vec3 flat = unit(out.normal[s], Vec3(0, 1, 0));
    out.normal[s] = welded ? turned.normal(mesh.normals[s], flat) : flat;
  }
  out.area *= out.both ? 2 : 1;
  return out;
}

int ReceiverMesh::cutsOf(float length, float spacing) { return std::clamp(int(std::min(std::ceil(length / spacing), float(kMostCuts))), 1, kMostCuts); }

size_t ReceiverMesh::pointsOf(int strips, int pieces) {
  size_t points = 1;
  for (int j = 0; j < strips; ++j) points += size_t((pieces * (strips - j) + strips - 1) / strips + 1);
  return points;
}

uint16_t ReceiverMesh::patternOf(const Size& size, float spacing) {
  const int strips = cutsOf(size.height, spacing), pieces = cutsOf(size.longest, spacing);
  uint16_t& known = patternFor_[(size_t(size.edge) * kMostCuts + size_t(strips - 1)) * kMostCuts + size_t(pieces - 1)];
  if (known == 0) {
    known = uint16_t(patterns_.size());
    Pattern p{strips, pieces, size.edge, {0}};
    for (int j = 0; j < strips; ++j) p.row.push_back(p.row.back() + uint32_t(p.in(j) + 1));
    p.row.push_back(p.row.back() + 1);
    patterns_.push_back(std::move(p));
  }
  return known;
}

Corners ReceiverMesh::small(const Source& source, float spacing) {
  Corners out{source.position, source.normal, {}};
  for (size_t t = 0; t < source.sizes.size(); ++t)
    if (cutsOf(source.sizes[t].longest, spacing) == 1) out.triangles.push_back(source.corner[t]);
  return out;
}

ReceiverMesh::ReceiverMesh(const SceneView& view, uint32_t points) : parts_(view.instances().size()), patterns_(1) {
  std::vector<Source> sources;
  std::map<int, bool> both;  // by mesh
  double area = 0;
  float longest = 0;
  for (size_t i = 0; i < parts_.size(); ++i) {
    const int mesh = view.instances()[i].mesh;
    if (!both.count(mesh)) both[mesh] = showsBacks(view, mesh);
    sources.push_back(sourceOf(view, i, both[mesh]));
    area += sources.back().area;
    longest = std::max(longest, sources.back().longest);
  }
  if (!(longest > 0)) return;
  // A square a point, and those of edges besides.
  float spacing = std::clamp(float(std::sqrt(area / std::max(points, 1u))), longest / float(kMostCuts), longest);
  const auto fits = [&] {
    size_t total = 0;
    for (const Source& source : sources) {
      const size_t sides = source.both ? 2 : 1;
      for (const Size& size : source.sizes)
        if (const int pieces = cutsOf(size.longest, spacing); pieces > 1) total += sides * pointsOf(cutsOf(size.height, spacing), pieces);
      if (total > points) return false;
      total += sides * countClusters(small(source, spacing), spacing, points - total);
    }
    return total <= points;
  };
  for (int step = 0; step < kMostSteps && !fits(); ++step) spacing *= 1.2f;
  spacing_ = spacing;

  patternFor_.assign(size_t(3) * kMostCuts * kMostCuts, 0);
  for (size_t i = 0; i < parts_.size(); ++i) {
    Part& part = parts_[i];
    const Source& source = sources[i];
    const Corners corners = small(source, spacing);
    Clusters clusters = clusterCorners(corners, spacing);
    const std::vector<Stencil> found = stencils(corners, clusters, spacing);
    part.first = uint32_t(size_);
    part.triangle = triangles_.size();
    part.slot = stencils_.size();
    part.both = source.both;
    part.count = uint32_t(clusters.member.size());
    part.member = std::move(clusters.member);
    stencils_.insert(stencils_.end(), found.begin(), found.end());
    for (size_t t = 0; t < source.sizes.size(); ++t) {
      Triangle triangle;
      if (cutsOf(source.sizes[t].longest, spacing) > 1) {
        triangle.pattern = patternOf(source.sizes[t], spacing);
        triangle.own = part.count;
        part.count += patterns_[triangle.pattern].row.back();
      } else {
        triangle.own = uint32_t(corners_.size());
        corners_.push_back(source.corner[t]);
      }
      triangles_.push_back(triangle);
    }
    size_ += size_t(part.count) * (part.both ? 2 : 1);
  }
}

bool ReceiverMesh::locate(uint32_t instance, uint32_t primitive, float u, float v, bool front, Between& out) const {
  const Part& part = parts_[instance];
  if (!front && !part.both) return false;
  const uint32_t base = part.first + (front ? 0 : part.count);
  const Triangle& triangle = triangles_[part.triangle + primitive];
  const float corner[3] = {1.0f - u - v, u, v};
  if (triangle.pattern == 0) {
    std::array<uint32_t, 9> point;
    std::array<float, 9> weight;
    size_t n = 0;
    for (size_t k = 0; k < 3; ++k) {
      const Stencil& s = stencils_[part.slot + corners_[triangle.own][k]];
      for (size_t q = 0; q < 3; ++q) {
        const float w = corner[k] * s.weight[q];
        if (!(w > 0.0f)) continue;
        size_t known = 0;
        while (known < n && point[known] != s.cluster[q]) ++known;
        if (known == n) {
          point[n] = s.cluster[q];
          weight[n++] = w;
        } else weight[known] += w;
      }
    }
    while (n > kCorners) {  // the least goes
      const size_t least = size_t(std::min_element(weight.begin(), weight.begin() + long(n)) - weight.begin());
      --n;
      point[least] = point[n];
      weight[least] = weight[n];
    }
    float sum = 0;
    for (size_t k = 0; k < n; ++k) sum += weight[k];
    out.weight.fill(0.0f);
    out.point.fill(base + stencils_[part.slot + corners_[triangle.own][0]].cluster[0]);
    if (!(sum > 0.0f)) out.weight[0] = 1.0f;
    for (size_t k = 0; sum > 0.0f && k < n; ++k) {
      out.point[k] = base + point[k];
      out.weight[k] = weight[k] / sum;
    }
    return true;
  }
  const Pattern& p = patterns_[triangle.pattern];
  const uint32_t own = base + triangle.own;
  const float along = corner[p.edge] + corner[(p.edge + 1) % 3];
  const float x = along > 0.0f ? clamp01(corner[(p.edge + 1) % 3] / along) : 0.0f, y = clamp01(corner[(p.edge + 2) % 3]) * float(p.strips);
  const int j = std::min(int(y), p.strips - 1);
  const float fy = clamp01(y - float(j));
  out.weight.fill(0.0f);
  const auto row = [&](int k, float weight, size_t first) {
    const int pieces = p.in(k), i = std::min(int(x * float(pieces)), std::max(pieces - 1, 0));
    const float fx = pieces > 0 ? clamp01(x * float(pieces) - float(i)) : 0.0f;
    out.point[first] = own + p.row[size_t(k)] + uint32_t(i);
    out.point[first + 1] = out.point[first] + (pieces > 0 ? 1u : 0u);
    out.weight[first] = weight * (1.0f - fx);
    out.weight[first + 1] = weight * fx;
  };
  row(j, 1.0f - fy, 0);
  row(j + 1, fy, 2);
  for (size_t k = 4; k < kCorners; ++k) out.point[k] = out.point[0];
  return true;
}

ReceiverMesh::Points ReceiverMesh::points(const SceneView& view) const {
  Points out;
  out.position.resize(size_);
  out.normal.resize(size_);
  out.instance.resize(size_);
  out.primitive.resize(size_);
  out.bary.resize(size_);
  out.cell.resize(size_);
  for (size_t p = 0; p < parts_.size(); ++p) {
    const Part& part = parts_[p];
    const Instance& in = view.instances()[p];
    const auto mesh = view.mesh<Facet::Topology | Facet::Pose | Facet::Shading>(in.mesh);
    const bool welded = !mesh.normals.empty();
    const Turned turned(in.toWorld);
    const Source source = sourceOf(view, p, part.both);
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
    struct About {  // a slot, of the triangles about it that are not cut
      Vec3 middle{0.0f};
      float count = 0, edges = 0;
      uint32_t triangle = 0, corner = 0;
    };
    std::vector<About> about(source.position.size());
    for (size_t t = 0; t < source.sizes.size(); ++t) {
      const Triangle& triangle = triangles_[part.triangle + t];
      const std::array<uint32_t, 3>& slot = source.corner[t];
      const Vec3 &a = source.position[slot[0]], &b = source.position[slot[1]], &c = source.position[slot[2]];
      if (triangle.pattern == 0) {
        for (uint32_t k = 0; k < 3; ++k) {
          About& of = about[slot[k]];
          of.middle += (a + b + c) / 3.0f;
          of.count += 1.0f;
          of.edges += source.sizes[t].longest;
          of.triangle = uint32_t(t);
          of.corner = k;
        }
        continue;
      }
      const Pattern& q = patterns_[triangle.pattern];
      const Vec3 flat = unit(glm::cross(b - a, c - a) * turned.sign, Vec3(0, 1, 0));
      const float cell = std::max(source.sizes[t].longest / float(q.pieces), source.sizes[t].height / float(q.strips));
      const Vec3 corner[3] = {a, b, c}, base = corner[(q.edge + 1) % 3] - corner[q.edge];  // where the third corner is above the longest edge
      const float foot = clamp01(glm::dot(corner[(q.edge + 2) % 3] - corner[q.edge], base) / maxOf(glm::dot(base, base), 1e-30f));
      for (int j = 0; j <= q.strips; ++j)
        for (int i = 0; i <= q.in(j); ++i) {
          // Off the edges, towards the middle of the row and straight up from the longest edge (down to it from the corner): towards the middle of a thin
          // triangle would be far along it. Its ends are so narrow that going far in means going along.
          const float y0 = float(j) / float(q.strips), x0 = q.in(j) > 0 ? float(i) / float(q.in(j)) : foot, least = 0.025f / float(std::max(q.in(j), 1));
          const bool end = i == 0 || i == q.in(j);
          const float step = 0.05f * (end && q.in(j) > 0 ? std::min(1.0f / float(q.strips), 5.0f * cell / source.sizes[t].longest) : 1.0f / float(q.strips));
          const float y = y0 + step * (1.0f / 3.0f - y0), along = x0 * (1.0f - y0) + foot * y0;
          const float x = std::clamp((along - foot * y) / (1.0f - y), least, 1.0f - least);
          float w[3];
          w[q.edge] = (1.0f - x) * (1.0f - y);
          w[(q.edge + 1) % 3] = x * (1.0f - y);
          w[(q.edge + 2) % 3] = y;
          Vec3 normal = flat;
          if (welded) {
            const uint32_t* v = mesh.indices.data() + 3 * t;
            normal = turned.normal(mesh.normals[v[0]] * w[0] + mesh.normals[v[1]] * w[1] + mesh.normals[v[2]] * w[2], flat);
          }
          put(triangle.own + q.row[size_t(j)] + uint32_t(i), a * w[0] + b * w[1] + c * w[2], normal, t, Vec2(w[1], w[2]), cell);
        }
    }
    for (size_t m = 0; m < part.member.size(); ++m) {
      const uint32_t slot = part.member[m];
      const About& of = about[slot];
      const Vec3 &normal = source.normal[slot], &position = source.position[slot];
      Vec3 inwards = of.middle / of.count - position;
      inwards -= normal * glm::dot(inwards, normal);
      put(uint32_t(m), position + 0.05f * inwards, normal, of.triangle, Vec2(of.corner == 1 ? 1.0f : 0.0f, of.corner == 2 ? 1.0f : 0.0f), of.edges / of.count);
    }
  }
  return out;
}

std::shared_ptr<const ReceiverMesh> receiverMesh(const SceneView& view, uint32_t points) {
  struct Kept {
    Hash128 scene;
    uint32_t points = 0;
    std::shared_ptr<const ReceiverMesh> mesh;
  };
  static std::mutex mutex;
  static std::array<Kept, 2> kept;  // the last used first
  const Hash128 scene = view.digest(ReceiverMesh::kFacets);
  const auto known = [&]() -> std::shared_ptr<const ReceiverMesh> {
    for (size_t i = 0; i < kept.size(); ++i)
      if (kept[i].mesh && kept[i].scene == scene && kept[i].points == points) {
        std::rotate(kept.begin(), kept.begin() + long(i), kept.begin() + long(i) + 1);
        return kept[0].mesh;
      }
    return nullptr;
  };
  {
    const std::lock_guard hold(mutex);
    if (auto mesh = known()) return mesh;
  }
  auto made = std::make_shared<const ReceiverMesh>(view, points);
  const std::lock_guard hold(mutex);
  if (auto mesh = known()) return mesh;
  kept[1] = std::move(kept[0]);
  kept[0] = {scene, points, made};
  return made;
}

}  // namespace gobo::transfer
