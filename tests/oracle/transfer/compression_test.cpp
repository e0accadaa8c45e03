// SPDX-License-Identifier: Apache-2.0
// Tables of transfer in halves and in clusters of principal directions: what rounding and left-out directions cost is within what is stated.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/compression/clustered_table.h"
#include "techniques/transfer/compression/half_float.h"
#include "techniques/transfer/compression/symmetric_eigen.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"

namespace gobo::transfer::compression_test {
namespace {

const TaskArena& arena() {
  static const TaskArena two(2);
  return two;
}
std::vector<float> noise(size_t rows, size_t width, uint32_t seed, float unit = 1.0f) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<float> out(rows * width);
  for (float& v : out) v = unit * normal(random);
  return out;
}
/// Direct transfer of a box and a ball on a floor.
const std::vector<float>& realTable() {
  static const std::vector<float> table = [] {
    tests::SceneMaker m;
    const int grey = m.material(Vec3(0.5f));
    m.instance(m.mesh(tests::ground(3.0f), grey));
    m.instance(m.mesh(tests::box(Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), grey));
    m.instance(m.mesh(tests::sphere(Vec3(0.8f, 0.6f, 0.5f), 0.6f, 24, true), grey));
    const ScenePtr scene = m.finish();
    tests::NodeRunner run(*scene, arena());
    const std::vector<int> none;
    TransferSettings s;
    s.points = 3000;
    s.bands = 5;
    s.size = uint32_t(receiverMesh(SceneView(*scene, ReceiverMesh::kFacets, none), s.points)->size());
    const TermPtr points = run(makeTransferPointsNode(s), {});
    TermPtr direct;
    for (uint32_t b = 0; b < 4; ++b) direct = run(makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct});
    const auto values = direct->floats("transfer");
    return std::vector<float>(values.begin(), values.end());
  }();
  return table;
}
ClusteredTable clustered(const std::vector<float>& table, size_t width, const ClusterSettings& settings) {
  auto made = clusteredTable(table, width, settings, arena());
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return made.ok() ? std::move(*made) : ClusteredTable{};
}
struct Missed {
  std::vector<double> worst, squared;
  double relative = 0;  // of the table's norm
};
template <typename Table>
Missed missedBy(const Table& t, const std::vector<float>& table, size_t width, size_t clusters) {
  Missed out{std::vector<double>(clusters, 0.0), std::vector<double>(clusters, 0.0)};
  std::vector<float> back(width);
  double all = 0, sum = 0;
  for (size_t i = 0; i < t.rows(); ++i) {
    size_t c = 0;
    if constexpr (requires { t.cluster[i]; }) c = t.cluster[i];
    t.row(i, back);
    double d = 0;
    for (size_t k = 0; k < width; ++k) {
      EXPECT_TRUE(std::isfinite(back[k]));
      d += std::pow(double(back[k]) - double(table[i * width + k]), 2);
      all += std::pow(double(table[i * width + k]), 2);
    }
    out.worst[c] = std::max(out.worst[c], std::sqrt(d));
    out.squared[c] += d;
    sum += d;
  }
  out.relative = all > 0 ? std::sqrt(sum / all) : std::sqrt(sum);
  return out;
}

TEST(HalfFloat, EveryHalfComesBackAndFloatsGoToTheNearest) {
  for (uint32_t h = 0; h < 65536; ++h) {
    const float f = floatOf(uint16_t(h));
    if (std::isnan(f)) {
      EXPECT_TRUE(std::isnan(floatOf(halfOf(f))));
    } else {
      EXPECT_EQ(halfOf(f), uint16_t(h)) << f;
    }
  }
  EXPECT_EQ(floatOf(0x3c00), 1.0f);
  EXPECT_EQ(floatOf(0x7bff), kLargestHalf);
  EXPECT_EQ(floatOf(0x0001), 0x1p-24f);
  EXPECT_EQ(halfOf(65519.0f), 0x7bff);
  EXPECT_EQ(halfOf(65520.0f), 0x7c00);
  // Between two neighbours: below the middle down, above it up, in the middle to the even one.
  for (uint32_t h = 0; h < 0x7bff; ++h) {
    const float a = floatOf(uint16_t(h)), b = floatOf(uint16_t(h + 1)), middle = 0.5f * (a + b);
    EXPECT_EQ(halfOf(std::nextafter(middle, a)), h);
    EXPECT_EQ(halfOf(std::nextafter(middle, b)), h + 1);
    EXPECT_EQ(halfOf(middle), h + (h & 1));
    EXPECT_EQ(halfOf(-middle), 0x8000u + h + (h & 1));
  }
}

