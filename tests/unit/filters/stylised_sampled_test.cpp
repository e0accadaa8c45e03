// SPDX-License-Identifier: Apache-2.0
// The averaged distance by points drawn at random: against the exact field, and against the law of its error.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <set>
#include <tuple>

#include "filters/stylised/sampled_distance.h"
#include "filters/stylised/sampled_sums.h"
#include "filters/stylised/transfer.h"
#include "measure/plot.h"
#include "support/thorough.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_sampled_test {

using namespace test;

SampledDistanceSettings settings(const Extent& e, uint32_t samples, int power = 8, StyleNorm norm = StyleNorm::Local, uint64_t seed = 1) {
  SampledDistanceSettings s;
  s.distance.extent = e;
  s.distance.power = power;
  s.distance.norm = norm;
  s.samples = samples;
  s.seed = seed;
  return s;
}
TermPtr sampled(const SampledDistanceSettings& s, const TermPtr& V, const TermPtr& g, int threads = 2) {
  return runFilter(makeSampledDistanceNode(s), {V, g}, threads);
}
TermPtr exact(const SampledDistanceSettings& s, const TermPtr& V, const TermPtr& g) { return runFilter(makeStyleDistanceNode(s.distance), {V, g}); }
PlaneView view(const Extent& e, float pixel = 1.0f) {
  PlaneView v;
  v.width = e.width;
  v.height = e.height;
  v.layers = e.layers;
  v.du = Vec3(pixel, 0, 0);
  v.dv = Vec3(0, pixel, 0);
  return v;
}
TermPtr disc(const Extent& e, float x, float y, float radius) {
  return floatTerm(e, "V", [=](int u, int v, int) { return std::hypot(float(u) - x, float(v) - y) < radius ? 0.0f : 1.0f; });
}

/// Two columns of pixels, 20 to the left and to the right of a straight contour that is 1998 long: of the 1000 pixels in the middle half each is an estimate of
/// its own, of one distance.
struct Edge {
  static constexpr int kRows = 1000;
  static constexpr double kDistance = 20, kLength = 2 * (kRows - 1);
  Extent extent{2, kRows, 1};
  TermPtr V, g;
  mutable std::map<std::pair<int, StyleNorm>, TermPtr> references;
  Edge() {
    PlaneView v = view(extent);
    v.du = Vec3(40, 0, 0);
    v.dv = Vec3(0, 2, 0);
    g = planeGBuffer(v);
    V = floatTerm(extent, "V", [](int x, int, int) { return float(x); });
  }
  struct Moments {
    double mean = 0, deviation = 0;  // of D by the distance that all of the contour gives
    int count = 0;
  };
  Moments of(uint32_t samples, int power, StyleNorm norm, uint64_t seed = 1) const {
    const SampledDistanceSettings s = settings(extent, samples, power, norm, seed);
    TermPtr& reference = references[{power, norm}];  // of no number of samples
    if (!reference) reference = exact(s, V, g);
    const auto D = sampled(s, V, g);
    Moments m;
    double sum = 0, squares = 0;
    for (size_t e = 2 * kRows / 4; e < 2 * kRows * 3 / 4; ++e) {
      const double d = double(D->floats("D")[e]) / double(reference->floats("D")[e]);
      sum += d, squares += d * d, ++m.count;
    }
    m.mean = sum / m.count;
    m.deviation = std::sqrt(squares / m.count - m.mean * m.mean);
    return m;
  }
  static double kappa(int p) { return kLength * straightLineConstant(2 * p) / (straightLineConstant(p) * straightLineConstant(p) * kDistance) - 1; }
};

