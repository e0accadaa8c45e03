// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/receiver_clusters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <unordered_set>

#include "base/sobol.h"

namespace gobo::transfer {

namespace {

/// Cubes are moved and ways split off the axes, where surfaces are: rounding would tear these apart.
uint64_t keyOf(const Vec3& p, const Vec3& n, double spacing) {
  uint64_t key = 0;
  for (int c = 0; c < 3; ++c) {
    const double at = std::floor(double(p[c]) / spacing + 0.37);
    key = hash64(key, std::fabs(at) < 4e18 ? uint64_t(int64_t(at)) : 0u);
  }
  const Vec3 a = glm::abs(n);
  const int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
  const uint64_t way = uint64_t(((axis * 2 + (n[axis] < 0.0f)) * 2 + (n[(axis + 1) % 3] > 0.13f)) * 2 + (n[(axis + 2) % 3] > 0.13f));
  return hash64(key, way);
}

}  // namespace

Clusters clusterCorners(const Corners& corners, float spacing) {
  Clusters out;
  out.of.assign(corners.position.size(), Clusters::kNone);
  std::unordered_map<uint64_t, uint32_t> known;
  std::vector<DVec3> middle;
  std::vector<uint32_t> count;
  for (const auto& triangle : corners.triangles)
    for (const uint32_t slot : triangle) {
      if (out.of[slot] != Clusters::kNone) continue;
      const auto [at, fresh] = known.emplace(keyOf(corners.position[slot], corners.normal[slot], double(spacing)), uint32_t(out.member.size()));
      if (fresh) {
        out.member.push_back(slot);
        middle.emplace_back(0.0);
        count.push_back(0);
      }
      out.of[slot] = at->second;
      middle[at->second] += DVec3(corners.position[slot]);
      ++count[at->second];
    }
  std::vector<double> nearest(out.member.size(), std::numeric_limits<double>::infinity());
  for (size_t slot = 0; slot < out.of.size(); ++slot) {
    const uint32_t c = out.of[slot];
    if (c == Clusters::kNone) continue;
    const DVec3 d = DVec3(corners.position[slot]) - middle[c] / double(count[c]);
    if (const double distance = glm::dot(d, d); distance < nearest[c]) {
      nearest[c] = distance;
      out.member[c] = uint32_t(slot);
    }
  }
  return out;
}

size_t countClusters(const Corners& corners, float spacing, size_t most) {
  std::unordered_set<uint64_t> known;
  std::vector<uint8_t> seen(corners.position.size(), 0);
  for (const auto& triangle : corners.triangles)
    for (const uint32_t slot : triangle) {
      if (seen[slot]) continue;
      seen[slot] = 1;
      known.insert(keyOf(corners.position[slot], corners.normal[slot], double(spacing)));
      if (known.size() > most) return known.size();
    }
  return known.size();
}

std::vector<Stencil> stencils(const Corners& corners, const Clusters& clusters, float spacing) {
  std::vector<uint64_t> pairs;  // of clusters that share a triangle, both ways
  for (const auto& triangle : corners.triangles)
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = clusters.of[triangle[size_t(k)]], b = clusters.of[triangle[size_t((k + 1) % 3)]];
      if (a == b) continue;
      pairs.push_back(uint64_t(a) << 32 | b);
      pairs.push_back(uint64_t(b) << 32 | a);
    }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  std::vector<size_t> first(clusters.member.size() + 1, 0);
  for (const uint64_t pair : pairs) ++first[size_t(pair >> 32) + 1];
  for (size_t c = 0; c < clusters.member.size(); ++c) first[c + 1] += first[c];

  std::vector<Stencil> out(corners.position.size());
  const float reach = 2.0f * spacing;
  for (size_t slot = 0; slot < out.size(); ++slot) {
    const uint32_t own = clusters.of[slot];
    if (own == Clusters::kNone) continue;
    Stencil& s = out[slot];
    s.cluster.fill(own);
    if (clusters.member[own] == slot) continue;
    float sum = 0, best[3] = {};
    std::array<uint32_t, 3> at{own, own, own};
    const auto offer = [&](uint32_t c) {
      const uint32_t member = clusters.member[c];
      const float d = maxOf(glm::length(corners.position[slot] - corners.position[member]), 1e-4f * spacing);
      const float facing = maxOf(glm::dot(corners.normal[slot], corners.normal[member]), 0.0f);
      float w = d < reach ? sqr((reach - d) / (reach * d) * spacing) * sqr(sqr(facing)) : 0.0f;
      if (!(w > 0.0f)) return;
      for (size_t k = 0; k < 3; ++k)
        if (w > best[k]) {
          std::swap(w, best[k]);
          std::swap(c, at[k]);
        }
    };
    offer(own);
    for (size_t p = first[own]; p < first[own + 1]; ++p) offer(uint32_t(pairs[p]));
    for (const float w : best) sum += w;
    if (!(sum > 0.0f) || !std::isfinite(sum)) continue;
    for (size_t k = 0; k < 3; ++k) {
      s.weight[k] = best[k] / sum;
      s.cluster[k] = best[k] > 0.0f ? at[k] : own;
    }
  }
  return out;
}

}  // namespace gobo::transfer