TEST(SymmetricEigen, VectorsAreOrthonormalAndMakeTheMatrix) {
  for (const size_t n : {size_t(1), size_t(2), size_t(7), size_t(40)}) {
    const std::vector<float> a = noise(n, n, uint32_t(n));
    std::vector<double> m(n * n, 0.0);
    for (size_t i = 0; i < n; ++i)
      for (size_t j = 0; j < n; ++j)
        for (size_t k = 0; k + (n > 10 ? 30 : 0) < n; ++k) m[i * n + j] += double(a[i * n + k]) * double(a[j * n + k]);  // 40: of rank 10
    const SymmetricEigen eigen = symmetricEigen(m, n);
    for (size_t i = 0; i < n; ++i) {
      if (i > 0) { EXPECT_LE(eigen.values[i], eigen.values[i - 1]); }
      for (size_t j = 0; j < n; ++j) {
        double product = 0, made = 0;
        for (size_t k = 0; k < n; ++k) {
          product += eigen.vectors[i * n + k] * eigen.vectors[j * n + k];
          made += eigen.values[k] * eigen.vectors[k * n + i] * eigen.vectors[k * n + j];
        }
        EXPECT_NEAR(product, i == j ? 1.0 : 0.0, 1e-13);
        EXPECT_NEAR(made, m[i * n + j], 1e-12 * double(n));
      }
    }
    if (n == 40) { EXPECT_LT(std::fabs(eigen.values[10]), 1e-12); }
  }
  const SymmetricEigen known = symmetricEigen({2, 1, 1, 2}, 2);
  EXPECT_NEAR(known.values[0], 3, 1e-15);
  EXPECT_NEAR(known.values[1], 1, 1e-15);
}

TEST(HalfTable, RoundsEachNumberAndSaysHowFar) {
  for (const float unit : {1.0f, 1e-20f, 1e20f}) {
    const std::vector<float> table = noise(200, 9, 4, unit);
    const auto half = halfTable(table, 9, arena());
    ASSERT_TRUE(half.ok());
    EXPECT_EQ(half->bytes(), 2 * table.size());
    const Missed missed = missedBy(*half, table, 9, 1);
    EXPECT_EQ(half->bound, missed.worst[0]);
    EXPECT_LT(missed.relative, 0x1p-11);
    EXPECT_GT(missed.relative, 0x1p-14);
  }
}

TEST(ClusteredTable, AllDirectionsKeepARowButForRounding) {
  const std::vector<float> table = noise(300, 12, 1);
  for (const size_t clusters : {1u, 5u}) {
    const ClusteredTable t = clustered(table, 12, {clusters, 12});
    EXPECT_LT(missedBy(t, table, 12, t.clusters()).relative, 5e-4);
    for (const double d : t.discarded) EXPECT_EQ(d, 0.0);
  }
  // Rows that lie in three planes of two dimensions: two directions are enough for three clusters.
  const std::vector<float> base = noise(9, 12, 2), along = noise(600, 2, 3);
  std::vector<float> planes;
  for (size_t i = 0; i < 600; ++i)
    for (size_t d = 0; d < 12; ++d)
      planes.push_back(20 * base[(i % 3) * 12 + d] + along[2 * i] * base[(3 + i % 3) * 12 + d] + along[2 * i + 1] * base[(6 + i % 3) * 12 + d]);
  const ClusteredTable t = clustered(planes, 12, {3, 2});
  ASSERT_EQ(t.clusters(), 3u);
  const Missed missed = missedBy(t, planes, 12, 3);
  EXPECT_LT(missed.relative, 1e-4);
  for (size_t i = 0; i < 600; ++i) EXPECT_EQ(t.cluster[i], t.cluster[i % 3]);
  const ClusteredTable one = clustered(planes, 12, {3, 1});
  EXPECT_GT(missedBy(one, planes, 12, 3).relative, 1e-2);
}

// The error is that of the bound, number for number, and the left-out eigenvalues tell it before rounding.
TEST(ClusteredTable, MissesWhatItStates) {
  const std::vector<float> random = noise(2000, 25, 5);
  for (const std::vector<float>* table : {&random, &realTable()})
    for (const auto& [clusters, kept] : {std::pair<size_t, size_t>(1, 4), {16, 0}, {16, 6}, {64, 10}}) {
      const ClusteredTable t = clustered(*table, 25, {clusters, kept});
      const Missed missed = missedBy(t, *table, 25, t.clusters());
      double stated = 0, found = 0;
      for (size_t c = 0; c < t.clusters(); ++c) {
        EXPECT_LE(missed.worst[c], t.bound[c] * (1 + 1e-12));  // the same sums, compiled twice
        EXPECT_NEAR(missed.squared[c], t.squared[c], 1e-12 * missed.squared[c]);
        stated += t.discarded[c];
        found += missed.squared[c];
      }
      EXPECT_NEAR(std::sqrt(found / stated), 1.0, 0.01) << t.clusters() << " clusters, " << kept;
      EXPECT_EQ(t.bytes(), t.rows() * (2 * kept + (t.clusters() > 1 ? 1 : 0)) + 2 * t.clusters() * kept * 25 + 4 * t.clusters() * 26);
      // Light under a map is off by no more than its norm times the bound.
      const std::vector<float> map = noise(1, 25, 6);
      double norm = 0;
      for (const float m : map) norm += double(m) * double(m);
      std::vector<float> back(25);
      for (size_t i = 0; i < t.rows(); i += 7) {
        t.row(i, back);
        double off = 0;
        for (size_t k = 0; k < 25; ++k) off += (double(back[k]) - double((*table)[i * 25 + k])) * double(map[k]);
        EXPECT_LE(std::fabs(off), std::sqrt(norm) * t.bound[t.cluster[i]] * (1 + 1e-12));
      }
    }
}