// Gate of the method: slope -1/2 +- 0.05 and the asymptotic deviation within 15 % where N d / L is at least 10, and errors towards far.
TEST(StyleSampled, DeviationFollowsTheLawOfMonteCarlo) {
  const Edge edge;
  for (const StyleNorm norm : {StyleNorm::Published, StyleNorm::Local}) {
    double x = 0, y = 0, xx = 0, xy = 0;
    int n = 0;
    for (uint32_t N = 1024; N <= testing::thoroughOr(16384u, 8192u); N *= 2, ++n) {
      ASSERT_GE(N * Edge::kDistance / Edge::kLength, 10);
      const Edge::Moments m = edge.of(N, 8, norm, N);
      const double power = norm == StyleNorm::Published ? 8 : 7, law = std::sqrt(Edge::kappa(8) / N) / power;
      EXPECT_NEAR(m.deviation, law, 0.15 * law) << N;
      const double lx = std::log(double(N)), ly = std::log(m.deviation);
      x += lx, y += ly, xx += lx * lx, xy += lx * ly;
      if (std::getenv("STYLE_PRINT")) std::cout << N << ": deviation " << m.deviation << ", by the law " << law << ", bias " << m.mean - 1 << "\n";
    }
    const double slope = (n * xy - x * y) / (n * xx - x * x);
    EXPECT_NEAR(slope, -0.5, 0.05);
    if (std::getenv("STYLE_PRINT")) std::cout << "slope " << slope << "\n";
  }
}

TEST(StyleSampled, BiasIsTowardsFar) {
  const Edge edge;
  for (const StyleNorm norm : {StyleNorm::Published, StyleNorm::Local}) {
    double last = HUGE_VAL;
    for (const uint32_t N : {64u, 256u, 1024u}) {
      const Edge::Moments m = edge.of(N, 8, norm, 100 + N);
      const double bias = m.mean - 1, error = m.deviation / std::sqrt(double(m.count));
      EXPECT_GT(bias, N < 1024 ? 4 * error : 0) << N;
      EXPECT_LT(bias, last);
      last = bias;
    }
    EXPECT_NEAR(last, 0.5 / 8 * (1 + 1.0 / 8) * Edge::kappa(8) / 1024, 0.005);  // 0.46 % by the asymptotic law
  }
}

/// A cylinder seen from outside: normals turn by 160 degrees across the picture.
TermPtr cylinder(const Extent& e) {
  auto g = planeGBuffer(view(e, 0.1f));
  auto P = g->writable<float>("P"), N = g->writable<float>("N"), Ng = g->writable<float>("Ng");
  for (size_t i = 0; i < e.elements(); ++i) {
    const float a = (float(int(i) % e.width) / float(e.width) - 0.49f) * 2.8f;
    P[3 * i] = 3 * std::sin(a), P[3 * i + 2] = 3 * std::cos(a);
    N[3 * i] = Ng[3 * i] = std::sin(a), N[3 * i + 2] = Ng[3 * i + 2] = std::cos(a);
  }
  return g;
}

TEST(StyleSampled, SumsAreRightOnTheMeanWithAGuardToo) {  // the integral itself is estimated without bias
  const Extent e{40, 32, 1};
  const auto g = cylinder(e);
  const auto V = floatTerm(e, "V", [](int x, int y, int) { return (x / 9 + y / 11) % 2 ? 0.0f : 1.0f; });
  const TaskArena arena(1);
  const auto contour = *extractContour(contourInput(*V, *g, 0), 0.7f, arena, {});
  ASSERT_GT(contour.size(), 100u);
  const ContourPoints points(contour);
  const auto P = g->floats("P"), N = g->floats("N");
  for (const float cosine : {-2.0f, 0.7f, 0.95f})
    for (const int p : {2, 3, 8})
      for (const size_t at : {size_t(5 * 40 + 3), size_t(20 * 40 + 20), size_t(28 * 40 + 36)}) {
        const Vec3 x(P[3 * at], P[3 * at + 1], P[3 * at + 2]), n(N[3 * at], N[3 * at + 1], N[3 * at + 2]);
        const double exactly = std::pow(averagedDistanceTo(contour, x, n, p, StyleNorm::Local, cosine), 1 - p) * straightLineConstant(p);
        double sum = 0, squares = 0;
        constexpr int kSeeds = 5000;
        for (int seed = 0; seed < kSeeds; ++seed) {
          const SampledSum s = points.sum(x, n, p, cosine, uint64_t(seed), 64);
          const double ratio = s.seen ? s.sum * std::pow(s.unit2, -0.5 * p) * points.length() / 64 / exactly : 0.0;
          sum += ratio, squares += ratio * ratio;
        }
        const double mean = sum / kSeeds, error = std::sqrt((squares / kSeeds - mean * mean) / kSeeds);
        EXPECT_NEAR(mean, 1, 4 * error) << p << " at " << at;
        EXPECT_LT(error, 0.05);
      }
}

