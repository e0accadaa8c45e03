// SPDX-License-Identifier: Apache-2.0
// What is found once and kept, and what runs side by side, against the plain sums.
#include "techniques/transfer/cell_cones.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "base/sobol.h"

namespace gobo::transfer::cell_cones_test {
namespace {

/// Noise over six orders of magnitude.
EnvironmentPtr noise(int width, int height, uint64_t seed) {
  Image image(width, height, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(std::pow(10.0, 6.0 * double(hash64(seed, i) >> 40) / double(1 << 24) - 3.0));
  return makeEnvironment("noise", std::move(image));
}
bool same(const EnvironmentCells& a, const EnvironmentCells& b) {
  return a.cells.size() == b.cells.size() && std::memcmp(a.cells.data(), b.cells.data(), a.cells.size() * sizeof(EnvironmentCell)) == 0 && a.flux == b.flux;
}

// Fine maps, coarse ones, and one of more texels than a layout is kept for; a second map of a size uses the kept layout, another kind of grid of its size none.
TEST(EnvironmentCells, AreTheSameBitsWithAnyThreads) {
  for (const auto& [width, height] :
       {std::pair(1024, 512), std::pair(1024, 512), std::pair(256, 300), std::pair(7, 3), std::pair(1, 1), std::pair(2048, 1100)}) {
    const EnvironmentPtr map = noise(width, height, uint64_t(width));
    const EnvironmentCells alone(*map);
    for (const int threads : {1, 3}) {
      const TaskArena arena(threads);
      EXPECT_TRUE(same(alone, EnvironmentCells(*map, {}, &arena))) << width << " x " << height << ", threads " << threads;
    }
    // Every direction is in its own cell: moments look into their cells.
    for (size_t i = 0; i < alone.cells.size(); i += 97) {
      if (!(alone.cells[i].weight > 0)) continue;
      const DVec3 c = alone.cells[i].centre();
      EXPECT_GT(glm::dot(c, EnvironmentCells::cellDirection(i)), std::cos(1.5 * kDegree)) << width << " cell " << i;
    }
  }
}

// Cones of any width: no cell of them is outside of its face's box.
TEST(CellCones, TheirBoxesHoldThem) {
  size_t boxed = 0, all = 0;
  for (uint32_t i = 0; i < 60; ++i) {
    const Vec2 q = SobolSampler(11, i).next2D();
    const double y = 1 - 2 * double(q.x), r = std::sqrt(1 - y * y), phi = 2 * std::numbers::pi * double(q.y);
    const DVec3 d(r * std::cos(phi), y, r * std::sin(phi));
    for (const double angle : {2.0, 9.0, 14.0, 27.0, 40.0, 70.0}) {
      CellBox box[6];
      bool any[6];
      for (int face = 0; face < 6; ++face) {
        any[face] = boxOfCone(face, d, angle * kDegree, box[face]);
        if (any[face]) boxed += size_t(box[face].x1 - box[face].x0 + 1) * size_t(box[face].y1 - box[face].y0 + 1);
      }
      constexpr size_t n = EnvironmentCells::kSide;
      for (size_t c = 0; c < 6 * n * n; ++c) {
        if (glm::dot(EnvironmentCells::cellDirection(c), d) < std::cos(angle * kDegree)) continue;
        const int face = int(c / (n * n)), u = int(c % n), v = int(c / n % n);
        ASSERT_TRUE(any[face] && u >= box[face].x0 && u <= box[face].x1 && v >= box[face].y0 && v <= box[face].y1) << angle << " cell " << c;
        ++all;
      }
    }
  }
  EXPECT_LT(boxed, 4 * all);  // and not much more than that
}

TEST(SmoothedCells, AreTheGaussiansMeans) {
  const EnvironmentCells cells(*noise(512, 256, 5));
  const TaskArena arena(2);
  const SmoothedMap found = smoothedCells(cells, arena);
  const Icosphere& sphere = icosphere(kSmoothLevel);
  ASSERT_EQ(found.value.size(), sphere.vertices.size());
  for (size_t v = 0; v < sphere.vertices.size(); v += 61) {
    double light = 0, weight = 0, within = 0;
    for (size_t i = 0; i < cells.cells.size(); ++i) {
      const double cosine = glm::dot(sphere.vertices[v], EnvironmentCells::cellDirection(i));
      if (cosine < std::cos(kSupport)) continue;
      const double g = std::exp((cosine - 1) / (kSmooth * kSmooth));
      light += g * cells.cells[i].weight;
      weight += g * cells.cells[i].solidAngle;
      within += cells.cells[i].weight;
    }
    EXPECT_NEAR(found.value[v] / (light / weight), 1.0, 1e-6) << v;
    EXPECT_GE(found.within[v], within * (1 - 1e-12)) << v;
  }
  StopSource stopped;
  stopped.stop(StopReason::Cancelled);
  EXPECT_TRUE(smoothedCells(cells, arena, stopped.token()).value.empty());
}

TEST(SmoothedCells, OfAConstantMapAreConstant) {
  const EnvironmentCells cells(*constantEnvironment(Vec3(2.0f)));
  for (const double v : smoothedCells(cells, TaskArena(2)).value) ASSERT_NEAR(v, 2.0, 1e-6);
}

}  // namespace
}  // namespace gobo::transfer::cell_cones_test
