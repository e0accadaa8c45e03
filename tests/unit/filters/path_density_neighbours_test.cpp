// SPDX-License-Identifier: Apache-2.0
// k nearest neighbours of path samples: both searches against all distances, in clouds of many kinds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filters/path_density/neighbour_search.h"
#include "filters/path_density/product_tree.h"
#include "path_density_clouds.h"
#include "support/thorough.h"

namespace gobo {
namespace path_density_neighbours_test {

using namespace pathdensity;
using pathdensitytest::unit;

/// All others in double, nearest first.
std::vector<double> allDistances(const MetricPoints& p, size_t i) {
  std::vector<double> d;
  for (size_t j = 0; j < p.size(); ++j) {
    if (j == i) continue;
    const auto apart = [&](const std::vector<float>& v) { return double(v[j]) - double(v[i]); };
    d.push_back(std::hypot(apart(p.x), apart(p.y)) + std::sqrt(apart(p.l) * apart(p.l) + apart(p.a) * apart(p.a) + apart(p.b) * apart(p.b)));
  }
  std::sort(d.begin(), d.end());
  return d;
}
/// With the searches' own arithmetic, so that ties are ties.
std::vector<Neighbour> allNeighbours(const MetricPoints& p, size_t i, int k) {
  std::vector<float> d(p.size());
  distancesTo(pointAt(p, i), p, 0, p.size(), d.data());
  std::vector<Neighbour> all;
  for (size_t j = 0; j < p.size(); ++j)
    if (j != i) all.push_back({d[j], uint32_t(j)});
  std::sort(all.begin(), all.end());
  all.resize(std::min(all.size(), size_t(k)));
  return all;
}

struct Cloud {
  const char* name;
  int width, height, samples;
  /// Place in [0, 1)^2 and colour of sample i.
  std::function<void(uint64_t seed, uint64_t i, double& u, double& v, Vec3& light)> make;
};
void anywhere(uint64_t seed, uint64_t i, double& u, double& v) {
  u = unit(seed, i, 0);
  v = unit(seed, i, 1);
}
std::vector<Cloud> clouds() {
  return {
      {"even, any colour", 17, 11, 900,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(float(unit(s, i, 2)), float(unit(s, i, 3)), float(unit(s, i, 4)));
       }},
      {"one colour, few samples", 31, 7, 160,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(0.5f);
       }},
      {"fireflies", 13, 13, 700,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(float(0.3 + 0.05 * unit(s, i, 2))) * (unit(s, i, 3) < 0.05 ? float(std::pow(10.0, 5 * unit(s, i, 4))) : 1.0f);
       }},
      {"duplicates", 9, 14, 600,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i / 9, u, v);
         c = Vec3(float(unit(s, i / 9, 2)));
       }},
      {"a lattice: ties", 12, 12, 576,
       [](uint64_t, uint64_t i, double& u, double& v, Vec3& c) {
         u = (double(i % 24) + 0.5) / 24;
         v = (double(i / 24) + 0.5) / 24;
         c = Vec3(i % 5 == 0 ? 0.8f : 0.2f);
       }},
      {"clusters on the film", 40, 25, 800,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i % 4, u, v);
         u = std::min(0.999, u * 0.9 + 0.03 * unit(s, i, 5));
         v = std::min(0.999, v * 0.9 + 0.03 * unit(s, i, 6));
         c = Vec3(float(unit(s, i, 2)), 0.2f, float(i % 3));
       }},
      {"one pixel", 1, 1, 200,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(float(unit(s, i, 2)), -float(unit(s, i, 3)), 0.0f);
       }},
      {"one column, very many", 1, 37, 3000,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(float(unit(s, i, 2) * unit(s, i, 3)));
       }},
      {"two samples", 5, 5, 2,
       [](uint64_t s, uint64_t i, double& u, double& v, Vec3& c) {
         anywhere(s, i, u, v);
         c = Vec3(float(i));
       }},
  };
}

