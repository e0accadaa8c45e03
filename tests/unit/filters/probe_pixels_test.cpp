// SPDX-License-Identifier: Apache-2.0
// Two-phase sampling of pixels near edges: sums are unbiased whatever is looked for, their variances are those that are stated, and edges cost few pixels.
#include "filters/automatic/probe_pixels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "base/sobol.h"

namespace gobo::test::probe {
namespace {

struct ProbePicture {
  std::string name;
  int width, height;
  std::function<ProbeSeen(int, int)> sees;
  /// Error of a pixel: where a neighbour sees something else, as a staircase has it.
  double error(int x, int y) const {
    if (sees(x, y) == ProbeSeen::Nothing) return 0;
    for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      const int u = x + dx, v = y + dy;
      if (u >= 0 && u < width && v >= 0 && v < height && sees(u, v) != sees(x, y)) return 0.05 + 0.1 * double((x * 7 + y * 3) % 11) / 11;
    }
    return 0;
  }
};

std::vector<ProbePicture> pictures() {
  const auto lit = [](bool b) { return b ? ProbeSeen::Lit : ProbeSeen::Dark; };
  return {{"slanted edge", 320, 240, [=](int x, int y) { return lit(3 * x + 5 * y < 1100); }},
          {"thin bars", 320, 240, [=](int x, int y) { return lit(x % 13 < 3 && y > 60); }},
          {"sky and disk", 320, 240, [=](int x, int y) { return y < 90 ? ProbeSeen::Nothing : lit((x - 150) * (x - 150) + (y - 170) * (y - 170) > 1600); }},
          {"leaves", 200, 150, [=](int x, int y) { return lit(hash64(uint64_t(x / 2), uint64_t(y / 2)) & 1); }},
          {"penumbra", 320, 240, [=](int x, int) { return x < 100   ? ProbeSeen::Dark
                                                          : x < 160 ? ProbeSeen::Both
                                                                    : ProbeSeen::Lit; }},
          {"small", 23, 17, [=](int x, int y) { return lit(x > y); }}};
}

ProbeDesign design(const ProbePicture& p, uint64_t seed, int judged = 96) {
  ProbeDesign d;
  d.width = p.width;
  d.height = p.height;
  d.judged = judged;
  d.seed = seed;
  return d;
}
ProbePixels chosen(const ProbePicture& p, const ProbeDesign& d) {
  const auto r = chooseProbePixels(d, [&](std::span<const PixelPlace> at, std::span<ProbeSeen> seen) {
    for (size_t i = 0; i < at.size(); ++i) seen[i] = p.sees(at[i].x, at[i].y);
    return true;
  });
  EXPECT_TRUE(r.ok());
  return r.ok() ? *r : ProbePixels{};
}
double meanOver(const ProbePicture& p, const std::function<double(int, int)>& f) {
  double sum = 0;
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) sum += f(x, y);
  return sum / (double(p.width) * p.height);
}

TEST(ProbePixels, SumsHaveTheMeanOfThePictureAsTheirExpectationAndTheirVarianceIsStated) {
  constexpr int kTries = 400;
  for (const ProbePicture& p : pictures()) {
    const std::vector<std::pair<std::string, std::function<double(int, int)>>> functions = {
        {"one", [](int, int) { return 1.0; }},
        {"slope", [&](int x, int y) { return double(x) / p.width + 2.0 * y / p.height; }},
        {"edge", [&](int x, int y) { return p.error(x, y); }},
        {"corner", [&](int x, int y) { return x < p.width / 4 && y < p.height / 4 ? 1.0 : 0.0; }}};
    std::vector<double> sums(functions.size()), squares(functions.size()), stated(functions.size());
    double receivers = 0, receivers2 = 0;
    for (int t = 0; t < kTries; ++t) {
      const ProbePixels c = chosen(p, design(p, 1000 + uint64_t(t)));
      ASSERT_EQ(c.judged.size(), 96u);
      receivers += c.receivers;
      receivers2 += c.receivers * c.receivers;
      for (size_t k = 0; k < functions.size(); ++k) {
        StratifiedSum sum;
        for (const ProbePixel& q : c.judged) sum.add(q, functions[k].second(q.at.x, q.at.y));
        sums[k] += sum.sum();
        squares[k] += sum.sum() * sum.sum();
        stated[k] += sum.variance();
      }
    }
    const auto check = [&](const std::string& name, double sum, double square, double truth) {
      const double mean = sum / kTries, variance = std::max(0.0, square / kTries - mean * mean);
      EXPECT_NEAR(mean, truth, 4 * std::sqrt(variance / kTries) + 1e-12) << p.name << ": " << name;
      return variance;
    };
    for (size_t k = 0; k < functions.size(); ++k) {
      const double variance = check(functions[k].first, sums[k], squares[k], meanOver(p, functions[k].second));
      if (functions[k].first == "edge") {  // what it is for: neither boasting nor shy. (Draws in order lower it for functions that vary slowly.)
        EXPECT_LT(variance, 1.6 * stated[k] / kTries) << p.name;
        EXPECT_GT(variance, 0.4 * stated[k] / kTries) << p.name;
      }
    }
    check("receivers", receivers, receivers2, meanOver(p, [&](int x, int y) { return p.sees(x, y) != ProbeSeen::Nothing ? 1.0 : 0.0; }));
  }
}