TEST(StyleSampled, ManyPointsAreTheExactField) {  // within 5 deviations of the mean, and what its root adds where they are large
  const Extent e{40, 32, 1};
  constexpr uint32_t kPoints = 4096;
  const auto V = disc(e, 14.3f, 12.1f, 8);
  size_t combination = 0;
  for (const TermPtr& g : {TermPtr(planeGBuffer(view(e, 0.1f))), cylinder(e)})
    for (const StyleNorm norm : {StyleNorm::Local, StyleNorm::Published})
      for (const int p : {2, 5, 8, 32}) {
        const size_t k = combination++;
        if (!testing::thorough() && (k + k / 4 + k / 8) % 2) continue;  // half of them: every pair of receiver, norm and power is there
        const SampledDistanceSettings s = settings(e, kPoints, p, norm);
        const auto D = sampled(s, V, g);
        const TaskArena arena(1);
        const auto contour = *extractContour(contourInput(*V, *g, 0), std::cos(s.distance.angle), arena, {});
        const auto P = g->floats("P"), N = g->floats("N");
        const double length = ContourPoints(contour).length();
        for (size_t i = 0; i < e.elements(); ++i) {
          const Vec3 x(P[3 * i], P[3 * i + 1], P[3 * i + 2]), n(N[3 * i], N[3 * i + 1], N[3 * i + 2]);
          const double expected = averagedDistanceTo(contour, x, n, p, norm, std::cos(s.distance.angle)), got = std::abs(double(D->floats("D")[i]));
          if (expected == double(kStyleFar)) {
            ASSERT_EQ(got, double(kStyleFar));
            continue;
          }
          const auto integral = [&](int q) {
            return straightLineConstant(q) * std::pow(averagedDistanceTo(contour, x, n, q, StyleNorm::Local, std::cos(s.distance.angle)), 1 - q);
          };
          const double once = norm == StyleNorm::Local ? straightLineConstant(p) * std::pow(expected, 1 - p) : integral(p);
          const double kappa = length * integral(2 * p) / (once * once);  // of one point: mean square over squared mean
          const double law = std::sqrt(kappa / kPoints) / (norm == StyleNorm::Local ? p - 1 : p);
          ASSERT_NEAR(got, expected, (5 * law + 0.02) * expected) << p << " at " << i;
        }
      }
}

TEST(StyleSampled, AnyScaleAndPowerIsFinite) {  // the running sum is in units of the nearest point so far: r^-64 of neither end of the scale is a number
  const Extent e{21, 17, 1};
  const auto V = disc(e, 9, 8, 5);
  for (const float scale : {1e-12f, 1e-4f, 1e6f, 1e12f})
    for (const int p : {2, 8, 63, 64})
      for (const StyleNorm norm : {StyleNorm::Local, StyleNorm::Published}) {
        const auto one = sampled(settings(e, 200, p, norm), V, planeGBuffer(view(e, 1.0f))),
                   scaled = sampled(settings(e, 200, p, norm), V, planeGBuffer(view(e, scale)));
        for (size_t i = 0; i < e.elements(); ++i) {
          const double expected = double(one->floats("D")[i]) * double(scale);
          ASSERT_NEAR(double(scaled->floats("D")[i]), expected, 1e-4 * std::abs(expected)) << scale << " " << p;
        }
      }
}