struct Made {
  PathSamples samples{1, 1};
  SampleBins bins;
  MetricPoints points;
};
Made made(const Cloud& cloud, uint64_t seed, const Metric& metric, const TaskArena& arena) {
  Made m;
  m.samples = PathSamples(cloud.width, cloud.height);
  for (int i = 0; i < cloud.samples; ++i) {
    double u = 0, v = 0;
    Vec3 light(0.0f);
    cloud.make(seed, uint64_t(i), u, v, light);
    const float x = float(u * cloud.width), y = float(v * cloud.height);
    EXPECT_TRUE(m.samples.add(std::min(int(x), cloud.width - 1), std::min(int(y), cloud.height - 1), Vec2(x, y), light, Vec3(0.0f)).ok());
  }
  m.bins = binSamples(m.samples.view());
  EXPECT_TRUE(makePoints(m.samples.view(), m.bins, metric, LightTerm::All, m.points, arena, {}));
  return m;
}

template <class F>
void forEachCloud(const TaskArena& arena, F&& f) {
  for (const Cloud& cloud : clouds())
    for (const auto& [seed, filmScale] : {std::pair{3, 1.0f}, {71, 0.37f}, {2024, 1.0f}}) {
      SCOPED_TRACE(std::string(cloud.name) + ", seed " + std::to_string(seed) + ", film scale " + std::to_string(filmScale));
      Metric metric;
      metric.filmScale = filmScale;
      f(made(cloud, uint64_t(seed), metric, arena), metric);
    }
}

TEST(PathDensityNeighbours, BinsHoldEverySampleOnceInItsPixel) {
  const TaskArena arena(2);
  forEachCloud(arena, [](const Made& m, const Metric&) {
    std::vector<int> times(m.samples.size(), 0);
    const auto film = m.samples.view().film;
    for (int y = 0; y < m.bins.height; ++y)
      for (int x = 0; x < m.bins.width; ++x)
        for (size_t i = m.bins.pixelBegin(x, y); i < m.bins.pixelEnd(x, y); ++i) {
          const size_t s = m.bins.order[i];
          ++times[s];
          EXPECT_EQ(int(film[2 * s]), x);
          EXPECT_EQ(int(film[2 * s + 1]), y);
          if (i > m.bins.pixelBegin(x, y)) { EXPECT_LT(m.bins.order[i - 1], s); }
        }
    for (const int t : times) EXPECT_EQ(t, 1);
  });
}

TEST(PathDensityNeighbours, TheTiledSearchFindsWhatAllDistancesSay) {
  const TaskArena arena(2);
  forEachCloud(arena, [](const Made& m, const Metric& metric) {
    const NeighbourSearch search(m.bins, m.points, metric.filmScale);
    NeighbourSearch::Scratch scratch;
    std::vector<Neighbour> found;
    for (size_t i = 0; i < m.points.size(); i += 7)
      for (const int k : {1, 5, 50, 5000}) {
        search.nearest(i, k, found, scratch);
        ASSERT_EQ(found, allNeighbours(m.points, i, k)) << "sample " << i << ", k " << k;
      }
  });
}

TEST(PathDensityNeighbours, MeanDistancesAreThoseOfAllDistances) {
  const TaskArena arena(2);
  forEachCloud(arena, [](const Made& m, const Metric& metric) {
    const NeighbourSearch search(m.bins, m.points, metric.filmScale);
    NeighbourSearch::Scratch scratch;
    for (size_t i = 0; i < m.points.size(); i += 3) {
      const auto all = allDistances(m.points, i);
      for (const int k : {1, 2, 10, 50, 200, 5000}) {
        const size_t n = std::min(all.size(), size_t(k));
        double mean = 0;
        for (size_t j = 0; j < n; ++j) mean += all[j] / double(n);
        ASSERT_NEAR(search.meanDistance(i, k, {}, scratch), mean, 1e-5 * (1 + mean)) << "sample " << i << ", k " << k;
        // With bounds: the same between them, the right side of them elsewhere.
        for (const OutcomeBounds b : {OutcomeBounds{2.0f, 3.0f}, OutcomeBounds{0.5f, 0.7f}, OutcomeBounds{-1.0f, 6.0f}}) {
          const double said = double(search.meanDistance(i, k, b, scratch)), slack = 1e-5 * (1 + mean);
          if (mean < double(b.accept) - slack) ASSERT_LE(said, double(b.accept)) << "sample " << i << ", k " << k << ", mean " << mean;
          else if (mean > double(b.reject) + slack) ASSERT_GE(said, double(b.reject)) << "sample " << i << ", k " << k << ", mean " << mean;
          else ASSERT_NEAR(said, mean, 2 * slack) << "sample " << i << ", k " << k;
        }
      }
    }
  });
}

