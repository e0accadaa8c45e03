// SPDX-License-Identifier: Apache-2.0
// Smoothing against the eigenvalues of meshes that have Fourier modes: a torus of six neighbours a point, and rims, which are circles of two.
#include <gtest/gtest.h>

#include "scene/mesh_filters/mesh_filters.h"
#include "scene/mesh_filters/smooth.h"
#include "support/mesh_shapes.h"

namespace gobo::tests {
namespace mesh_smooth_test {

constexpr int kN = 24, kM = 16;

struct TorusGraph {
  WeldedMesh welded;
  PointGraph graph;
  TorusGraph() {
    EXPECT_TRUE(weld(torusMesh(kN, kM), glm::dmat3(1.0), {}, welded));
    EXPECT_TRUE(connect(welded, {}, graph));
  }
};

double phase(size_t point, int a, int b) { return 2.0 * M_PI * (a * double(point % kN) / kN + b * double(point / kN) / kM); }

/// Of 1 - (mean over the six neighbours).
double eigenvalue(int a, int b) {
  const double x = 2.0 * M_PI * a / kN, y = 2.0 * M_PI * b / kM;
  return 1.0 - (std::cos(x) + std::cos(y) + std::cos(x + y)) / 3.0;
}

constexpr std::pair<int, int> kModes[] = {{0, 0}, {1, 0}, {0, 1}, {2, 1}, {3, -2}, {6, 5}, {12, 8}, {8, 0}, {8, -5}};

/// The amplitude that mode (a, b) keeps, in all coordinates.
double kept(int a, int b, uint32_t passes, double step, double out) {
  const TorusGraph t;
  EXPECT_EQ(t.graph.neighbour.size(), size_t(6 * kN * kM));
  EXPECT_TRUE(t.graph.rim.empty());
  std::vector<DVec3> wave(size_t(kN * kM));
  for (size_t i = 0; i < wave.size(); ++i) wave[i] = DVec3(std::cos(phase(i, a, b)), std::sin(phase(i, a, b)), 3.0);
  const std::vector<DVec3> before = wave;
  EXPECT_TRUE(smoothPoints(wave, t.graph, passes, step, out, {}));
  const double share = glm::dot(wave[0], DVec3(1, 0, 0));
  for (size_t i = 0; i < wave.size(); ++i) {
    EXPECT_NEAR(wave[i].x, share * before[i].x, 1e-12);
    EXPECT_NEAR(wave[i].y, share * before[i].y, 1e-12);
    EXPECT_NEAR(wave[i].z, 3.0, 1e-12) << "constants stay";
  }
  return share;
}

TEST(MeshSmooth, LaplacianDecaysByItsEigenvalues) {
  for (const auto& [a, b] : kModes)
    for (const double step : {0.3, 0.5, 1.0})
      for (const uint32_t passes : {1u, 7u})
        EXPECT_NEAR(kept(a, b, passes, step, 0.0), std::pow(1.0 - step * eigenvalue(a, b), double(passes)), 1e-12) << a << ", " << b;
}

TEST(MeshSmooth, TaubinKeepsItsPassBand) {
  for (const double step : {0.3, 0.5, 0.69}) {
    const double out = taubinStepOut(step);
    EXPECT_NEAR(1.0 / step - 1.0 / out, kPassBand, 1e-12);
    for (const auto& [a, b] : kModes) {
      const double k = eigenvalue(a, b), once = (1.0 - step * k) * (1.0 + out * k), got = kept(a, b, 10, step, out);
      EXPECT_NEAR(got, std::pow(once, 10.0), 1e-12) << a << ", " << b;
      if (k < kPassBand) EXPECT_NEAR(got, 1.0, 0.02) << a << ", " << b;  // sizes stay
      if (k > 0.5) EXPECT_LT(std::fabs(got), 0.5) << a << ", " << b;
    }
  }
}

// Whatever the mesh, k is at most 2: the largest step is the last before such a wave grows.
TEST(MeshSmooth, TheLargestTaubinStepLetsNothingGrow) {
  const auto factor = [](double step, double k) { return (1.0 - step * k) * (1.0 + taubinStepOut(step) * k); };
  for (double k = 0.0; k <= 2.0; k += 0.001) {
    EXPECT_LT(std::fabs(factor(kLargestTaubinStep, k)), 1.002) << k;
    EXPECT_LT(std::fabs(factor(0.5, k)), 1.0007) << k;
  }
  EXPECT_LT(factor(0.71, 2.0), -1.0);
}

// The rim of a disk is a circle of two neighbours a point, whatever lies inside.
TEST(MeshSmooth, ARimIsSmoothedAsACurve) {
  constexpr int n = 40;
  Mesh disk;
  std::vector<Vec3> p{Vec3(0.0f)};
  std::vector<uint32_t> t;
  for (int i = 0; i < n; ++i) p.emplace_back(std::cos(2.0 * M_PI * i / n), 0.0, -std::sin(2.0 * M_PI * i / n));
  for (int i = 0; i < n; ++i) t.insert(t.end(), {0u, uint32_t(1 + i), uint32_t(1 + (i + 1) % n)});
  disk.positions = Array<Vec3>(p);
  disk.indices = Array<uint32_t>(t);
  MeshFilter f;
  f.smooth = 9;
  f.step = 0.4;
  f.smoothing = MeshSmoothing::Laplacian;
  const auto r = filterMesh(sealedMesh(disk), f);
  ASSERT_TRUE(r.ok());
  const double radius = std::pow(1.0 - 0.4 * (1.0 - std::cos(2.0 * M_PI / n)), 9.0);
  EXPECT_LT(glm::length(DVec3(r->mesh->positions[0])), 1e-7);
  for (int i = 1; i <= n; ++i) EXPECT_NEAR(glm::length(DVec3(r->mesh->positions[i])), radius, 1e-6);
}

// Each vertex of a point moves to the same bits: seams and creases do not open.
TEST(MeshSmooth, SeamsStayClosedAndPointsWithoutNeighboursStay) {
  for (const MeshPtr& from : {ballMesh(1.0f, 20), boxMesh(1.0f, 4)})
    for (const MeshSmoothing how : {MeshSmoothing::Laplacian, MeshSmoothing::Taubin}) {
      MeshFilter f;
      f.smooth = 11;
      f.smoothing = how;
      const auto r = filterMesh(from, f);
      ASSERT_TRUE(r.ok());
      EXPECT_EQ(tornEdges(*r->mesh), 0u);
      EXPECT_LE(placesOf(*r->mesh), placesOf(*from));
      EXPECT_TRUE(finiteMesh(*r->mesh));
      EXPECT_NE(r->mesh->positions, from->positions);
    }
}

TEST(MeshSmooth, LaplacianShrinksABumpyBallAndTaubinDoesNot) {
  Mesh bumpy = *ballMesh(1.0f, 64);
  for (Vec3& p : bumpy.positions) p *= 1.0f + 0.02f * std::sin(31.0f * p.x) * std::sin(29.0f * p.y) * std::sin(37.0f * p.z);  // of places: seams stay closed
  const MeshPtr from = sealedMesh(bumpy);
  const auto roughness = [](const Mesh& m) {
    double mean = 0, square = 0;
    for (const Vec3& p : m.positions) mean += glm::length(DVec3(p)) / double(m.positions.size());
    for (const Vec3& p : m.positions) square += std::pow(glm::length(DVec3(p)) / mean - 1.0, 2) / double(m.positions.size());
    return std::sqrt(square);
  };
  MeshFilter f;
  f.smooth = 40;
  const auto taubin = filterMesh(from, f);
  f.smoothing = MeshSmoothing::Laplacian;
  const auto laplacian = filterMesh(from, f);
  EXPECT_NEAR(volumeOf(*taubin->mesh) / volumeOf(*from), 1.0, 0.02) << "waves of the pass band grow by at most 0.07 % a pass";
  EXPECT_LT(volumeOf(*laplacian->mesh) / volumeOf(*from), 0.9);
  EXPECT_LT(roughness(*taubin->mesh), 0.5 * roughness(*from));
}

TEST(MeshSmooth, ABallShrunkToNothingIsSaid) {
  Mesh away = *ballMesh(1e-3f, 8);
  for (Vec3& p : away.positions) p += Vec3(1000, 0, 0);
  MeshFilter f;
  f.smooth = 1000;
  f.step = 1.0;
  f.smoothing = MeshSmoothing::Laplacian;
  const auto r = filterMesh(sealedMesh(away), f);
  ASSERT_TRUE(r.ok());
  EXPECT_EQ(r->end, FilteredMesh::End::Smoothed);
}

}  // namespace mesh_smooth_test
}  // namespace gobo::tests