TEST(StyleSampled, TheRunningSumIsTheSum) {  // batch by batch, in units that shrink, against one sum in long double over the same points
  std::vector<ContourSegment> contour;
  for (int k = 0; k < 300; ++k) contour.push_back({Vec3(float(k), 0, 0), Vec3(float(k + 1), 0, 0), Vec3(0, k % 3 ? 0.0f : 1.0f, k % 3 ? 1.0f : 0.0f)});
  const ContourPoints points(contour);
  EXPECT_NEAR(points.length(), 300, 1e-9);
  for (const int p : {2, 7, 8, 64})
    for (uint64_t seed = 0; seed < 20; ++seed) {
      const Vec3 x(150.3f, 0.7f, 0);
      const uint32_t samples = 1000;
      long double sum = 0, nearest = HUGE_VALL;
      uint32_t seen = 0;
      std::vector<long double> squares;
      for (uint32_t k = 0; k < samples; ++k) {
        const double at = double(hash64(seed, k) >> 11) * 0x1p-53 * 300;
        if (int(at) % 3 == 0) continue;  // turned away
        const long double dx = at - double(x.x), dy = double(x.y);
        squares.push_back(dx * dx + dy * dy);
        nearest = std::min(nearest, squares.back());
        ++seen;
      }
      for (const long double s : squares) sum += std::pow(nearest / s, (long double)(p) / 2);
      const SampledSum got = points.sum(x, Vec3(0, 0, 1), p, 0.7f, seed, samples);
      EXPECT_EQ(got.seen, seen);
      EXPECT_NEAR(got.unit2, double(nearest), 1e-9 * double(nearest));
      EXPECT_NEAR(got.sum, double(sum), 1e-9 * double(sum)) << p << " " << seed;
    }
}

TEST(StyleSampled, PointsAreUniformByLength) {  // segments of very different lengths; those of none are none
  std::vector<ContourSegment> contour;
  const float lengths[] = {3.0f, 0.01f, 0.0f, 1.0f, 0.2f, 7.0f};
  for (size_t k = 0; k < 6; ++k) contour.push_back({Vec3(float(100 * k), 0, 0), Vec3(float(100 * k) + lengths[k], 0, 0), Vec3(0, 0, 1)});
  const ContourPoints points(contour);
  constexpr uint32_t kPoints = 200000;
  for (size_t k = 0; k < 6; ++k) {  // by a guard that lets segment k alone through
    auto turned = contour;
    turned[k].normal = Vec3(1, 0, 0);
    const double share = double(lengths[k]) / 11.21, expected = share * kPoints;
    const uint32_t seen = ContourPoints(turned).sum(Vec3(0, 5, 0), Vec3(1, 0, 0), 2, 0.9f, 7, kPoints).seen;
    EXPECT_NEAR(double(seen), expected, 5 * std::sqrt(expected * (1 - share)) + 1e-9) << k;
  }
}

TEST(StyleSampled, WithoutAContourSignsAreAllThatThereIs) {
  for (const Extent e : {Extent{1, 1, 1}, Extent{1, 5, 2}, Extent{9, 11, 3}})
    for (const float v : {0.0f, 1.0f, 0.49f, 0.5f}) {
      const auto D = sampled(settings(e, 8), floatTerm(e, "V", [&](int, int, int) { return v; }), planeGBuffer(view(e)));
      for (const float d : D->floats("D")) ASSERT_EQ(d, v >= 0.5f ? kStyleFar : -kStyleFar);
    }
}

TEST(StyleSampled, SignsAreThoseOfTheVisibility) {  // few points: anything but the sign may be wrong; what is hit by nothing is far
  const Extent e{37, 29, 2};
  auto g = planeGBuffer(view(e));
  for (size_t i = 0; i < e.elements(); i += 5) g->writable<uint32_t>("instance")[i] = ~0u;
  const auto V = noiseTerm(e, "V", 3);
  const auto D = sampled(settings(e, 1), V, g);
  for (size_t i = 0; i < e.elements(); ++i) {
    const float d = D->floats("D")[i];
    if (i % 5 == 0) {
      ASSERT_EQ(d, kStyleFar);
    } else {
      ASSERT_EQ(d > 0, V->floats("V")[i] >= 0.5f);
    }
    ASSERT_TRUE(std::isfinite(d) && d != 0.0f && std::abs(d) <= kStyleFar);
  }
}

/// x of mix64(x) = h.
uint64_t unmix64(uint64_t h) {
  const auto inverse = [](uint64_t odd) {
    uint64_t i = odd;
    for (int k = 0; k < 6; ++k) i *= 2 - odd * i;
    return i;
  };
  h ^= (h >> 31) ^ (h >> 62);
  h *= inverse(0x94d049bb133111ebull);
  h ^= (h >> 27) ^ (h >> 54);
  h *= inverse(0xbf58476d1ce4e5b9ull);
  return h ^ (h >> 30) ^ (h >> 60);
}
/// seed of hash64(seed, b) = h.
uint64_t seedOf(uint64_t h, uint64_t b) { return unmix64(h) - 0x9e3779b97f4a7c15ull * (b + 1); }

