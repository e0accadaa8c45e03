// SPDX-License-Identifier: Apache-2.0
// Vertex clustering: counts on grids, where representatives lie, closed surfaces that stay closed, attributes at seams and creases.
#include <gtest/gtest.h>

#include "scene/mesh_filters/cluster.h"
#include "scene/mesh_filters/mesh_filters.h"
#include "scene/mesh_filters/quadric.h"
#include "support/mesh_shapes.h"

namespace gobo::tests {
namespace mesh_cluster_test {

MeshPtr clustered(const MeshPtr& mesh, double side) {
  MeshFilter f;
  f.cluster = side;
  const auto r = filterMesh(mesh, f);
  EXPECT_TRUE(r.ok());
  EXPECT_EQ(r->end, FilteredMesh::End::Made);
  return r->mesh;
}

struct Clustering {
  WeldedMesh welded;
  PointGraph graph;
  VertexClusters clusters;
  Clustering(const Mesh& mesh, double side) {
    EXPECT_TRUE(weld(mesh, glm::dmat3(1.0), {}, welded));
    EXPECT_TRUE(connect(welded, {}, graph));
    EXPECT_TRUE(clusterPoints(welded, graph, side, {}, clusters));
  }
};

TEST(MeshCluster, CountsOnAGrid) {
  // Points 0 .. 8 in cubes of 2 around multiples of 2: {0} {1 2} {3 4} {5 6} {7 8}.
  const MeshPtr sheet = clustered(sheetMesh(8, 1.0f), 2.0);
  EXPECT_EQ(sheet->positions.size(), 25u);
  EXPECT_EQ(sheet->triangles(), 32u);
  EXPECT_NEAR(areaOf(*sheet), 64.0, 1e-5) << "the rim keeps its corners";
  for (const Vec3& p : sheet->positions) EXPECT_EQ(p.z, 0.0f);
  std::set<Place> places;
  for (const Vec3& p : sheet->positions) places.insert(placeOf(p));
  for (const Place& corner : {Place{0, 0, 0}, Place{8, 0, 0}, Place{0, 8, 0}, Place{8, 8, 0}}) EXPECT_TRUE(places.count(corner)) << corner[0] << corner[1];
  for (const Vec3& n : sheet->normals) EXPECT_EQ(n, Vec3(0, 0, 1));
  // Texture coordinates are (x / 8, 1 - y / 8): means over cubes.
  for (size_t i = 0; i < sheet->positions.size(); ++i) {
    EXPECT_GE(sheet->uv[0][i].x, 0.0f);
    EXPECT_LE(sheet->uv[0][i].x, 1.0f);
    EXPECT_NEAR(sheet->uv[0][i].x, sheet->positions[i].x / 8.0f, 0.13f);
  }
}

TEST(MeshCluster, RepresentativesStayInTheirCubes) {
  Mesh bumpy = torusMesh(60, 40);
  for (size_t i = 0; i < bumpy.positions.size(); ++i) bumpy.positions[i] += 0.1f * (builtin::random3(5, i) - 0.5f);
  for (const Mesh& mesh : {bumpy, *boxMesh(1.0f, 9), *ballMesh(1.0f, 40)})
    for (const double side : {0.11, 0.3, 0.7}) {
      const Clustering c(mesh, side);
      EXPECT_GT(c.clusters.centre.size(), 10u);
      for (size_t k = 0; k < c.clusters.centre.size(); ++k) {
        const DVec3 away = glm::abs(c.clusters.representative[k] - c.clusters.centre[k]);
        EXPECT_LE(std::max({away.x, away.y, away.z}), 0.5 * side * (1.0 + 1e-12)) << side;
      }
      for (size_t i = 0; i < c.welded.points.size(); ++i) {
        const DVec3 away = glm::abs(c.welded.points[i] - c.clusters.centre[c.clusters.of[i]]);
        EXPECT_LE(std::max({away.x, away.y, away.z}), 0.5 * side * (1.0 + 1e-12)) << "cubes hold their own";
      }
    }
}

// Flat faces, edges and corners of a box are kept: quadrics see planes, not points.
TEST(MeshCluster, TheBestPlaceOfABoxIsItsCornersAndEdges) {
  const Clustering c(*boxMesh(1.0f, 20), 0.7);
  int corners = 0, edges = 0;
  for (size_t k = 0; k < c.clusters.centre.size(); ++k) {
    const DVec3 at = glm::abs(c.clusters.centre[k]), p = glm::abs(c.clusters.representative[k]);
    int outer = 0;
    for (int axis = 0; axis < 3; ++axis)
      if (at[axis] > 0.5) {
        ++outer;
        EXPECT_NEAR(p[axis], 1.0, 1e-9);
      }
    corners += outer == 3;
    edges += outer == 2;
  }
  EXPECT_EQ(corners, 8);
  EXPECT_EQ(edges, 12);
  const MeshPtr box = clustered(boxMesh(1.0f, 20), 0.7);
  EXPECT_NEAR(areaOf(*box), 24.0, 1e-5);
  EXPECT_NEAR(volumeOf(*box), 8.0, 1e-5);
  for (size_t i = 0; i < box->normals.size(); ++i) {
    const Vec3 n = glm::abs(box->normals[i]);
    EXPECT_NEAR(std::max({n.x, n.y, n.z}), 1.0f, 1e-6f) << "creases stay creases";
  }
}

TEST(MeshCluster, QuadricsOfThreePlanesMeetInAPoint) {
  for (uint64_t k = 0; k < 200; ++k) {
    const DVec3 x(builtin::random3(11, k));
    Quadric q;
    for (uint64_t j = 0; j < 5; ++j) q.add(DVec3(builtin::random3(12 + j, k) - 0.5f), x);
    const SymmetricEigen e = symmetricEigen(q.a);
    glm::dmat3 again(0.0);
    for (int j = 0; j < 3; ++j) again += glm::outerProduct(e.vector[j], e.vector[j]) * e.value[j];
    for (int j = 0; j < 3; ++j) EXPECT_LT(glm::length(again[j] - q.a[j]), 1e-12);
    const double most = std::max({e.value.x, e.value.y, e.value.z}), least = std::min({e.value.x, e.value.y, e.value.z});
    if (least > kFlat * most) EXPECT_LT(glm::length(leastNear(q, DVec3(builtin::random3(13, k))) - x), 1e-9);
  }
  EXPECT_EQ(leastNear(Quadric(), DVec3(1, 2, 3)), DVec3(1, 2, 3)) << "nothing is known";
  Quadric flat;  // one plane: down to it, not along
  flat.add(DVec3(0, 0, 2), DVec3(9, 9, 0.25));
  EXPECT_LT(glm::length(leastNear(flat, DVec3(1, 2, 3)) - DVec3(1, 2, 0.25)), 1e-12);
  flat.add(DVec3(1e-3, 0, 0), DVec3(1e6, 0, 0));  // noise of a flat piece: far below kFlat, squared
  EXPECT_LT(glm::length(leastNear(flat, DVec3(1, 2, 3)) - DVec3(1, 2, 0.25)), 1e-6);
}

// Planes at a small angle meet far away: the way there ends at the wall, and is better than where it began.
TEST(MeshCluster, FarOptimaAreCutAtTheCube) {
  Quadric q;
  q.add(DVec3(0, 0, 1), DVec3(0.0));
  q.add(glm::normalize(DVec3(0.1, 0, 1)), DVec3(0, 0, 2.0));
  const DVec3 near(0.1, 0.2, 0.3), best = leastNear(q, near), cut = leastInBox(q, near, DVec3(0.0), 0.5);
  EXPECT_GT(std::fabs(best.x), 5.0);
  EXPECT_NEAR(std::max({std::fabs(cut.x), std::fabs(cut.y), std::fabs(cut.z)}), 0.5, 1e-12);
  EXPECT_LT(q.error(cut), q.error(near));
  EXPECT_LT(glm::length(glm::cross(cut - near, best - near)), 1e-9) << "on the way";
  const DVec3 wall(best.x > 0 ? 0.5 : -0.5, 0.2, 0.3);
  EXPECT_EQ(leastInBox(q, wall * (1.0 + 1e-15), DVec3(0.0), 0.5).x, wall.x * (1.0 + 1e-15)) << "at the wall there is no way";
}

TEST(MeshCluster, ClosedSurfacesStayClosed) {
  Mesh bumpy = torusMesh(90, 50);
  for (size_t i = 0; i < bumpy.positions.size(); ++i) bumpy.positions[i] += 0.05f * (builtin::random3(6, i) - 0.5f);
  for (const MeshPtr& mesh : {sealedMesh(bumpy), ballMesh(1.0f, 48), boxMesh(1.0f, 10)}) {
    if (mesh->name != "box") ASSERT_EQ(tornEdges(*mesh), 0u);  // whose faces round apart
    size_t last = mesh->triangles();
    for (const double side : {0.06, 0.13, 0.29, 0.55}) {
      const MeshPtr small = clustered(mesh, side);
      EXPECT_EQ(tornEdges(*small), 0u) << mesh->name << ", " << side;
      EXPECT_LE(small->triangles(), last);
      EXPECT_TRUE(finiteMesh(*small));
      last = small->triangles();
    }
    EXPECT_LT(last, mesh->triangles() / 4);
  }
}

TEST(MeshCluster, AClusteredBallIsABall) {
  const MeshPtr ball = ballMesh(1.0f, 200);
  for (const double side : {0.1, 0.2}) {
    const MeshPtr small = clustered(ball, side);
    EXPECT_NEAR(volumeOf(*small) / volumeOf(*ball), 1.0, 2.0 * side * side) << side;
    // Normals are means of the ball's own: radial within the angle of a cube. On both sides of the seam they are one.
    std::map<Place, Vec3> at;
    for (size_t i = 0; i < small->positions.size(); ++i) {
      EXPECT_GT(glm::dot(small->normals[i], glm::normalize(small->positions[i])), 0.995f);
      const auto [there, added] = at.emplace(placeOf(small->positions[i]), small->normals[i]);
      if (!added) EXPECT_LT(glm::length(there->second - small->normals[i]), 1e-6f);
    }
    EXPECT_LT(at.size(), small->positions.size()) << "the seam has two sides";
    float lo = 1, hi = 0;
    for (const Vec2& v : small->uv[0]) {
      lo = std::min(lo, v.x);
      hi = std::max(hi, v.x);
    }
    EXPECT_LT(lo, 0.04f) << "not mixed over the seam";
    EXPECT_GT(hi, 0.96f);
  }
}

// Two sheets in one layer of cubes: both sides are kept, once each, though there is nothing between them any more.
TEST(MeshCluster, AThinSlabKeepsBothSides) {
  builtin::MeshBuilder b;
  b.quad(Vec3(0, 0, 0.1f), Vec3(8, 0, 0), Vec3(0, 8, 0), 8, 8);
  b.quad(Vec3(0, 0, -0.1f), Vec3(0, 8, 0), Vec3(8, 0, 0), 8, 8);
  b.quad(Vec3(0, 0, 0.05f), Vec3(8, 0, 0), Vec3(0, 8, 0), 8, 8);  // once more, facing up
  const MeshPtr slab = clustered(b.finish("slab", 0), 2.0);
  std::map<Vec3, int, bool (*)(const Vec3&, const Vec3&)> facing([](const Vec3& a, const Vec3& c) { return a.z < c.z; });
  double up = 0, down = 0;
  for (size_t t = 0; t < slab->triangles(); ++t) {
    const auto [p, q, r] = cornersOf(*slab, t);
    const double z = 0.5 * glm::cross(q - p, r - p).z;
    (z > 0 ? up : down) += std::fabs(z);
  }
  EXPECT_NEAR(up, 64.0, 1e-4);
  EXPECT_NEAR(down, 64.0, 1e-4);
}

TEST(MeshCluster, CubesFinerThanThePointsChangeNothing) {
  for (const MeshPtr& mesh : {ballMesh(1.0f, 24), sealedMesh(torusMesh(20, 10))})
    for (const double side : {1e-6, 1e-300, 1e-320}) {
      MeshFilter f;
      f.cluster = side;
      f.stretch = glm::dmat3(1.0 / 3.0);  // there and back is not the same to the bit
      const MeshPtr same = filterMesh(mesh, f)->mesh;
      ASSERT_EQ(same->triangles(), mesh->triangles()) << side;
      for (size_t k = 0; k < mesh->indices.size(); ++k) EXPECT_EQ(same->positions[same->indices[k]], mesh->positions[mesh->indices[k]]);
      EXPECT_TRUE(finiteMesh(*same));
    }
}

// Triangles without area that no other touches have no weight: their attributes are plain means.
TEST(MeshCluster, WhatHasNoAreaHasAttributesAllTheSame) {
  Mesh mesh = *sheetMesh(2, 1.0f);
  const uint32_t n = uint32_t(mesh.positions.size());
  for (const float x : {10.0f, 12.0f, 14.0f, 10.25f}) {
    mesh.positions.push_back(Vec3(x, 0, 0));
    mesh.normals.push_back(Vec3(0, 1, 0));
    mesh.uv[0].push_back(Vec2(x, 1.0f));
  }
  mesh.indices.insert(mesh.indices.end(), {n, n + 1, n + 2, n, n + 3, n + 1});
  const MeshPtr made = clustered(sealedMesh(mesh), 1.0);
  EXPECT_TRUE(finiteMesh(*made));
  float far = 0;
  for (const Vec2& v : made->uv[0]) far = std::max(far, v.x == 10.125f ? v.x : 0.0f);
  EXPECT_EQ(far, 10.125f);
}

TEST(MeshCluster, NothingLeftIsSaid) {
  MeshFilter f;
  f.cluster = 10.0;
  const auto r = filterMesh(ballMesh(1.0f, 12), f);
  ASSERT_TRUE(r.ok());
  EXPECT_EQ(r->end, FilteredMesh::End::Clustered);
  EXPECT_EQ(r->mesh, nullptr);
}

TEST(MeshCluster, AttributesAreMeansByArea) {
  // One cube takes points 0 and 1 of a strip; their triangles have areas 1 : 2 : ...
  Mesh strip;
  strip.positions = {Vec3(-0.25f, 0, 0), Vec3(0.25f, 0, 0), Vec3(0, 2, 0), Vec3(2, 1, 0)};
  strip.indices = {0, 1, 2, 1, 3, 2};
  strip.colours = {Vec4(1, 0, 0, 1), Vec4(0, 1, 0, 0.5f), Vec4(0, 0, 1, 1), Vec4(1)};
  strip.normals = Array<Vec3>(4, Vec3(0, 0, 1));
  strip.tangents = {Vec4(1, 0, 0, -1), Vec4(0, 1, 0, -1), Vec4(1, 0, 0, -1), Vec4(1, 0, 0, -1)};
  const MeshPtr made = clustered(sealedMesh(strip), 1.0);
  ASSERT_EQ(made->triangles(), 1u);
  // Areas: 0.5 and |(1.75, 1) x (-0.25, 2)| / 2 = 1.875, so weights 0.5 of point 0 and 2.375 of point 1.
  const float share = 0.5f / 2.875f;
  const Vec4 colour = made->colours[made->indices[0]];
  EXPECT_NEAR(colour.x, share, 1e-6f);
  EXPECT_NEAR(colour.y, 1.0f - share, 1e-6f);
  EXPECT_NEAR(colour.w, share + 0.5f * (1.0f - share), 1e-6f);
  const Vec4 tangent = made->tangents[made->indices[0]];
  EXPECT_EQ(tangent.w, -1.0f);
  EXPECT_NEAR(tangent.y / tangent.x, (1.0f - share) / share, 1e-4f);
  EXPECT_TRUE(finiteMesh(*made));
}

// Normals that cancel have no mean: the heaviest member's stands for them.
TEST(MeshCluster, NormalsThatCancelAreNotMadeUp) {
  Mesh strip;
  strip.positions = {Vec3(-0.25f, 0, 0), Vec3(0.25f, 0, 0), Vec3(0, 2, 0), Vec3(2, 1, 0), Vec3(-2, 1, 0)};
  strip.indices = {0, 1, 2, 1, 3, 2, 0, 2, 4};
  strip.normals = {Vec3(0, 0.6f, 0.8f), Vec3(1e-8f, -0.6f, -0.8f),  // what is left of them is rounding
                   Vec3(0, 0, 1), Vec3(0, 0, 1), Vec3(0, 0, 1)};
  const MeshPtr made = clustered(sealedMesh(strip), 1.0);
  EXPECT_TRUE(finiteMesh(*made));
  const Vec3 n = made->normals[made->indices[0]];
  EXPECT_NEAR(std::fabs(n.y), 0.6f, 1e-6f);
  EXPECT_NEAR(std::fabs(n.z), 0.8f, 1e-6f);
}

// A cube is metres of the world: an object twice as large in the world has cubes half as large in its own coordinates.
TEST(MeshCluster, SidesAreInMetresOfTheWorld) {
  const MeshPtr ball = ballMesh(1.0f, 48);
  MeshFilter f;
  f.cluster = 0.4;
  f.stretch = glm::dmat3(2.0);
  EXPECT_EQ(filterMesh(ball, f)->mesh->positions, clustered(ball, 0.2)->positions);
}

}  // namespace mesh_cluster_test
}  // namespace gobo::tests
