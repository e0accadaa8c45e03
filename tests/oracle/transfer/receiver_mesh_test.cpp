// SPDX-License-Identifier: Apache-2.0
// How many points there are, where, and what lies between them: triangles of any proportions, dense meshes, gaps.
#include "techniques/transfer/receiver_mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/receiver_clusters.h"

namespace gobo::transfer::receiver_mesh_test {
namespace {

using tests::SceneMaker;

const std::vector<int> kNoLights;
SceneView viewOf(const Scene& scene) { return SceneView(scene, ReceiverMesh::kFacets, kNoLights); }
Vec3 meanOf(const ReceiverMesh::Points& points, const Between& at) {
  Vec3 mean(0.0f);
  for (size_t k = 0; k < kCorners; ++k) mean += at.weight[k] * points.position[at.point[k]];
  return mean;
}

// A strip 60 times as long as it is wide has points where it is long, not where it is thin; linear functions are kept.
TEST(ReceiverMesh, AThinTriangleIsCutAlongItsLength) {
  SceneMaker m;
  m.instance(m.mesh(tests::quad(Vec3(0.0f), Vec3(6, 0, 0), Vec3(0, 0, -0.1f)), m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
  const ScenePtr scene = m.finish();
  const SceneView view = viewOf(*scene);
  const ReceiverMesh mesh(view, 200);
  EXPECT_LE(mesh.size(), 200u);
  EXPECT_GE(mesh.size(), 120u);
  EXPECT_LT(mesh.spacing(), 0.15f);  // n x n alike would be 0.6
  const auto points = mesh.points(view);
  for (uint32_t i = 0; i < 500; ++i) {
    const Vec2 q = SobolSampler(3, i).next2D();
    const float r = std::sqrt(q.x);
    for (uint32_t t = 0; t < 2; ++t) {
      Between at;
      ASSERT_TRUE(mesh.locate(0, t, r * (1 - q.y), r * q.y, true, at));
      const Mesh& of = *scene->meshes[0];
      const uint32_t* v = of.indices.data() + 3 * t;
      const Vec3 place = (1 - r) * of.positions[v[0]] + r * (1 - q.y) * of.positions[v[1]] + r * q.y * of.positions[v[2]];
      EXPECT_LT(glm::length(meanOf(points, at) - place), 0.1f * mesh.spacing());  // drawn in
    }
  }
}

// Normals by the cofactors of a scale of 1e-7 are of 1e-14.
TEST(ReceiverMesh, NormalsOfTinyInstancesAreTheVertices) {
  SceneMaker m;
  Mesh bent = tests::quad(Vec3(0.0f), Vec3(1e7f, 0, 0), Vec3(0, 1e7f, 0));
  bent.normals = Array<Vec3>(std::vector<Vec3>(4, Vec3(0.6f, 0, 0.8f)));
  m.instance(m.mesh(std::move(bent), m.material(Vec3(0.5f))), tests::scaling(Vec3(1e-7f)));
  const ScenePtr scene = m.finish();
  const SceneView view = viewOf(*scene);
  const ReceiverMesh mesh(view, 100);
  const auto points = mesh.points(view);
  ASSERT_GT(mesh.size(), 0u);
  for (size_t i = 0; i < mesh.size(); ++i) EXPECT_NEAR(std::fabs(points.normal[i].x), 0.6f, 1e-3f) << i;  // of both sides
}

// A ball of 20 000 triangles, for 300 points: no more, each place near its points, and no jump on the way from one to another.
TEST(ReceiverMesh, ADenseMeshIsThinnedToWhatIsAskedFor) {
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 100, true), m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
  const ScenePtr scene = m.finish();
  const SceneView view = viewOf(*scene);
  const Mesh& of = *scene->meshes[0];
  ASSERT_GT(of.triangles(), 15000u);
  for (const uint32_t wanted : {60u, 300u, 3000u}) {
    const ReceiverMesh mesh(view, wanted);
    EXPECT_LE(mesh.size(), wanted);
    EXPECT_GE(mesh.size(), wanted / 4);
    const auto points = mesh.points(view);
    float farthest = 0, jump = 0;
    for (uint32_t t = 0; t < of.triangles(); ++t) {
      Between a, b;
      mesh.locate(0, t, 0.9f, 0.05f, true, a);
      mesh.locate(0, t, 0.05f, 0.9f, true, b);
      const uint32_t* v = of.indices.data() + 3 * t;
      const Vec3 place = 0.05f * of.positions[v[0]] + 0.9f * of.positions[v[1]] + 0.05f * of.positions[v[2]];
      const Vec3 normal = glm::normalize(place);
      for (size_t k = 0; k < kCorners; ++k)
        if (a.weight[k] > 0) { EXPECT_GT(glm::dot(points.normal[a.point[k]], normal), wanted > 100 ? 0.5f : 0.0f); }
      farthest = std::max(farthest, glm::length(meanOf(points, a) - place));
      jump = std::max(jump, glm::length(meanOf(points, a) - meanOf(points, b)));
    }
    std::printf("  %u points, %zu there, spacing %.3f: at most %.3f from its points' mean, %.3f in a triangle\n", wanted, mesh.size(), double(mesh.spacing()),
                double(farthest), double(jump));
    EXPECT_LT(farthest, 0.8f * mesh.spacing());
    EXPECT_LT(jump, 0.5f * mesh.spacing() + 0.07f);  // a triangle of the ball is 0.06 long
  }
  EXPECT_EQ(receiverMesh(view, 300).get(), receiverMesh(view, 300).get());  // made once
  EXPECT_NE(receiverMesh(view, 300)->size(), receiverMesh(view, 3000)->size());
}

// A plate folded by a right angle: what is interpolated on one side has nothing of the other, though triangles connect them.
TEST(ReceiverClusters, DoNotReachRoundAnEdge) {
  constexpr int kSide = 20;
  constexpr float kStep = 0.1f;
  std::vector<Vec3> position, normal;
  Corners corners;
  for (int x = -kSide; x <= kSide; ++x)
    for (int z = 0; z <= kSide; ++z) {
      position.push_back(x <= 0 ? Vec3(kStep * float(x), 0, kStep * float(z)) : Vec3(0, -kStep * float(x), kStep * float(z)));
      normal.push_back(x <= 0 ? Vec3(0, 1, 0) : Vec3(1, 0, 0));
      const uint32_t slot = uint32_t(position.size()) - 1, row = kSide + 1;
      if (x == -kSide || z == 0) continue;
      corners.triangles.push_back({slot, slot - 1, slot - row});
      corners.triangles.push_back({slot - 1, slot - row - 1, slot - row});
    }
  corners.position = position;
  corners.normal = normal;
  const float spacing = 0.45f;
  const Clusters clusters = clusterCorners(corners, spacing);
  int between = 0;
  const std::vector<Stencil> made = stencils(corners, clusters, spacing);
  for (size_t slot = 0; slot < made.size(); ++slot)
    for (size_t k = 0; k < 3; ++k) {
      if (!(made[slot].weight[k] > 0.0f)) continue;
      EXPECT_EQ(normal[clusters.member[made[slot].cluster[k]]], normal[slot]) << slot;
      between += k > 0;
    }
  EXPECT_GT(between, 400);
}

// Vertex normals that point into a body (a mirrored or wrongly wound mesh) are turned to their faces' side: points receive where they are seen.
TEST(ReceiverMesh, NormalsAreOnTheirFacesSide) {
  Mesh ball = tests::sphere(Vec3(0.0f), 1.0f, 12, true);
  for (Vec3& normal : ball.normals) normal = -normal;
  SceneMaker m;
  m.instance(m.mesh(std::move(ball), m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
  const ScenePtr scene = m.finish();
  const SceneView view = viewOf(*scene);
  for (const uint32_t wanted : {50u, 2000u}) {  // thinned; every vertex
    const auto points = ReceiverMesh(view, wanted).points(view);
    for (size_t i = 0; i < points.position.size(); ++i) EXPECT_GT(glm::dot(points.normal[i], points.position[i]), 0.0f);
  }
}

// Of single-sided materials: back faces that somebody may see have points, those inside of a closed body have none.
TEST(ReceiverMesh, BacksHavePointsWhereTheyMayBeSeen) {
  const auto both = [](Mesh of, const std::function<void(Material&)>& change = {}) {
    SceneMaker m;
    m.instance(m.mesh(std::move(of), m.material(Vec3(0.5f), [&](Material& x) {
      x.coverage.doubleSided = false;
      if (change) change(x);
    })));
    const ScenePtr scene = m.finish();
    const ReceiverMesh mesh(viewOf(*scene), 300);
    Between at;
    EXPECT_TRUE(mesh.locate(0, 0, 0.3f, 0.3f, true, at));
    return mesh.locate(0, 0, 0.3f, 0.3f, false, at);
  };
  const Mesh box = tests::box(Vec3(-1, 0, 2), Vec3(1, 0.01f, 5)), ball = tests::sphere(Vec3(0.0f), 1.0f, 12, true);
  const auto apart = [](const Mesh& of) {  // vertices of their own for each triangle
    Mesh out;
    for (const uint32_t i : of.indices) {
      out.indices.push_back(uint32_t(out.positions.size()));
      out.positions.push_back(of.positions[i]);
    }
    return out;
  };
  EXPECT_FALSE(both(box));
  EXPECT_FALSE(both(apart(box)));
  EXPECT_FALSE(both(ball)) << "vertices of a pole are apart by rounding";
  EXPECT_TRUE(both(box, [](Material& x) { x.coverage.doubleSided = true; }));
  EXPECT_TRUE(both(box, [](Material& x) { x.coverage.mode = AlphaMode::Mask; })) << "its inside may be seen through holes";
  EXPECT_TRUE(both(tests::quad(Vec3(0.0f), Vec3(1, 0, 0), Vec3(0, 1, 0))));
  EXPECT_TRUE(both(tests::box(Vec3(-1), Vec3(1), true))) << "a room";
  Mesh open = ball, turned = box, folded = tests::quad(Vec3(0.0f), Vec3(1, 0, 0), Vec3(0, 1, 0));
  for (int k = 0; k < 3; ++k) open.indices.pop_back();
  EXPECT_TRUE(both(open));
  std::swap(turned.indices[4], turned.indices[5]);
  EXPECT_TRUE(both(turned)) << "one triangle the other way round";
  for (const uint32_t i : {0u, 2u, 1u, 0u, 3u, 2u}) folded.indices.push_back(i);
  EXPECT_TRUE(both(folded)) << "a sheet on its own back encloses nothing";
}

// Many small bodies cannot have less than a point each, whatever is asked for.
TEST(ReceiverMesh, EveryBodyKeepsAPoint) {
  SceneMaker m;
  const int ball = m.mesh(tests::sphere(Vec3(0.0f), 0.01f, 6, true), m.material(Vec3(0.5f)));
  for (int i = 0; i < 300; ++i) m.instance(ball, tests::translate(Vec3(float(i % 20), 0, float(i / 20))));
  const ScenePtr scene = m.finish();
  const SceneView view = viewOf(*scene);
  const ReceiverMesh mesh(view, 100);
  EXPECT_GE(mesh.size(), 600u);  // both sides
  Between at;
  for (uint32_t i = 0; i < 300; ++i) {
    ASSERT_TRUE(mesh.locate(i, 3, 0.3f, 0.3f, true, at));
    for (size_t k = 0; k < kCorners; ++k) ASSERT_LT(at.point[k], mesh.size());
  }
}

}  // namespace
}  // namespace gobo::transfer::receiver_mesh_test