TEST(StyleSampled, APixelOnADrawnPointHasTheLeastDistance) {  // the middle of the only segment, drawn as point 5 or, when others have been summed, as point 70
  const Extent e{3, 2, 1};
  auto g = planeGBuffer(view(e));
  g->writable<float>("P")[3 * 5] = g->writable<float>("P")[3 * 5 + 1] = 0.5f;  // the last pixel, beside another of the same light
  const auto V = floatTerm(e, "V", [](int x, int, int) { return x < 1 ? 0.0f : 1.0f; });
  for (const uint64_t point : {5u, 70u})
    for (const int p : {2, 8, 63}) {
      SampledDistanceSettings s = settings(e, 100, p);
      s.seed = seedOf(seedOf(uint64_t(1) << 63, point), 5);
      ASSERT_EQ(hash64(hash64(s.seed, 5), point), uint64_t(1) << 63);
      EXPECT_EQ(sampled(s, V, g)->floats("D")[5], kLeastStyleDistance) << point << " " << p;
    }
}

TEST(StyleSampled, NumbersAreOfTheSeedAndOfThePlaceInThePicture) {
  const Extent e{31, 27, 2};
  const auto g = planeGBuffer(view(e));
  const auto V = disc(e, 15, 13, 7);
  const auto one = sampled(settings(e, 32), V, g, 1);
  EXPECT_EQ(one->content(), sampled(settings(e, 32), V, g, 4)->content()) << "threads";
  EXPECT_NE(one->content(), sampled(settings(e, 32, 8, StyleNorm::Local, 2), V, g)->content());
  // With a band around it a pixel draws what it draws without: here the band is lit, and adds no contour.
  constexpr int kGuard = 3;
  const Extent around{e.width + 2 * kGuard, e.height + 2 * kGuard, e.layers};
  PlaneView larger = view(around);
  larger.origin = Vec3(-kGuard, -kGuard, 0);
  SampledDistanceSettings s = settings(around, 32);
  s.place = {-kGuard, -kGuard, e.width, e.height};
  const auto D = sampled(s, disc(around, 15 + kGuard, 13 + kGuard, 7), planeGBuffer(larger));
  EXPECT_EQ(cropTerm(*D, kGuard, kGuard, e.width, e.height)->content(), one->content());
  // Neighbours draw other points: a contour as far from all of them gives them other distances.
  std::set<float> values;
  const Edge edge;
  const auto few = sampled(settings(edge.extent, 4), edge.V, edge.g);
  for (const float d : few->floats("D")) values.insert(d);
  EXPECT_GT(values.size(), 1900u);
}

TEST(StyleSampled, StopsWhenAsked) {
  const Extent e{64, 64, 1};
  TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {disc(e, 30, 30, 9), planeGBuffer(view(e))};
  ctx.arena = &arena;
  StopSource source;
  source.stop(StopReason::Cancelled);
  ctx.stop = source.token();
  EXPECT_EQ(runNode(*makeSampledDistanceNode(settings(e, 65536)), ctx).status().code(), Code::Cancelled);
}

