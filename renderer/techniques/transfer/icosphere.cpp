// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/icosphere.h"

#include <map>
#include <mutex>

#include "base/check.h"

namespace gobo::transfer {

namespace {

Icosphere make(int level) {
  Icosphere out;
  const double g = 0.5 * (1 + std::sqrt(5.0));
  for (const DVec3& v : {DVec3(-1, g, 0), DVec3(1, g, 0), DVec3(-1, -g, 0), DVec3(1, -g, 0), DVec3(0, -1, g), DVec3(0, 1, g), DVec3(0, -1, -g), DVec3(0, 1, -g),
                         DVec3(g, 0, -1), DVec3(g, 0, 1), DVec3(-g, 0, -1), DVec3(-g, 0, 1)})
    out.vertices.push_back(glm::normalize(v));
  std::vector<std::array<int, 3>> faces{{0, 11, 5}, {0, 5, 1}, {0, 1, 7}, {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                        {3, 9, 4},  {3, 4, 2}, {3, 2, 6}, {3, 6, 8},  {3, 8, 9},   {4, 9, 5}, {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int l = 0; l < level; ++l) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [at, added] = middles.try_emplace(std::minmax(a, b), int(out.vertices.size()));
      if (added) out.vertices.push_back(glm::normalize(out.vertices[size_t(a)] + out.vertices[size_t(b)]));
      return at->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& [a, b, c] : faces) {
      const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    faces = std::move(finer);
  }
  out.neighbours.assign(out.vertices.size(), {-1, -1, -1, -1, -1, -1});
  for (const auto& face : faces)
    for (size_t k = 0; k < 3; ++k) {  // each edge is in two faces, once each way
      std::array<int, 6>& of = out.neighbours[size_t(face[k])];
      size_t free = 0;
      while (of[free] >= 0) ++free;
      of[free] = face[(k + 1) % 3];
    }
  return out;
}

}  // namespace

const Icosphere& icosphere(int level) {
  GOBO_CHECK(level >= 0 && level <= 7);
  static std::mutex mutex;
  static std::array<std::unique_ptr<Icosphere>, 8> made;
  const std::lock_guard hold(mutex);
  auto& sphere = made[size_t(level)];
  if (!sphere) sphere = std::make_unique<Icosphere>(make(level));
  return *sphere;
}

}  // namespace gobo::transfer
