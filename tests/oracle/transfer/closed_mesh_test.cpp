// SPDX-License-Identifier: Apache-2.0
// Which meshes hide their backs from everybody outside: closed ones whose triangles face outwards.
#include <gtest/gtest.h>

#include <utility>

#include "techniques/transfer/closed_mesh.h"

namespace gobo::transfer {
namespace {

struct Shell {
  std::vector<Vec3> positions;
  std::vector<uint32_t> indices;
  bool hides() const { return hidesBacks(Array<uint32_t>(indices), Array<Vec3>(positions)); }
};

/// A box of half the size `h`; each face has corners of its own, as files have them.
Shell box(const Vec3& centre, float h) {
  Shell out;
  for (int axis = 0; axis < 3; ++axis)
    for (const float side : {-1.0f, 1.0f}) {
      const uint32_t first = uint32_t(out.positions.size());
      for (const auto& [u, v] : {std::pair{-1.0f, -1.0f}, {1.0f, -1.0f}, {1.0f, 1.0f}, {-1.0f, 1.0f}}) {
        Vec3 p;
        p[axis] = side;
        p[(axis + 1) % 3] = u * side;  // outwards on both sides
        p[(axis + 2) % 3] = v;
        out.positions.push_back(centre + h * p);
      }
      for (const uint32_t k : {0u, 1u, 2u, 0u, 2u, 3u}) out.indices.push_back(first + k);
    }
  return out;
}

Shell both(Shell a, const Shell& b) {
  for (const uint32_t k : b.indices) a.indices.push_back(k + uint32_t(a.positions.size()));
  a.positions.insert(a.positions.end(), b.positions.begin(), b.positions.end());
  return a;
}

Shell turned(Shell s) {
  for (size_t t = 0; t + 2 < s.indices.size(); t += 3) std::swap(s.indices[t + 1], s.indices[t + 2]);
  return s;
}

TEST(ClosedMesh, BoxesWhereverTheyAre) {
  for (const float h : {1e-3f, 1.0f, 1e3f})
    for (const Vec3& centre : {Vec3(0.0f), Vec3(0.1f, 0.7f, -0.3f) * h, Vec3(1e3f, -1e3f, 1e3f) * h})
      EXPECT_TRUE(box(centre, h).hides()) << h << " " << centre.x;
  EXPECT_TRUE(both(box(Vec3(0.0f), 1), box(Vec3(4, 0, 0), 1)).hides());
  EXPECT_TRUE(both(box(Vec3(0.0f), 1), box(Vec3(2, 2, 0), 1)).hides()) << "they share an edge";
}

TEST(ClosedMesh, WhatIsOpenShowsItsBacks) {
  const Shell whole = box(Vec3(0.0f), 1);
  for (size_t t = 0; t < whole.indices.size(); t += 3) {
    Shell open = whole;
    open.indices.erase(open.indices.begin() + long(t), open.indices.begin() + long(t) + 3);
    EXPECT_FALSE(open.hides()) << t;
    Shell flipped = whole;
    std::swap(flipped.indices[t + 1], flipped.indices[t + 2]);
    EXPECT_FALSE(flipped.hides()) << t << ": one face looks inwards";
  }
}

TEST(ClosedMesh, FacesThatLookInwardsAreBacks) {
  EXPECT_FALSE(turned(box(Vec3(0.0f), 1)).hides()) << "a room: seen from inside are its fronts, from outside its backs";
  EXPECT_FALSE(both(turned(box(Vec3(0.0f), 2)), box(Vec3(0.0f), 1)).hides());
}

TEST(ClosedMesh, ASheetOnItsOwnBackEnclosesNothing) {
  Shell sheet;
  sheet.positions = {Vec3(0.0f), Vec3(1, 0, 0), Vec3(1, 1, 0.3f), Vec3(0, 1, 0)};
  sheet.indices = {0, 1, 2, 0, 2, 3};
  EXPECT_FALSE(sheet.hides());
  EXPECT_FALSE(both(sheet, turned(sheet)).hides());
  EXPECT_FALSE(Shell().hides());
}

}  // namespace
}  // namespace gobo::transfer