// Figure 3.10 of the method anew, in its worst case: high softness, no abstraction. Root mean square of S against the exact field, by points and time
// (docs/intent.md).
TEST(StyleSampled, DISABLED_ErrorAgainstTime) {
  const Extent e{480, 270, 1};
  const auto V = floatTerm(e, "V", [](int x, int y, int) {
    bool shadow = false;
    for (int k = 0; k < 6; ++k) shadow = shadow || std::hypot(float(x) - 62.5f - 72.5f * float(k), float(y) - 135 + 50 * std::sin(2.0f * float(k))) < 26.7f;
    return shadow ? 0.0f : 1.0f;
  });
  const auto g = planeGBuffer(view(e, 0.01f));
  const auto ms = [](const auto& body) {  // of all cores together
    double best = HUGE_VAL;
    for (int k = 0; k < 2; ++k) {
      const std::clock_t start = std::clock();
      body();
      best = std::min(best, 1e3 * double(std::clock() - start) / CLOCKS_PER_SEC);
    }
    return best;
  };
  const double points = 480.0 * 270.0 * (16 + 64 + 256 + 1024 + 4096);
  double all = 0;
  Plot plot{"Error against time: points of the contour, and all of it", "processor time, ms", "RMS of S"};
  for (const StyleNorm norm : {StyleNorm::Published, StyleNorm::Local}) {
    const std::string name = norm == StyleNorm::Local ? "LOCAL" : "PUBLISHED";
    PlotSeries series{name + ", 16 to 4096 points", {}};
    TermPtr D;
    const double time = ms([&] { D = exact(settings(e, 1, 8, norm), V, g); });
    const StyleTransferSettings style{0, 1.0f, 0};  // 100 pixels
    const auto reference = runFilter(makeStyleTransferNode(style), {D});
    std::printf("%s: exact %.0f ms\n", name.c_str(), time);
    PlotSeries whole{name + ", exact (its bound)", {{time, 1e-4}}};
    for (uint32_t N = 16; N <= 4096; N *= 4) {
      const double t = ms([&] { D = sampled(settings(e, N, 8, norm), V, g); });
      all += t;
      const auto S = runFilter(makeStyleTransferNode(style), {D});
      double sum = 0;
      for (size_t i = 0; i < e.elements(); ++i) {
        const double d = double(S->floats("V")[i]) - double(reference->floats("V")[i]);
        sum += d * d;
      }
      std::printf("  N = %4u: RMS %.4f, %.0f ms\n", N, std::sqrt(sum / double(e.elements())), t);
      series.points.push_back({t, std::sqrt(sum / double(e.elements()))});
    }
    plot.series.push_back(std::move(series));
    plot.series.push_back(std::move(whole));
  }
  if (const char* path = std::getenv("STYLE_PLOT")) EXPECT_TRUE(writePlot(plot, path).ok()) << path;
  std::printf("%.1f ns a point\n", 1e6 * all / (2 * points));
}

// A light that jitters: the shadow of two discs moves by less than a pixel from picture to picture. Total variation of S, the mean over pixels of sum |S_t+1 -
// S_t|, by the averaged distance's norm and power; 64 is next to the Euclidean distance (docs/intent.md).
TEST(StyleSampled, DISABLED_VariationUnderJitteredLight) {
  const Extent e{160, 120, 1};
  constexpr int kPictures = 24;
  const auto g = planeGBuffer(view(e));
  for (const StyleTransferSettings& style : {StyleTransferSettings{0, 12, 0}, StyleTransferSettings{8, 4, 0}})
    for (const auto& [name, p, norm] : {std::tuple{"LOCAL, p = 8", 8, StyleNorm::Local},
                                        {"PUBLISHED, p = 8", 8, StyleNorm::Published},
                                        {"LOCAL, p = 64", 64, StyleNorm::Local},
                                        {"LOCAL, p = 2", 2, StyleNorm::Local}}) {
      TermPtr last;
      double sum = 0, most = 0;
      for (int t = 0; t < kPictures; ++t) {
        const float dx = toUnit(hash32(5, uint64_t(t))), dy = toUnit(hash32(6, uint64_t(t)));
        const auto V = floatTerm(e, "V", [&](int x, int y, int) {
          return std::hypot(float(x) - 50 - dx, float(y) - 60 - dy) < 22 || std::hypot(float(x) - 98 - dx, float(y) - 60 - dy) < 16 ? 0.0f : 1.0f;
        });
        const auto S = runFilter(makeStyleTransferNode(style), {exact(settings(e, 1, p, norm), V, g)});
        if (last)
          for (size_t i = 0; i < e.elements(); ++i) {
            const double d = std::abs(double(S->floats("V")[i]) - double(last->floats("V")[i]));
            sum += d;
            most = std::max(most, d);
          }
        last = S;
      }
      std::printf("inflation %g, softness %g, %-16s: %.5f a picture, at most %.3f\n", double(style.inflation), double(style.softness), name,
                  sum / double(e.elements()) / (kPictures - 1), most);
    }
}

}  // namespace stylised_sampled_test
}  // namespace gobo
