// SPDX-License-Identifier: Apache-2.0
// Where and how large the lights of the published decomposition are: tops between vertices against lobes of known centre, radii against closed forms.
#include "techniques/transfer/published/peaks.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

#include "oracle/transfer/published_maps.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/published/windows.h"

namespace gobo::transfer::published::peaks_test {
namespace {

using namespace tests;

struct Errors {
  double rms = 0, most = 0;
};
/// In degrees, of tops of Gaussian lobes about random places (seed 2007).
Errors topErrors(int level, double sigma, Refine refine) {
  const Icosphere& sphere = icosphere(level);
  std::mt19937_64 random(2007);
  std::vector<double> value(sphere.vertices.size(), 0.0);
  Errors out;
  constexpr int kLobes = 1500;
  for (int i = 0; i < kLobes; ++i) {
    const double y = 2 * double(random() >> 11) * 0x1p-53 - 1, phi = 2 * std::numbers::pi * double(random() >> 11) * 0x1p-53;
    const DVec3 centre(std::sqrt(1 - y * y) * std::cos(phi), y, std::sqrt(1 - y * y) * std::sin(phi));
    int top = 0;
    for (size_t v = 1; v < value.size(); ++v)
      if (glm::dot(sphere.vertices[v], centre) > glm::dot(sphere.vertices[size_t(top)], centre)) top = int(v);
    const auto lobe = [&](int v) { return std::exp((glm::dot(sphere.vertices[size_t(v)], centre) - 1) / (sigma * kDeg * sigma * kDeg)); };
    value[size_t(top)] = lobe(top);
    for (const int k : sphere.neighbours[size_t(top)])
      if (k >= 0) value[size_t(k)] = lobe(k);
    const double error = angleBetween(summitOf(value, sphere, top, refine).direction, centre);
    out.rms += error * error / kLobes;
    out.most = std::max(out.most, error);
  }
  out.rms = std::sqrt(out.rms);
  return out;
}

// The table of digest B10: level, deviation of the lobe, root mean square and largest error of vertices, quadrics, and quadrics of logarithms.
TEST(PublishedRefinement, ErrorsAreThoseOfTheTable) {
  struct Row {
    int level;
    double sigma;
    Errors vertex, quadric, logarithm;
  };
  for (const Row& row : {Row{4, 4, {1.64, 2.57}, {0.188, 0.315}, {0.0027, 0.0042}}, Row{5, 2, {0.83, 1.31}, {0.094, 0.160}, {0.0003, 0.0005}},
                         Row{5, 4, {0.82, 1.30}, {0.023, 0.043}, {0.0003, 0.0005}}, Row{3, 4, {3.22, 5.15}, {1.40, 2.16}, {0.022, 0.033}}}) {
    const Errors vertex = topErrors(row.level, row.sigma, Refine::None), quadric = topErrors(row.level, row.sigma, Refine::Quadric),
                 logarithm = topErrors(row.level, row.sigma, Refine::LogQuadric);
    EXPECT_NEAR(vertex.rms / row.vertex.rms, 1, 0.05) << row.level << " " << row.sigma;
    EXPECT_NEAR(vertex.most / row.vertex.most, 1, 0.1) << row.level << " " << row.sigma;
    EXPECT_NEAR(quadric.rms / row.quadric.rms, 1, 0.2) << row.level << " " << row.sigma;
    EXPECT_NEAR(quadric.most / row.quadric.most, 1, 0.3) << row.level << " " << row.sigma;
    EXPECT_LT(logarithm.rms, 1.2 * row.logarithm.rms) << row.level << " " << row.sigma;  // last digits of the table
    EXPECT_LT(logarithm.most, 1.5 * row.logarithm.most) << row.level << " " << row.sigma;
  }
}

TEST(PublishedRefinement, WithoutATopItIsTheVertex) {
  const Icosphere& sphere = icosphere(3);
  const int v = 77;
  const auto around = [&](double own, double others) {
    std::vector<double> value(sphere.vertices.size(), others);
    value[size_t(v)] = own;
    return value;
  };
  for (const Refine refine : {Refine::None, Refine::Quadric, Refine::LogQuadric}) {
    for (const auto& value : {around(1, 1), around(1, 2), around(0, 0)}) {  // a plateau, a dip, black
      const Summit s = summitOf(value, sphere, v, refine);
      EXPECT_EQ(s.direction, sphere.vertices[v]);
      EXPECT_EQ(s.steepness, 0.0);
    }
    std::vector<double> ridge(sphere.vertices.size());  // rises on beyond the neighbours
    for (size_t k = 0; k < ridge.size(); ++k) ridge[k] = 3 + sphere.vertices[k].x - 0.01 * sphere.vertices[k].y * sphere.vertices[k].y;
    EXPECT_EQ(summitOf(ridge, sphere, v, refine).direction, sphere.vertices[v]);
    const Summit spike = summitOf(around(5, 0), sphere, v, refine);  // logarithms of 0: the plain quadric
    EXPECT_LT(angleBetween(spike.direction, sphere.vertices[v]), 1.0);
    EXPECT_EQ(spike.steepness > 0, refine != Refine::None);
  }
}

// Steepness of a lobe exp((cosine - 1) / s^2) is 1 / s^2 wherever its top lies between vertices.
TEST(PublishedRefinement, SteepnessIsThatOfTheLobe) {
  const Icosphere& sphere = icosphere(5);
  for (const DVec3& centre : spiral(40)) {
    std::vector<double> value;
    const double s = 5 * kDeg;
    for (const DVec3& v : sphere.vertices) value.push_back(7 * std::exp((glm::dot(v, centre) - 1) / (s * s)));
    const int top = int(std::max_element(value.begin(), value.end()) - value.begin());
    EXPECT_NEAR(summitOf(value, sphere, top, Refine::LogQuadric).steepness * s * s, 1, 2e-3);
    EXPECT_NEAR(summitOf(value, sphere, top, Refine::Quadric).steepness * s * s, 1, 0.15);
  }
}

TEST(PublishedPeaks, SmoothingKeepsConstantsAndMakesAPointAGaussian) {
  const TaskArena arena(2);
  for (const int width : {1, 512, 2560}) {  // cut up, texel by texel, and too large for a white map beside it
    Image image(width, std::max(width / 2, 1), 3);
    for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = i % 3 == 0 ? 2.0f : i % 3 == 1 ? 3.0f : 0.5f;
    const EnvironmentPtr map = makeEnvironment("even", std::move(image));
    const EnvironmentCells even(*map);
    const SmoothedRadiance smooth(even, map->width, map->height, arena);
    for (const DVec3& d : spiral(50)) EXPECT_LT(glm::length(smooth.at(d) - DVec3(2.0, 3.0, 0.5)), 1e-9) << width;
  }
  for (const DVec3& d : {glm::normalize(DVec3(1, 1, 1)), DVec3(0, 1, 0), glm::normalize(DVec3(1, 0.02, -1)), glm::normalize(DVec3(0.3, -0.5, 0.7))}) {
    const EnvironmentCells cells(*mapOf(0.0, {{d, 0.4, 10.0}}));
    const SmoothedRadiance sun(cells, 1024, 512, arena);
    const double top = sun.at(d).x;
    EXPECT_NEAR(top * 2 * std::numbers::pi * (1 - std::cos(kernelRadius())) / 10, 1, 0.01);
    const DVec3 side = glm::normalize(glm::cross(d, DVec3(0.2, 0.3, 0.9)));
    for (const double off : {2.0, 4.0, 6.0})
      EXPECT_NEAR(sun.at(std::cos(off * kDeg) * d + std::sin(off * kDeg) * side).x / top, std::exp((std::cos(off * kDeg) - 1) / (kSmooth * kSmooth)), 0.03);
    EXPECT_EQ(sun.at(std::cos(12 * kDeg) * d + std::sin(12 * kDeg) * side).x, 0.0);
  }
}

// Of a map that is within the harmonics what is left over is what the Gaussian takes off them: its own coefficients, integrated here.
TEST(PublishedPeaks, TheDifferenceOfHarmonicsIsTheGaussiansAlone) {
  const EnvironmentPtr map = mapOf([](const DVec3& d) { return 2 + 0.5 * d.y + 0.3 * d.x * d.z; });
  const TaskArena arena(2);
  const std::vector<double> full = environmentHarmonics(*map, 3, arena);
  const EnvironmentCells cells(*map);
  std::vector<double> gaussian(3, 0.0);
  for (int i = 0; i < 20000; ++i) {
    const double t = 1 - (1 - std::cos(kSupport)) * (i + 0.5) / 20000, w = std::exp((t - 1) / (kSmooth * kSmooth));
    for (unsigned l = 0; l < 3; ++l) gaussian[l] += w * std::legendre(l, t);
  }
  for (const double g0 = gaussian[0]; double& g : gaussian) g /= g0;
  const std::vector<DVec3> smoothed = SmoothedRadiance(cells, 1024, 512, arena).atVertices(arena),
                           expected = radianceAtVertices(windowed(full, gaussian), 3, kSmoothLevel), whole = radianceAtVertices(full, 3, kSmoothLevel);
  double most = 0;
  for (size_t v = 0; v < smoothed.size(); ++v) {
    EXPECT_NEAR(smoothed[v].x, expected[v].x, 4e-4);
    most = std::max(most, std::fabs(expected[v].x - whole[v].x));
  }
  EXPECT_GT(most, 1.5e-3);  // or the bound would say nothing
}

TEST(PublishedPeaks, VertexAnglesCoverTheSphere) {
  for (const int level : {0, 3, 5}) {
    const std::vector<double> angles = vertexAngles(icosphere(level));
    EXPECT_NEAR(std::accumulate(angles.begin(), angles.end(), 0.0), 4 * std::numbers::pi, 1e-9);
    for (const double a : angles) EXPECT_NEAR(a * double(angles.size()) / (4 * std::numbers::pi), 1, 0.35);
  }
}

/// Lobes of deviation `sigma` degrees and some height on a sky of 0.2, which is all that the harmonics have.
std::vector<Candidate> candidatesOfLobes(const std::vector<std::pair<DVec3, double>>& lobes, double sigma, const PeakSettings& settings) {
  std::vector<DVec3> smoothed;
  for (const DVec3& v : icosphere(kSmoothLevel).vertices) {
    double sum = 0.2;
    for (const auto& [centre, height] : lobes) sum += height * std::exp((glm::dot(v, centre) - 1) / (sigma * kDeg * sigma * kDeg));
    smoothed.emplace_back(sum);
  }
  return candidatesOf(smoothed, std::vector<DVec3>(smoothed.size(), DVec3(0.2)), settings);
}

TEST(PublishedPeaks, RadiiAreThoseOfClosedForms) {
  const DVec3 atVertex = icosphere(kSmoothLevel).vertices[4321];
  for (const double sigma : {3.0, 5.0, 8.0}) {
    const double s = sigma * kDeg;
    const auto radius = [&](Radius how) {
      const std::vector<Candidate> found = candidatesOfLobes({{atVertex, 4.0}}, sigma, {how, 0, Refine::LogQuadric});
      EXPECT_EQ(found.size(), 1u);
      EXPECT_EQ(found[0].vertex, 4321);
      EXPECT_NEAR(found[0].difference, 4.0, 1e-9);
      return found[0].radius / kDeg;
    };
    EXPECT_NEAR(radius(Radius::Fixed), kernelRadius() / kDeg, 1e-12);
    // The Gaussian holds 2 pi s^2 of its height, a disk 2 pi (1 - cos R).
    EXPECT_NEAR(radius(Radius::Basin) / (std::acos(1 - s * s) / kDeg), 1, 0.01) << sigma;
    EXPECT_NEAR(radius(Radius::Curvature) / (std::acos(1 - s * s) / kDeg), 1, 0.01) << sigma;
    // The best disk of full height ends where the lobe is half as high; half a degree of steps, and vertices up to 1.2 degrees beside that.
    EXPECT_NEAR(radius(Radius::Best), std::acos(1 - s * s * std::log(2.0)) / kDeg, 1.2) << sigma;
  }
  EXPECT_NEAR(kernelRadius() / kDeg, 4.22, 0.01);
  EXPECT_NEAR(candidatesOfLobes({{atVertex, 4.0}}, 3.0, {Radius::Fixed, 0.1, Refine::None})[0].radius, 0.1, 1e-12);
}

TEST(PublishedPeaks, ComeLargestFirstAndDoNotOverlap) {
  const DVec3 a(0, 0, 1), near = glm::normalize(DVec3(std::sin(8 * kDeg), 0, std::cos(8 * kDeg))),
                          far = glm::normalize(DVec3(std::sin(20 * kDeg), 0, std::cos(20 * kDeg)));
  for (const double radius : {3.0, 5.0}) {  // two disks of 5 degrees, 8 apart, overlap
    const std::vector<Candidate> found = candidatesOfLobes({{near, 2.0}, {a, 3.0}, {far, 1.0}}, 2.0, {Radius::Fixed, radius * kDeg, Refine::LogQuadric});
    ASSERT_EQ(found.size(), radius < 4 ? 3u : 2u);
    EXPECT_LT(angleBetween(found[0].direction, a), 0.05);
    EXPECT_LT(angleBetween(found.back().direction, far), 0.05);
    for (size_t i = 1; i < found.size(); ++i) EXPECT_LT(found[i].difference, found[i - 1].difference);
  }
  // Plateaus end; what the harmonics reach is no candidate; rounding is none.
  EXPECT_TRUE(candidatesOfLobes({}, 2.0, {}).empty());
  std::vector<DVec3> flat(icosphere(kSmoothLevel).vertices.size(), DVec3(1.0)), above(flat.size(), DVec3(1.5)), black(flat.size(), DVec3(0.0));
  EXPECT_TRUE(candidatesOf(flat, above, {}).empty());
  EXPECT_TRUE(candidatesOf(black, black, {}).empty());
  flat[5] += DVec3(1e-6);
  EXPECT_TRUE(candidatesOf(flat, std::vector<DVec3>(flat.size(), DVec3(1.0)), {}).empty());
  flat[5] += DVec3(1e-3);
  EXPECT_EQ(candidatesOf(flat, std::vector<DVec3>(flat.size(), DVec3(1.0)), {}).size(), 1u);
}

}  // namespace
}  // namespace gobo::transfer::published::peaks_test
