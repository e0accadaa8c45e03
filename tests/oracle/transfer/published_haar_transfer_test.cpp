// SPDX-License-Identifier: Apache-2.0
// Wavelets over cubes of cells, and direct transfer in them, against closed forms and against sums over cells without wavelets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

#include "oracle/transfer/published_maps.h"
#include "support/map_of.h"
#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/published/haar_transfer.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/environment_cells.h"

namespace gobo::transfer::published::haar_transfer_test {
namespace {

using namespace published::tests;
using gobo::tests::SceneMaker;

/// A scene's transfer points and rays.
struct Points {
  ScenePtr scene;
  TaskArena arena;
  AccelPtr accel;
  TermPtr points;

  explicit Points(ScenePtr made, uint32_t wanted = 400, int threads = 2) : scene(std::move(made)), arena(threads) {
    static const std::vector<int> none;
    TransferSettings s;
    s.points = wanted;
    s.bands = 2;
    s.size = uint32_t(ReceiverMesh(SceneView(*scene, ReceiverMesh::kFacets, none), wanted).size());
    gobo::tests::NodeRunner run(*scene, arena);
    points = run(makeTransferPointsNode(s), {});
    accel = Accel::build(SceneView(*scene, kAccelFacets, none), arena);
  }
  size_t size() const { return points->floats("cell").size(); }
  DVec3 vector(const char* plane, size_t i) const {
    const auto v = points->floats(plane);
    return {v[3 * i], v[3 * i + 1], v[3 * i + 2]};
  }
  HaarTransfer transfer(const HaarCells& cells, double drop = 0) const {
    auto t = HaarTransfer::of(cells, *points, *accel, drop, arena);
    EXPECT_TRUE(t.ok()) << t.status().toString();
    return std::move(*t);
  }
};
ScenePtr openPlane() {
  SceneMaker m;
  m.instance(m.mesh(gobo::tests::ground(2.0f), m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
  return m.finish();
}
ScenePtr blocks() {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; });
  m.instance(m.mesh(gobo::tests::ground(3.0f), grey));
  m.instance(m.mesh(gobo::tests::box(Vec3(-1, 0.01f, -1), Vec3(0, 1.5f, 0)), grey));
  m.instance(m.mesh(gobo::tests::box(Vec3(0.6f, 0.3f, 0.2f), Vec3(1.4f, 0.5f, 1.5f)), grey));
  return m.finish();
}
/// A gradient, a broad glow and two lamps of a few degrees: not a map that any constant was chosen on.
EnvironmentPtr keptApart() {
  static const EnvironmentPtr made =
      mapOf([](const DVec3& d) { return 0.4 + 0.3 * d.y + 0.8 * std::exp(6 * (glm::dot(d, glm::normalize(DVec3(-0.6, 0.3, 0.5))) - 1)); },
            {{glm::normalize(DVec3(0.5, 0.8, 0.35)), 2.0, 1.5}, {glm::normalize(DVec3(-0.7, 0.5, -0.5)), 4.0, 0.8}}, 512);
  return made;
}
HaarCells cellsOf(int side) {
  auto cells = HaarCells::of(side);
  EXPECT_TRUE(cells.ok());
  return *cells;
}
std::vector<HaarTerm> lightOf(const HaarCells& cells, const Environment& map, HaarOrder order = HaarOrder::Largest) {
  return haarLight(cells, map, order, TaskArena(2));
}

TEST(CubeWavelets, AreOrthonormalWhateverTheSolidAngles) {
  std::mt19937_64 random(2003);
  for (const int side : {1, 2, 8}) {
    std::vector<double> angles(size_t(6 * side * side));
    for (double& a : angles) a = 1e-3 + double(random() >> 11) * 0x1p-53;
    if (side == 8) angles[17] = angles[18] = angles[19] = 0;
    const CubeWavelets w(side, angles);
    std::vector<std::vector<double>> rows;
    for (size_t k = 0; k < w.size(); ++k) {
      std::vector<double> one(w.size(), 0.0);
      one[k] = 1;
      w.backward(one);
      rows.push_back(one);
      w.forward(one);
      for (size_t i = 0; i < one.size(); ++i) ASSERT_NEAR(one[i], i == k, 1e-13);
    }
    for (size_t a = 0; a < rows.size(); ++a)
      for (size_t b = 0; b <= a; ++b) {
        double dot = 0;
        for (size_t i = 0; i < rows.size(); ++i) dot += rows[a][i] * rows[b][i];
        ASSERT_NEAR(dot, a == b, 1e-13) << side << " " << a << " " << b;
      }
    // A wavelet's support is the cells where it is not 0, and its integral without sign is at most the root of that.
    for (size_t k = 0; k < rows.size(); ++k) {
      double support = 0, integral = 0;
      for (size_t i = 0; i < rows.size(); ++i) {
        support += rows[k][i] != 0 ? angles[i] : 0.0;
        integral += std::fabs(rows[k][i]) * std::sqrt(angles[i]);
      }
      if (angles[k] > 0 && side < 8) { EXPECT_NEAR(support, w.supports()[k], 1e-12); }
      EXPECT_LE(integral, std::sqrt(w.supports()[k]) + 1e-12);
    }
  }
}

TEST(HaarCells, AreTheSphere) {
  for (const int side : {1, 2, 4, 16, 64}) {
    const HaarCells cells = cellsOf(side);
    double whole = 0, open = 0;
    DVec3 balance(0.0);
    for (size_t i = 0; i < cells.wavelets().size(); ++i) {
      const double angle = cells.wavelets().solidAngles()[i];
      whole += angle;
      balance += cells.integrals()[i];
      open += std::max(cells.integrals()[i].y, 0.0);
      EXPECT_LE(glm::length(cells.integrals()[i]), angle * (1 + 1e-12));
      EXPECT_GT(glm::dot(cells.integrals()[i], DVec3(cells.middles()[i])), 0.0);
    }
    EXPECT_NEAR(whole, 4 * std::numbers::pi, 1e-11);
    EXPECT_LT(glm::length(balance), 1e-11);
    // The horizon lies along edges of cells.
    if (side > 1) { EXPECT_NEAR(open, std::numbers::pi, 1e-11); }
  }
  for (const int side : {0, -2, 3, 48, 128}) EXPECT_EQ(HaarCells::of(side).status().code(), Code::InvalidArgument) << side;
}

TEST(HaarLight, AConstantMapIsOneTermAFace) {
  const EnvironmentPtr map = mapOf(3.0, {}, 256);
  for (const int side : {4, 32})
    for (const HaarOrder order : {HaarOrder::Largest, HaarOrder::ByArea}) {
      const std::vector<HaarTerm> terms = lightOf(cellsOf(side), *map, order);
      ASSERT_EQ(terms.size(), size_t(6 * side * side));
      for (size_t k = 0; k < terms.size(); ++k) {
        EXPECT_NEAR(std::fabs(terms[k].value.y), k < 6 ? 3 * std::sqrt(4 * std::numbers::pi / 6) : 0.0, 1e-5);
        if (k < 6) { EXPECT_EQ(terms[k].index % uint32_t(side * side), 0u); }
      }
    }
}

TEST(HaarLight, KeepsFluxAndIsSorted) {
  const EnvironmentPtr map = keptApart();
  const EnvironmentCells exact(*map);
  for (const int side : {8, 32, 64}) {
    const HaarCells cells = cellsOf(side);
    for (const HaarOrder order : {HaarOrder::Largest, HaarOrder::ByArea}) {
      const std::vector<HaarTerm> terms = lightOf(cells, *map, order);
      std::vector<DVec3> value(terms.size());
      for (size_t k = 0; k < terms.size(); ++k) {
        value[terms[k].index] = terms[k].value;
        if (k == 0) continue;
        const auto rank = [&](const HaarTerm& t) {
          return std::fabs(luminanceOf(t.value)) * (order == HaarOrder::ByArea ? std::sqrt(cells.wavelets().supports()[t.index]) : 1.0);
        };
        EXPECT_GE(rank(terms[k - 1]), rank(terms[k]));
      }
      cells.wavelets().backward(value);
      DVec3 flux(0.0);
      for (size_t i = 0; i < value.size(); ++i) flux += value[i] * std::sqrt(cells.wavelets().solidAngles()[i]);
      EXPECT_NEAR(flux.y / exact.flux.y, 1, 2e-3) << side;
    }
  }
}

// All terms: the sum over cells of the mean radiance times what is seen of the cell, by hand and without wavelets.
TEST(HaarTransfer, OfAllTermsIsTheSumOverCells) {
  const Points p(blocks());
  const EnvironmentPtr map =
      mapOf([](const DVec3& d) { return 0.5 + 0.4 * d.x + std::exp(5 * (glm::dot(d, glm::normalize(DVec3(-0.6, 0.3, 0.5))) - 1)); }, {}, 128);
  for (const int side : {4, 16}) {
    const HaarCells cells = cellsOf(side);
    const std::vector<HaarTerm> terms = lightOf(cells, *map);
    const HaarTransfer transfer = p.transfer(cells);
    EXPECT_EQ(transfer.points(), p.size());
    const std::vector<DVec3> all = transfer.irradiance(terms);
    // Cells by small squares of the cube's faces: solid angle dA / r^3.
    constexpr int kFine = 24;
    std::vector<double> angle(terms.size(), 0.0);
    std::vector<DVec3> integral(terms.size(), DVec3(0.0)), middle(terms.size()), radiance(terms.size(), DVec3(0.0));
    for (size_t i = 0; i < terms.size(); ++i) {
      const int face = int(i) / (side * side), row = int(i) / side % side, column = int(i) % side;
      middle[i] = EnvironmentCells::direction(face, -1 + (2 * column + 1.0) / side, -1 + (2 * row + 1.0) / side);
      for (int k = 0; k < kFine * kFine; ++k) {
        const double x = -1 + 2 * (column + (k % kFine + 0.5) / kFine) / side, y = -1 + 2 * (row + (k / kFine + 0.5) / kFine) / side;
        const double w = 4.0 / (side * side * kFine * kFine) / std::pow(1 + x * x + y * y, 1.5);
        const DVec3 d = EnvironmentCells::direction(face, x, y);
        angle[i] += w;
        integral[i] += w * d;
        radiance[i] += w * DVec3(map->eval(Vec3(d)));
      }
      radiance[i] /= angle[i];
    }
    int shadowed = 0;
    for (size_t k = 0; k < p.size(); k += 7) {
      const Vec3 n(p.vector("normal", k));
      const Vec3 origin =
          offsetOrigin(Vec3(p.vector("position", k)) + n * (1e-3f * p.points->floats("cell")[k]), n, p.accel->reach(p.points->plane<uint32_t>("instance")[k]));
      DVec3 sum(0.0);
      for (size_t i = 0; i < terms.size(); ++i) {
        if (!(glm::dot(DVec3(n), integral[i]) > 0) || !(glm::dot(n, Vec3(middle[i])) > 0)) continue;
        Ray ray;
        ray.origin = origin;
        ray.direction = glm::normalize(Vec3(middle[i]));
        if (p.accel->occluded(ray)) ++shadowed;
        else sum += radiance[i] * glm::dot(DVec3(n), integral[i]);
      }
      EXPECT_NEAR(all[k].y, sum.y, 2e-3 * sum.y + 1e-6) << side << " " << k;
    }
    EXPECT_GT(shadowed, 50);
    // The same without wavelets from the library's own cells, to rounding: floats of the terms.
    std::vector<DVec3> mean(terms.size());
    for (const HaarTerm& t : terms) mean[t.index] = t.value;
    cells.wavelets().backward(mean);
    const size_t k = p.size() / 2;
    double got = 0;
    std::vector<HaarTerm> unit(1);
    std::vector<double> T(terms.size());
    for (uint32_t i = 0; i < terms.size(); ++i) {
      unit[0] = {i, DVec3(1.0)};
      T[i] = transfer.irradiance(unit)[k].x;
    }
    cells.wavelets().backward(T);
    for (size_t i = 0; i < T.size(); ++i) {
      const double sees = T[i] * std::sqrt(cells.wavelets().solidAngles()[i]), open = std::max(glm::dot(p.vector("normal", k), cells.integrals()[i]), 0.0);
      EXPECT_TRUE(std::fabs(sees) < 1e-5 || std::fabs(sees - open) < 1e-5) << i;  // V is 0 or 1
      got += T[i] * mean[i].y;
    }
    EXPECT_NEAR(got, all[k].y, 1e-5 * all[k].y);
  }
}

TEST(HaarTransfer, OfOneLampOverAnOpenPlaneIsItsCosine) {
  const Points p(openPlane(), 60);
  ASSERT_GT(p.size(), 3u);
  for (const int side : {16, 64}) {
    const HaarCells cells = cellsOf(side);
    const HaarTransfer transfer = p.transfer(cells);
    for (const DVec3& towards : spiral(8)) {
      const EnvironmentPtr map = mapOf(0.0, {{towards, 1.0, 5.0}}, 512);
      const std::vector<DVec3> irradiance = transfer.irradiance(lightOf(cells, *map));
      // The lamp is spread over its cells: at most a cell's width.
      const double off = 1.5 * std::numbers::pi / 2 / side + kDeg;
      for (size_t k = 0; k < p.size(); ++k) {
        const double up = p.vector("normal", k).y, cosine = up * towards.y;  // both sides have points
        ASSERT_NEAR(std::fabs(up), 1.0, 1e-6);
        EXPECT_NEAR(irradiance[k].y, 5.0 * std::max(cosine, 0.0), 5.0 * off * 0.5 + 1e-9) << side << " " << towards.y;
        if (cosine < -off) { EXPECT_NEAR(irradiance[k].y, 0.0, 1e-6); }
      }
    }
  }
}

// The sky's constant L gives pi L, of which a long wall hides (1 - cos a) / 2, where a is the angle up to its top: by cells of 2.8 degrees.
TEST(HaarTransfer, OfAConstantMapIsTheClosedForm) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; });
  m.instance(m.mesh(gobo::tests::ground(2.0f), grey));
  m.instance(m.mesh(gobo::tests::quad(Vec3(-40, -1, -2.001f), Vec3(80, 0, 0), Vec3(0, 4, 0)), grey));
  const Points p(m.finish(), 3000);
  const HaarCells cells = cellsOf(32);
  const std::vector<HaarTerm> terms = lightOf(cells, *mapOf(2.0, {}, 64));
  const HaarTransfer transfer = p.transfer(cells);
  const std::vector<DVec3> six = transfer.irradiance(std::span(terms).first(6)), all = transfer.irradiance(terms);
  int seen = 0;
  for (size_t k = 0; k < p.size(); ++k) {
    const DVec3 at = p.vector("position", k);
    if (!(p.vector("normal", k).y > 0.9) || std::fabs(at.x) > 2) continue;
    EXPECT_NEAR(six[k].y, all[k].y, 1e-5);
    const double angle = std::atan2(3.0, at.z + 2.001);
    EXPECT_NEAR(six[k].y / (2 * std::numbers::pi), 1 - 0.5 * (1 - std::cos(angle)), 0.02) << at.z;
    ++seen;
  }
  EXPECT_GT(seen, 20);
  const Points open(openPlane(), 60);
  for (const DVec3& e : open.transfer(cells).irradiance(std::span(terms).first(6))) EXPECT_NEAR(e.y, 2 * std::numbers::pi, 1e-5);
}