TEST(ProbePixels, RareEdgesAreSeenWhereEvenPixelsMissThem) {
  // One edge across a picture: an even look at 400 pixels sees it once in the mean.
  const ProbePicture p{"post", 640, 480, [](int x, int y) { return x >= 300 && x < 316 && y >= 200 && y < 216 ? ProbeSeen::Dark : ProbeSeen::Lit; }};
  const ProbePicture edge{"an edge", 640, 480, [](int x, int y) { return 3 * x + 5 * y < 1100 ? ProbeSeen::Dark : ProbeSeen::Lit; }};
  constexpr int kTries = 200, kEven = 400;
  double even = 0, even2 = 0, ours = 0, ours2 = 0;
  int missed = 0, evenMissed = 0, looks = 0;
  for (int t = 0; t < kTries; ++t) {
    double mean = 0;
    for (uint64_t i = 0; i < kEven; ++i) {  // one of each of 400 cells
      const uint64_t h = hash64(77 + uint64_t(t), i);
      mean += edge.error(int(i % 20) * 32 + int(h % 32), int(i / 20) * 24 + int((h >> 20) % 24)) / kEven;
    }
    even += mean;
    even2 += mean * mean;
    evenMissed += mean == 0;
    const ProbePixels c = chosen(edge, design(edge, 5000 + uint64_t(t)));
    StratifiedSum sum;
    for (const ProbePixel& q : c.judged) sum.add(q, edge.error(q.at.x, q.at.y));
    ours += sum.sum();
    ours2 += sum.sum() * sum.sum();
    missed += sum.sum() == 0;
    looks += chosen(p, design(p, 9000 + uint64_t(t))).edges > 0;
  }
  const auto variance = [&](double s, double s2) { return s2 / kTries - s / kTries * s / kTries; };
  EXPECT_LT(variance(ours, ours2), 0.7 * variance(even, even2)) << "96 pixels against 400";
  EXPECT_LT(missed, evenMissed / 4);
  EXPECT_GT(looks, kTries / 4) << "a post of 16 pixels, by 576 looks";
}

TEST(ProbePixels, WeightsAreBoundedByWhatTheyStandFor) {
  for (const ProbePicture& p : pictures()) {
    const ProbePixels c = chosen(p, design(p, 3));
    double all = 0;
    uint32_t last = 0;
    for (const ProbePixel& q : c.judged) {
      EXPECT_TRUE(q.at.x >= 0 && q.at.x < p.width && q.at.y >= 0 && q.at.y < p.height) << p.name;
      EXPECT_GT(q.weight, 0);
      EXPECT_LE(last, q.stratum);
      last = q.stratum;
      all += q.weight;
    }
    EXPECT_NEAR(all, 1.0, 0.2) << p.name;
  }
}

TEST(ProbePixels, PicturesOfAnyShape) {
  for (const auto& [w, h] : {std::pair{1, 1}, {1, 40}, {40, 1}, {3, 2}, {5000, 3}, {2, 2000}}) {
    const ProbePicture p{"", w, h, [](int x, int y) { return (x + y) % 3 ? ProbeSeen::Lit : ProbeSeen::Dark; }};
    const ProbePixels c = chosen(p, design(p, 1, 64));
    EXPECT_EQ(c.judged.size(), 64u);
    for (const ProbePixel& q : c.judged) ASSERT_TRUE(q.at.x >= 0 && q.at.x < w && q.at.y >= 0 && q.at.y < h) << w << "x" << h;
    EXPECT_NEAR(c.receivers, 1.0, 1e-9);
  }
}

TEST(ProbePixels, StopsAtAnyLook) {
  const ProbePicture p = pictures()[0];
  for (int last = 0; last < 2; ++last) {
    int looks = 0;
    const auto r = chooseProbePixels(design(p, 1), [&](std::span<const PixelPlace> at, std::span<ProbeSeen> seen) {
      for (size_t i = 0; i < at.size(); ++i) seen[i] = p.sees(at[i].x, at[i].y);
      return looks++ < last;
    });
    ASSERT_FALSE(r.ok()) << last;
    EXPECT_EQ(r.status().code(), Code::Cancelled);
    EXPECT_EQ(looks, last + 1);
  }
}

}  // namespace
}  // namespace gobo::test::probe
