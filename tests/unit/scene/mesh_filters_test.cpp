// SPDX-License-Identifier: Apache-2.0
// Inflation, scales of objects, shading normals, and what every mesh filter keeps; clusters and smoothing have files of their own.
#include <gtest/gtest.h>

#include <glm/gtc/matrix_transform.hpp>

#include "scene/mesh_filters/mesh_filters.h"
#include "scene/mesh_filters/normals.h"
#include "scene/mesh_filters/numbering.h"
#include "scene/mesh_filters/weld.h"
#include "support/mesh_shapes.h"
#include "support/stopping.h"

namespace gobo::tests {
namespace mesh_filters_test {

MeshFilter inflated(double by) {
  MeshFilter f;
  f.inflate = by;
  return f;
}

MeshPtr made(const MeshPtr& mesh, const MeshFilter& f) {
  const auto r = filterMesh(mesh, f);
  EXPECT_TRUE(r.ok());
  EXPECT_EQ(r->end, FilteredMesh::End::Made);
  return r->mesh;
}

TEST(MeshFilters, NothingToDoIsTheMeshItself) {
  const MeshPtr ball = ballMesh(1.0f, 16);
  EXPECT_EQ(made(ball, {}), ball);
  MeshFilter still;
  still.smooth = 100;
  still.step = 0.0;
  EXPECT_EQ(made(ball, still), ball);
  Mesh flat = *ball;
  flat.positions = Array<Vec3>(flat.positions.size(), Vec3(1, 2, 3));
  const MeshPtr point = sealedMesh(flat);
  EXPECT_EQ(made(point, inflated(1.0)), point) << "no triangle has an area";
  EXPECT_EQ(made(sealedMesh({}), inflated(1.0))->triangles(), 0u);
}

TEST(MeshFilters, AnInflatedBallIsALargerOne) {
  for (const double by : {0.25, -0.25, 1.0}) {
    double last = 0.0;
    for (const int slices : {32, 64, 128}) {
      const MeshPtr from = ballMesh(1.0f, slices), to = made(from, inflated(by));
      const double r = 1.0 + by, area = areaOf(*to) / (4.0 * M_PI * r * r) - 1.0, volume = volumeOf(*to) / (4.0 / 3.0 * M_PI * r * r * r) - 1.0;
      // The mesh's own error, which falls with the square of its edges, and no more of it than the ball had.
      EXPECT_LT(std::fabs(area), 12.0 / (slices * slices)) << by << ", " << slices;
      EXPECT_LT(std::fabs(volume), 20.0 / (slices * slices)) << by << ", " << slices;
      if (last != 0.0) EXPECT_NEAR(volume / last, 0.25, 0.02) << by << ", " << slices;
      last = volume;
      EXPECT_EQ(tornEdges(*to), 0u) << "the seam stays closed";
      for (size_t i = 0; i < to->normals.size(); ++i) EXPECT_LT(glm::length(to->normals[i] - from->normals[i]), 4.0f / float(slices * slices));
      EXPECT_EQ(to->uv[0].data(), from->uv[0].data()) << "shared: nothing of it changed";
      EXPECT_EQ(to->topologyHash, from->topologyHash);
    }
  }
}

// Corners of a box have the mean of three faces for a normal, however the faces are cut into triangles.
TEST(MeshFilters, AnInflatedBoxIsABox) {
  for (const int n : {1, 3}) {
    const MeshPtr from = boxMesh(0.5f, n), to = made(from, inflated(0.3));
    EXPECT_EQ(tornEdges(*to), 0u);
    for (size_t i = 0; i < from->positions.size(); ++i) {
      const DVec3 p(from->positions[i]);
      const glm::dvec3 outer(std::fabs(p.x) > 0.49, std::fabs(p.y) > 0.49, std::fabs(p.z) > 0.49);
      const DVec3 out = glm::sign(p) * outer / std::sqrt(outer.x + outer.y + outer.z);
      EXPECT_LT(glm::length(DVec3(to->positions[i]) - (p + 0.3 * out)), 2e-7) << i;
      EXPECT_LT(glm::length(to->normals[i] - from->normals[i]), n == 1 ? 1e-6f : 0.5f) << "creases stay creases";
    }
  }
  EXPECT_NEAR(areaOf(*made(boxMesh(0.5f, 1), inflated(0.3))), 6.0 * std::pow(1.0 + 0.6 / std::sqrt(3.0), 2), 1e-6);
}

// Corners that each face of a turned box rounds on its own are one: the box does not come apart.
TEST(MeshFilters, CornersThatRoundApartAreOne) {
  int apart = 0;
  for (int k = 0; k < 20; ++k) {
    builtin::MeshBuilder b;
    b.box(builtin::random3(21, uint64_t(k)) * 3.0f, Vec3(0.3f, 0.2f, 0.5f),
          builtin::rotate(glm::normalize(builtin::random3(22, uint64_t(k)) + 0.1f), float(k)));
    const MeshPtr from = b.finish("turned", 0), to = made(from, inflated(0.125));
    apart += tornEdges(*from) > 0;
    EXPECT_EQ(tornEdges(*to), 0u) << k;
    EXPECT_EQ(placesOf(*to), 8u) << k;
    const double more = 2.0 * 0.125 / std::sqrt(3.0);
    EXPECT_NEAR(volumeOf(*to), (0.6 + more) * (0.4 + more) * (1.0 + more), 1e-5) << k;
  }
  EXPECT_GT(apart, 5) << "the test says something";
  // What is farther apart than rounding stays so, on either side of the cells of the search; 0 and -0 are one place.
  Mesh lines;
  std::vector<Vec3> p;
  for (int i = 0; i < 4096; ++i) p.emplace_back(1.0f - float(i) * 0x1.2p-20f, 0.0f, i % 2 ? 0.0f : -0.0f);
  lines.positions = Array<Vec3>(p);
  WeldedMesh welded;
  ASSERT_TRUE(weld(lines, glm::dmat3(1.0), {}, welded));
  EXPECT_EQ(welded.points.size(), p.size());
  for (int i = 0; i < 4096; ++i) p.emplace_back(p[size_t(i)] + Vec3(0x1p-22f, -0x1p-22f, 0x1p-22f));
  lines.positions = Array<Vec3>(p);
  ASSERT_TRUE(weld(lines, glm::dmat3(1.0), {}, welded));
  EXPECT_EQ(welded.points.size(), 4096u);
  for (uint32_t i = 0; i < 4096; ++i) EXPECT_EQ(welded.pointOf[i + 4096], i);
}

TEST(MeshFilters, StretchIsWhatATransformDoesToLengths) {
  const Mat4 scale = glm::scale(Mat4(1.0f), Vec3(1, 2, 3));
  for (int k = 0; k < 50; ++k) {
    const Vec3 axis = glm::normalize(builtin::random3(7, uint64_t(k)) * 2.0f - 1.0f);
    const Mat4 turn = glm::rotate(glm::translate(Mat4(1.0f), Vec3(5, 6, 7)), float(k), axis);
    EXPECT_EQ(stretchOf(turn), glm::dmat3(1.0)) << "to the bit: a mesh that turns stays the same";
    EXPECT_EQ(stretchOf(turn * scale), stretchOf(scale)) << k;
    const Mat4 skew = turn * scale * glm::rotate(Mat4(1.0f), float(k) * 1.7f, glm::normalize(builtin::random3(8, uint64_t(k)) + 0.1f));
    const glm::dmat3 s = stretchOf(skew), m{glm::mat3(skew)};
    const glm::dmat3 error = glm::transpose(s) * s - glm::transpose(m) * m;
    for (int c = 0; c < 3; ++c) EXPECT_LT(glm::length(error[c]), 1e-4) << "R is orthogonal";
    EXPECT_LT(glm::length(s[0] - glm::transpose(s)[0]), 1e-12);
  }
  const glm::dmat3 three = stretchOf(glm::scale(Mat4(1.0f), Vec3(1, 2, 3)));
  EXPECT_EQ(three, glm::dmat3(1, 0, 0, 0, 2, 0, 0, 0, 3));
  EXPECT_EQ(stretchOf(glm::scale(Mat4(1.0f), Vec3(-1, 1, 1))), glm::dmat3(1.0)) << "mirrored";
  EXPECT_NEAR(stretchOf(glm::scale(Mat4(1.0f), Vec3(1e-30f)))[0][0] / 1e-30, 1.0, 1e-5);
}

/// Objects that are flat along an axis of no particular direction, as rig_pose.cpp makes them, keep an inverse.
TEST(MeshFilters, FlatObjectsHaveAStretchWithAnInverse) {
  for (const float thin : {1e-3f, 1e-6f, 1e-12f, 0.0f})
    for (int k = 0; k < 20; ++k) {
      const Mat4 turn = glm::rotate(Mat4(1.0f), float(k), glm::normalize(builtin::random3(9, uint64_t(k)) + 0.05f));
      const glm::dmat3 s = stretchOf(glm::scale(Mat4(1.0f), Vec3(1, 1, thin)) * turn), i = glm::inverse(s);
      const glm::dmat3 one = s * i;
      for (int c = 0; c < 3; ++c) EXPECT_LT(glm::length(one[c] - glm::dmat3(1.0)[c]), 1e-6) << thin;
      EXPECT_GT(glm::determinant(s), 0.5 * std::max(double(thin), 1e-7)) << thin << ", " << k;
      EXPECT_LT(glm::determinant(s), 2.0 * std::max(double(thin), 1e-7)) << thin << ", " << k;
    }
  EXPECT_EQ(stretchOf(Mat4(0.0f)), glm::dmat3(1.0));
}

// Metres are metres of the world, whatever the object's transform does.
TEST(MeshFilters, InflationIsInMetresOfTheWorld) {
  const MeshPtr ball = ballMesh(1.0f, 24);
  for (const Mat4& toWorld :
       {glm::scale(Mat4(1.0f), Vec3(4.0f)), glm::rotate(Mat4(1.0f), 1.0f, Vec3(0, 0.6f, 0.8f)) * glm::scale(Mat4(1.0f), Vec3(1, -2, 3))}) {
    MeshFilter f = inflated(0.125);
    f.stretch = stretchOf(toWorld);
    const MeshPtr to = made(ball, f);
    for (size_t i = 0; i < ball->positions.size(); ++i) {
      const DVec3 before(toWorld * Vec4(ball->positions[i], 1)), after(toWorld * Vec4(to->positions[i], 1));
      EXPECT_NEAR(glm::length(after - before), 0.125, 2e-6);
      EXPECT_GT(glm::dot(after - before, before), 0.0) << "out, also where the transform mirrors";
    }
  }
}

// Shading normals in the object's coordinates are stretched by the inverse: on an ellipsoid they are those of the surface before and after.
TEST(MeshFilters, NormalsTurnAsTheSurfaceInTheWorldDoes) {
  const Mat4 toWorld = glm::scale(Mat4(1.0f), Vec3(1, 0.25f, 1));
  MeshFilter f = inflated(0.5);
  f.stretch = stretchOf(toWorld);
  const MeshPtr to = made(ballMesh(1.0f, 96), f);
  for (size_t t = 0; t < to->triangles(); ++t) {
    auto [p, q, r] = cornersOf(*to, t);
    for (DVec3* c : {&p, &q, &r}) *c = f.stretch * *c;
    const DVec3 face = glm::normalize(glm::cross(q - p, r - p));
    for (int k = 0; k < 3; ++k) {
      const DVec3 n = glm::normalize(glm::inverse(f.stretch) * DVec3(to->normals[to->indices[3 * t + k]]));
      EXPECT_GT(glm::dot(n, face), 0.99);
    }
  }
}

// What an artist bent stays bent by as much; tangents turn along and keep their handedness.
TEST(MeshFilters, BentNormalsStayBent) {
  Mesh sheet = *sheetMesh(8, 0.5f);
  const Vec3 bent = glm::normalize(Vec3(0.3f, 0.1f, 1.0f));
  sheet.normals = Array<Vec3>(sheet.positions.size(), bent);
  sheet.tangents = Array<Vec4>(sheet.positions.size(), Vec4(1, 0, 0, -1));
  for (Vec3& p : sheet.positions) p.z = 0.5f * p.x;  // a ramp under normals of another ramp
  const MeshPtr from = sealedMesh(sheet), to = made(from, inflated(0.25));
  for (size_t i = 0; i < to->normals.size(); ++i) {
    EXPECT_LT(glm::length(to->normals[i] - bent), 1e-6f);
    EXPECT_LT(glm::length(to->tangents[i] - Vec4(1, 0, 0, -1)), 1e-6f);
  }
  // A pyramid flattened by smoothing: its normals end where a flat sheet's are, from wherever they were bent to.
  Mesh ridge = *sheetMesh(8, 0.5f);
  for (size_t i = 0; i < ridge.positions.size(); ++i) {
    Vec3& p = ridge.positions[i];
    const bool left = p.x < 2.0f;
    p.z = left ? 0.5f * p.x : 2.0f - 0.5f * p.x;
    ridge.normals[i] = glm::normalize(p.x == 2.0f ? Vec3(0, 0, 1) : Vec3(left ? -0.5f : 0.5f, 0, 1));
  }
  MeshFilter f;
  f.smooth = 3000;
  f.step = 1.0;
  f.smoothing = MeshSmoothing::Laplacian;
  // Its rim shrinks as a curve, all of it; what is left is nearly flat.
  const MeshPtr flat = made(sealedMesh(ridge), [&] {
    f.smooth = 30;
    return f;
  }());
  for (size_t t = 0; t < flat->triangles(); ++t) {
    const auto [p, q, r] = cornersOf(*flat, t);
    const DVec3 face = glm::normalize(glm::cross(q - p, r - p));
    for (int k = 0; k < 3; ++k) EXPECT_GT(glm::dot(DVec3(flat->normals[flat->indices[3 * t + k]]), face), 0.97);
  }
}

TEST(MeshFilters, TurnedIsTheShortestRotation) {
  for (uint64_t k = 0; k < 100; ++k) {
    const DVec3 a(glm::normalize(builtin::random3(1, k) - 0.5f)), b(glm::normalize(builtin::random3(2, k) - 0.5f)), v(builtin::random3(3, k) - 0.5f);
    EXPECT_LT(glm::length(turned(a, a, b) - b), 1e-6);
    EXPECT_NEAR(glm::length(turned(v, a, b)), glm::length(v), 1e-6);
    const DVec3 axis = glm::cross(a, b);
    EXPECT_LT(glm::length(turned(axis, a, b) - axis), 1e-6);
  }
  const DVec3 up(0, 0, 1);
  EXPECT_EQ(turned(up, up, -up), -up);
  EXPECT_TRUE(glm::all(glm::lessThan(glm::abs(turned(DVec3(1, 0, 0), up, -up)), DVec3(1.5))));
}

// A sheet that lies on its own back has no outside: rounding must not choose one.
TEST(MeshFilters, WhereNormalsCancelNothingMoves) {
  const Mat4 tilt = glm::rotate(Mat4(1.0f), 0.7f, glm::normalize(Vec3(1, 2, 3)));
  Mesh two;
  std::vector<Vec3> p;
  for (const Vec3& c : {Vec3(0), Vec3(1, 0, 0), Vec3(1.3f, 0.9f, 0), Vec3(-0.2f, 0.7f, 0)}) p.emplace_back(tilt * Vec4(c, 1));
  two.positions = Array<Vec3>(std::move(p));
  two.indices = {0, 1, 2, 0, 2, 3, 3, 2, 1, 3, 1, 0};  // front and back, cut along other diagonals
  const MeshPtr from = sealedMesh(two), to = made(from, inflated(0.5));
  EXPECT_EQ(to->positions, from->positions);

  // Nor do its shading normals turn, from the rounding before to that after it moved.
  Mesh sheet = *sheetMesh(4, 0.5f);
  for (size_t i = 0; i < sheet.positions.size(); ++i) sheet.positions[i] = Vec3(tilt * Vec4(sheet.positions[i] + 0.1f * builtin::random3(4, i), 1));
  const size_t half = sheet.indices.size();
  for (size_t k = 0; k < half; k += 3)
    for (const size_t corner : {k, k + 2, k + 1}) sheet.indices.push_back(sheet.indices[corner]);
  MeshFilter smooth;
  smooth.smooth = 4;
  const MeshPtr back = sealedMesh(sheet), moved = made(back, smooth);
  EXPECT_NE(moved->positions, back->positions);
  EXPECT_EQ(moved->normals, back->normals);
}

TEST(MeshFilters, TrianglesWithoutAreaAndLooseVerticesDoNoHarm) {
  Mesh ball = *ballMesh(1.0f, 12);
  const uint32_t loose = uint32_t(ball.positions.size());
  ball.positions.push_back(Vec3(9, 9, 9));
  ball.normals.push_back(Vec3(0, 1, 0));
  ball.uv[0].push_back(Vec2(0.0f));
  ball.indices.insert(ball.indices.end(), {0u, 0u, 20u, 20u, 20u, 20u, 30u, 31u, 30u});
  const MeshPtr from = sealedMesh(ball);
  MeshFilter f = inflated(0.1);
  f.smooth = 3;
  for (const double side : {0.0, 0.3}) {
    f.cluster = side;
    const MeshPtr to = made(from, f);
    EXPECT_TRUE(finiteMesh(*to)) << side;
    if (side == 0.0) EXPECT_EQ(to->positions[loose], Vec3(9, 9, 9));
    else EXPECT_LT(to->positions.size(), from->positions.size());
  }
}

TEST(MeshFilters, TooFarIsSaidAndNotMade) {
  const auto r = filterMesh(ballMesh(1.0f, 12), inflated(2e9));
  ASSERT_TRUE(r.ok());
  EXPECT_EQ(r->end, FilteredMesh::End::Beyond);
  EXPECT_EQ(r->mesh, nullptr);
}

TEST(MeshFilters, FlatShadingStaysFlat) {
  const MeshPtr ball = ballMesh(1.0f, 16, false);
  MeshFilter f = inflated(0.1);
  f.smooth = 2;
  f.cluster = 0.2;
  EXPECT_TRUE(made(ball, f)->normals.empty());
}

TEST(MeshFilters, StopAnywhere) {
  const MeshPtr ball = ballMesh(1.0f, 128);
  MeshFilter f = inflated(0.1);
  f.cluster = 0.01;
  f.smooth = 5;
  const int polls = pollsOf([&](const StopToken& s) { ASSERT_TRUE(filterMesh(ball, f, s).ok()); });
  EXPECT_GE(polls, 150);
  for (int k = 1; k <= polls; k += 1 + polls / 40) EXPECT_EQ(filterMesh(ball, f, stopAt(k)).status().code(), Code::Cancelled) << k;
  EXPECT_EQ(filterMesh(ball, f, stopAt(polls)).status().code(), Code::Cancelled);
}

TEST(MeshFilters, NumbersAreThoseOfTheFirstOccurrence) {
  Numbering n(1);  // grows
  for (int round = 0; round < 2; ++round)
    for (uint64_t i = 0; i < 5000; ++i) EXPECT_EQ(n.of(i % 7, i / 7, 0), uint32_t(i));
  EXPECT_EQ(n.size(), 5000u);
}

}  // namespace mesh_filters_test
}  // namespace gobo::tests