TEST(PathDensityNeighbours, TheTreeWithoutEpsilonFindsTheSameOnes) {
  const TaskArena arena(2);
  forEachCloud(arena, [](const Made& m, const Metric&) {
    const ProductTree tree(m.points);
    std::vector<Neighbour> found;
    for (size_t i = 0; i < m.points.size(); i += 7)
      for (const int k : {1, 5, 50, 5000}) {
        tree.nearest(i, k, 0.0f, found);
        ASSERT_EQ(found, allNeighbours(m.points, i, k)) << "sample " << i << ", k " << k;
      }
  });
}

TEST(PathDensityNeighbours, TheTreeKeepsItsGuaranteeForEveryQueryAndLooksAtLess) {
  const TaskArena arena(2);
  size_t looked[3] = {};
  double more = 0;
  forEachCloud(arena, [&](const Made& m, const Metric&) {
    const ProductTree tree(m.points);
    std::vector<Neighbour> found;
    const float epsilons[3] = {0.0f, 0.25f, 1.0f};
    for (size_t i = 0; i < m.points.size(); i += testing::thoroughOr<size_t>(1, 3)) {
      const auto all = allDistances(m.points, i);
      for (int e = 0; e < 3; ++e) {
        looked[e] += tree.nearest(i, 20, epsilons[e], found);
        ASSERT_EQ(found.size(), std::min(all.size(), size_t(20)));
        for (size_t j = 0; j < found.size(); ++j) {
          ASSERT_LE(double(found[j].distance), all[j] * (1 + double(epsilons[e])) * (1 + 1e-5) + 1e-6) << "sample " << i << ", neighbour " << j;
          ASSERT_GE(double(found[j].distance), all[j] * (1 - 1e-5) - 1e-6);  // never nearer: densities come out too small, not too large
          more += double(found[j].distance) - all[j];
        }
      }
    }
  });
  EXPECT_LT(looked[1], looked[0]);
  EXPECT_LT(looked[2], looked[1]);
  EXPECT_GT(more, 0.0);
}

TEST(PathDensityNeighbours, LabOfLightIsThatOfTheStandardAndGoesOnAboveWhite) {
  // Greys have no hue; L* of luminances 1, 10, 100, 1000.
  const double lightness[][2] = {{1, 100}, {10, 233.91}, {100, 522.43}, {1000, 1144}, {0.18, 49.496}, {0.001, 0.9033}, {0, 0}, {-1, -100}};
  for (const auto& [y, l] : lightness) {
    float r = float(y), g = r, b = r;
    labOf(&r, &g, &b, 1);
    EXPECT_NEAR(double(r), l, 0.01 + 2e-6 * std::abs(l)) << y;
    EXPECT_NEAR(double(g), 0.0, 0.02 + 2e-5 * std::abs(l)) << y;
    EXPECT_NEAR(double(b), 0.0, 0.02 + 2e-5 * std::abs(l)) << y;
  }
  // The primaries of sRGB (Lindbloom's calculator, D65).
  const double primaries[3][3] = {{53.24, 80.09, 67.20}, {87.73, -86.18, 83.18}, {32.30, 79.19, -107.86}};
  for (int k = 0; k < 3; ++k) {
    float c[3] = {};
    c[k] = 1;
    labOf(&c[0], &c[1], &c[2], 1);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(double(c[i]), primaries[k][i], 0.05) << k << i;
  }
}

}  // namespace path_density_neighbours_test
}  // namespace gobo