// On a map that nothing was chosen on: what K terms miss falls with K, and is nothing at the end.
TEST(HaarTransfer, ErrorsFallWithTheTermsThatAreKept) {
  const Points p(blocks(), 800);
  const HaarCells cells = cellsOf(32);
  const HaarTransfer transfer = p.transfer(cells);
  for (const HaarOrder order : {HaarOrder::Largest, HaarOrder::ByArea}) {
    const std::vector<HaarTerm> terms = lightOf(cells, *keptApart(), order);
    const std::vector<DVec3> truth = transfer.irradiance(terms);
    double mean = 0, before = 1e30;
    for (const DVec3& t : truth) mean += t.y / double(truth.size());
    for (const size_t kept : {6u, 24u, 96u, 384u, 1536u, 6144u}) {
      const std::vector<DVec3> some = transfer.irradiance(std::span(terms).first(kept));
      double squares = 0;
      for (size_t k = 0; k < truth.size(); ++k) squares += (some[k].y - truth[k].y) * (some[k].y - truth[k].y);
      const double error = std::sqrt(squares / double(truth.size())) / mean;
      std::printf("  %s, %zu terms: RMSE %.5f of the mean\n", order == HaarOrder::Largest ? "largest" : "by area", kept, error);
      EXPECT_LT(error, 1.02 * before) << kept;
      if (kept == 96) { EXPECT_LT(error, 0.15); }
      if (kept == 1536) { EXPECT_LT(error, 0.01); }
      before = error;
    }
    EXPECT_LT(before, 1e-6);
  }
}