TEST(ClusteredTable, MoreOfEitherMissesLess) {
  const std::vector<float>& table = realTable();
  const auto relative = [&](const ClusterSettings& s) {
    const ClusteredTable t = clustered(table, 25, s);
    return missedBy(t, table, 25, t.clusters()).relative;
  };
  double last = 1;
  for (const size_t kept : {0u, 2u, 4u, 8u, 16u, 25u}) {
    const double now = relative({16, kept});
    EXPECT_LT(now, last) << kept;
    last = now;
  }
  EXPECT_LT(last, 5e-4);
  EXPECT_LT(relative({64, 4}), 0.8 * relative({4, 4}));
  EXPECT_LT(relative({16, 4, 12, 6}), 0.95 * relative({16, 4, 12, 0}));  // exchanges are worth their time
}

TEST(ClusteredTable, IsOfAnyUnit) {
  const std::vector<float>& table = realTable();
  const double one = missedBy(clustered(table, 25, {16, 6}), table, 25, 16).relative;
  for (const float unit : {0x1p-70f, 0x1p80f}) {
    std::vector<float> scaled = table;
    for (float& v : scaled) v *= unit;
    const ClusteredTable t = clustered(scaled, 25, {16, 6});
    EXPECT_NEAR(missedBy(t, scaled, 25, t.clusters()).relative, one, 1e-3 * one) << unit;
  }
}

TEST(ClusteredTable, OfNothingOfOneAndOfEquals) {
  const ClusteredTable none = clustered({}, 25, {});
  EXPECT_EQ(none.rows(), 0u);
  EXPECT_EQ(none.bytes(), 0u);
  const auto noHalf = halfTable({}, 25, arena());
  ASSERT_TRUE(noHalf.ok());
  EXPECT_EQ(noHalf->rows(), 0u);
  const std::vector<float> single = noise(1, 25, 7);
  std::vector<float> equal;
  for (int i = 0; i < 700; ++i) equal.insert(equal.end(), single.begin(), single.end());
  for (const std::vector<float>& table : {single, equal}) {
    const ClusteredTable t = clustered(table, 25, {8, 3});
    EXPECT_EQ(t.clusters(), 1u);
    EXPECT_EQ(t.bound[0], 0.0);
    EXPECT_EQ(missedBy(t, table, 25, 1).relative, 0.0);
  }
  const std::vector<float> zeros(25 * 40, 0.0f);
  EXPECT_EQ(missedBy(clustered(zeros, 25, {8, 3}), zeros, 25, 1).relative, 0.0);
  const auto zeroHalf = halfTable(zeros, 25, arena());
  ASSERT_TRUE(zeroHalf.ok());
  EXPECT_EQ(zeroHalf->bound, 0.0);
}

TEST(ClusteredTable, RefusesWhatIsNoTable) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(), 2e30f}) {
    std::vector<float> table = noise(10, 5, 8);
    table[33] = bad;
    for (const Status& s : {clusteredTable(table, 5, {}, arena()).status(), halfTable(table, 5, arena()).status()}) {
      EXPECT_EQ(s.code(), Code::InvalidArgument);
      EXPECT_NE(s.toString().find("number 3 of row 6"), std::string::npos) << s.toString();
    }
  }
  const std::vector<float> table = noise(10, 5, 8);
  EXPECT_EQ(clusteredTable(table, 7, {}, arena()).status().code(), Code::InvalidArgument);
  EXPECT_EQ(clusteredTable(table, 0, {}, arena()).status().code(), Code::InvalidArgument);
  EXPECT_EQ(clusteredTable(table, 5, {0, 3}, arena()).status().code(), Code::InvalidArgument);
  EXPECT_EQ(clusteredTable(table, 5, {65537, 3}, arena()).status().code(), Code::InvalidArgument);
}

TEST(ClusteredTable, HasTheSameBitsForAnyNumberOfThreadsAndStops) {
  const std::vector<float>& table = realTable();
  const ClusterSettings settings{24, 5};
  const auto one = clusteredTable(table, 25, settings, TaskArena(1)), two = clusteredTable(table, 25, settings, TaskArena(2));
  ASSERT_TRUE(one.ok() && two.ok());
  EXPECT_EQ(one->cluster, two->cluster);
  EXPECT_EQ(one->weights, two->weights);
  EXPECT_EQ(one->mean, two->mean);
  EXPECT_EQ(one->directions, two->directions);
  EXPECT_EQ(one->bound, two->bound);
  EXPECT_EQ(one->squared, two->squared);
  StopSource source;
  source.stop(StopReason::Cancelled);
  const auto stopped = clusteredTable(table, 25, settings, arena(), source.token());
  ASSERT_TRUE(stopped.ok());
  EXPECT_EQ(stopped->width, 0u);
}

}  // namespace
}  // namespace gobo::transfer::compression_test