TEST(HaarTransfer, DroppedTermsAreFewBytesAndLittleError) {
  const Points p(blocks(), 800);
  const HaarCells cells = cellsOf(32);
  const HaarTransfer whole = p.transfer(cells), some = p.transfer(cells, 1e-3);
  EXPECT_LT(some.bytes(), whole.bytes() / 2);
  EXPECT_EQ(some.rays(), whole.rays());
  const std::vector<HaarTerm> terms = lightOf(cells, *keptApart());
  const std::vector<DVec3> a = whole.irradiance(terms), b = some.irradiance(terms);
  double squares = 0, mean = 0;
  for (size_t k = 0; k < a.size(); ++k) {
    squares += (a[k].y - b[k].y) * (a[k].y - b[k].y);
    mean += a[k].y;
  }
  EXPECT_LT(std::sqrt(squares * double(a.size())) / mean, 0.01);
  for (const double drop : {-0.1, 1.0, std::nan("")})
    EXPECT_EQ(HaarTransfer::of(cells, *p.points, *p.accel, drop, p.arena).status().code(), Code::InvalidArgument) << drop;
}

// What is kept is at least that part of the point's norm, and all of that is.
TEST(HaarTransfer, DropsWhatIsBelowItsPartOfTheNorm) {
  const Points p(blocks(), 200);
  const HaarCells cells = cellsOf(4);
  constexpr double kDrop = 0.03;
  const HaarTransfer whole = p.transfer(cells), some = p.transfer(cells, kDrop);
  std::vector<std::vector<double>> all, kept;
  std::vector<double> squares(p.size(), 0.0);
  for (uint32_t i = 0; i < cells.wavelets().size(); ++i) {
    const std::vector<HaarTerm> unit{{i, DVec3(1.0)}};
    const std::vector<DVec3> a = whole.irradiance(unit), b = some.irradiance(unit);
    for (size_t k = 0; k < p.size(); ++k) squares[k] += a[k].x * a[k].x;
    all.emplace_back();
    kept.emplace_back();
    for (size_t k = 0; k < p.size(); ++k) {
      all.back().push_back(a[k].x);
      kept.back().push_back(b[k].x);
    }
  }
  size_t dropped = 0;
  for (size_t i = 0; i < all.size(); ++i)
    for (size_t k = 0; k < p.size(); ++k) {
      const double part = std::fabs(all[i][k]) / std::max(std::sqrt(squares[k]), 1e-30);
      if (part > kDrop * 1.0001) {
        EXPECT_EQ(kept[i][k], all[i][k]);
      } else if (part < kDrop * 0.9999) {
        EXPECT_EQ(kept[i][k], 0.0);
        dropped += all[i][k] != 0;
      }
    }
  EXPECT_GT(dropped, 1000u);
}

TEST(HaarTransfer, ChannelsAreTheirOwn) {
  const Points p(openPlane(), 60);
  const HaarCells cells = cellsOf(4);
  const std::vector<HaarTerm> terms =
      haarLight(cells, *gobo::tests::mapOf(16, 8, [](int, int) { return Vec3(2.0f, 1.0f, 0.25f); }), HaarOrder::Largest, p.arena);
  for (const DVec3& e : p.transfer(cells).irradiance(terms)) {
    EXPECT_NEAR(e.x, 2.0 * std::numbers::pi, 1e-5);
    EXPECT_NEAR(e.y, 1.0 * std::numbers::pi, 1e-5);
    EXPECT_NEAR(e.z, 0.25 * std::numbers::pi, 1e-5);
  }
}

TEST(HaarTransfer, HasTheSameBitsForAnyNumberOfThreadsAndStops) {
  const Points one(blocks(), 300, 1), two(blocks(), 300, 2);
  const HaarCells cells = cellsOf(16);
  const std::vector<HaarTerm> terms = haarLight(cells, *keptApart(), HaarOrder::Largest, one.arena), again = lightOf(cells, *keptApart());
  ASSERT_EQ(terms.size(), again.size());
  for (size_t k = 0; k < terms.size(); ++k) ASSERT_TRUE(terms[k].index == again[k].index && terms[k].value == again[k].value);
  const std::vector<DVec3> a = one.transfer(cells).irradiance(terms), b = two.transfer(cells).irradiance(terms);
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(DVec3)), 0);
  StopSource source;
  source.stop(StopReason::Cancelled);
  EXPECT_TRUE(haarLight(cells, *keptApart(), HaarOrder::Largest, two.arena, source.token()).empty());
  EXPECT_EQ(HaarTransfer::of(cells, *two.points, *two.accel, 0, two.arena, source.token()).status().code(), Code::Cancelled);
}

}  // namespace
}  // namespace gobo::transfer::published::haar_transfer_test
