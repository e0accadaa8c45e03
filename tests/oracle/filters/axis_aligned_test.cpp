// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering against closed forms and against the reference simulation of the report's digest: planar receiver, Gaussian
// light, analytic occluders, no ray tracer. Visibility is sampled here; slopes, rates, widths and the filter are the renderer's.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "filters/axis_aligned/sample_count.h"
#include "formulas/axis_aligned.glsl.h"
#include "support/thorough.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

double phi(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }
/// Inverse of phi by bisection on a table-free closed form; accurate to 1e-12, slow, fine here.
double inversePhi(double p) {
  // Acklam-free: Newton from a logistic start converges in a handful of steps for p in (1e-9, 1 - 1e-9).
  double x = std::log(p / (1 - p)) / 1.702;
  for (int i = 0; i < 12; ++i) {
    const double density = std::exp(-0.5 * x * x) / std::sqrt(2 * M_PI);
    x -= std::clamp((phi(x) - p) / density, -1.0, 1.0);
  }
  return x;
}
/// Table of inversePhi at cell centres, for speed: 1/65536 of probability.
const std::vector<float>& gaussTable() {
  static const std::vector<float> table = [] {
    std::vector<float> t(65536);
    for (size_t i = 0; i < t.size(); ++i) t[i] = float(inversePhi((double(i) + 0.5) / double(t.size())));
    return t;
  }();
  return table;
}
float gauss(float u) { return gaussTable()[std::min<size_t>(size_t(u * 65536.0f), 65535)]; }

AxisAlignedFilterSettings lightAbove(float k, int radius = 64) {
  AxisAlignedFilterSettings s = axisAlignedSettings(radius);
  s.k = k;
  return s;
}

// --- half plane ---------------------------------------------------------------------------------------------------------------

struct HalfPlane {
  float sigma = 1, d1 = 10, d2 = 5, pixel = 1.0f / 8;
};

TEST(AxisAlignedOracle, HalfPlaneNoiseFree) {
  // V = Phi(x / (sigma s)); filtered with variance beta^2 = (sigma s / k)^2 it is Phi(x / (sigma s sqrt(1 + 1/k^2))), exactly.
  const HalfPlane h;
  const float s = h.d1 / h.d2 - 1;
  PlaneView view;
  view.width = 256;
  view.height = 32;
  view.du = Vec3(h.pixel, 0, 0);
  view.dv = Vec3(0, h.pixel, 0);
  const Extent e{view.width, view.height, 1};
  auto world = [&](int x) { return (float(x) - 127.5f) * h.pixel; };
  for (float k : {2.0f, 3.0f, 4.0f}) {
    const auto V = floatTerm(e, "V", [&](int x, int, int) { return float(phi(world(x) / (h.sigma * s))); });
    const auto omega = floatTerm(e, "Omega", [&](int, int, int) { return formulas::aaBandLimit(s, h.sigma, h.pixel, 1); });
    const auto out = runFilter(axisAligned(lightAbove(k)), {V, planeGBuffer(view), omega});
    double worst = 0;
    for (int x = 16; x < 240; ++x)
      worst = std::max(worst, std::fabs(out->floats("V")[16 * 256 + x] - phi(world(x) / (h.sigma * s * std::sqrt(1 + 1 / (k * k))))));
    EXPECT_LT(worst, 4e-4) << k;  // the Gaussian is cut at 3 beta
  }
}

TEST(AxisAlignedOracle, HalfPlaneFromNoisySamples) {
  // 9 jittered samples a pixel, 64 seeds averaged: the bias alone remains.
  const HalfPlane h;
  const float s = h.d1 / h.d2 - 1, k = 3;
  PlaneView view;
  view.width = 128;
  view.height = 48;
  view.du = Vec3(h.pixel, 0, 0);
  view.dv = Vec3(0, h.pixel, 0);
  const Extent e{view.width, view.height, 1};
  const auto g = planeGBuffer(view);
  const auto omega = floatTerm(e, "Omega", [&](int, int, int) { return formulas::aaBandLimit(s, h.sigma, h.pixel, 1); });
  std::vector<double> mean(view.width, 0.0);
  const int seeds = 64;
  for (int seed = 0; seed < seeds; ++seed) {
    const auto V = floatTerm(e, "V", [&](int x, int y, int) {
      const float px = (float(x) - 63.5f) * h.pixel;
      int seen = 0;
      for (uint32_t i = 0; i < 9; ++i) {
        const float u = (float(i % 3) + toUnit(hash32(hash64(uint64_t(seed), i), uint64_t(y) * 128 + x))) / 3;
        const float light = h.sigma * gauss(u), crossing = px * h.d2 / h.d1 + light * (1 - h.d2 / h.d1);
        seen += crossing > 0;
      }
      return float(seen) / 9;
    });
    const auto out = runFilter(axisAligned(lightAbove(k, 16)), {V, g, omega});
    for (int y = 8; y < 40; ++y)
      for (int x = 0; x < view.width; ++x) mean[x] += out->floats("V")[size_t(y) * 128 + x];
  }
  double worst = 0, unfiltered = 0;
  for (int x = 12; x < 116; ++x) {
    const double px = (x - 63.5) * h.pixel, v = mean[x] / (seeds * 32.0);
    worst = std::max(worst, std::fabs(v - phi(px / (h.sigma * s * std::sqrt(1 + 1 / (k * k))))));
    unfiltered = std::max(unfiltered, std::fabs(v - phi(px / (h.sigma * s))));
  }
  EXPECT_LT(worst, 2e-3);
  EXPECT_GT(unfiltered, 8e-3);  // the test can tell the widened penumbra (max bias 0.0127) from the true one
  RecordProperty("max_deviation", std::to_string(worst));
}

// --- the digest's reference simulation (table 5.4) ------------------------------------------------------------------------------

/// Bars along both axes, starting at multiples of the period.
struct Grid {
  float d2, period, bar, extent;
};
constexpr int kBorder = 32, kSize = 256 + 2 * kBorder;  // the study's picture with a border, so that no kernel is cut
constexpr float kPixel = 1.0f / 32, kD1 = 10;
float pixelCentre(int i) { return (float(i) - 0.5f * (kSize - 1)) * kPixel; }

bool inside(const Grid& g, float v) { return std::fabs(v) <= g.extent; }
bool between(const Grid& g, float v) { return inside(g, v) && v - std::floor(v / g.period) * g.period >= g.bar; }
/// A layer lets a point through outside its extent, or between the bars of both axes.
bool blocked(const Grid& g, float x, float y) { return inside(g, x) && inside(g, y) && !(between(g, x) && between(g, y)); }
float crossing(const Grid& g, float receiver, float light) { return receiver * g.d2 / kD1 + light * (1 - g.d2 / kD1); }

/// Exact visibility under the untruncated Gaussian (sigma 1): a layer's transmission 1 - Ix Iy + Bx By is a sum of products over the axes, so
/// up to two layers need one-dimensional integrals only (midpoints of 8192 strata).
std::vector<double> exactVisibility(const std::vector<Grid>& grids) {
  GOBO_CHECK(grids.size() <= 2);
  const Grid nothing{5, 1, 0, -1};  // never inside
  const Grid a = grids[0], b = grids.size() > 1 ? grids[1] : nothing;
  std::vector<std::array<double, 9>> axis(kSize);  // integrals of {1, I, B}(a) x {1, I, B}(b)
  for (int i = 0; i < kSize; ++i) {
    axis[i].fill(0);
    const int strata = 8192;
    for (int k = 0; k < strata; ++k) {
      const float l = gauss((float(k) + 0.5f) / strata), xa = crossing(a, pixelCentre(i), l), xb = crossing(b, pixelCentre(i), l);
      const double fa[3] = {1, double(inside(a, xa)), double(between(a, xa))}, fb[3] = {1, double(inside(b, xb)), double(between(b, xb))};
      for (int m = 0; m < 9; ++m) axis[i][m] += fa[m / 3] * fb[m % 3] / strata;
    }
  }
  const double sign[3] = {1, -1, 1};
  std::vector<double> V(kSize * kSize, 0.0);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      for (int m = 0; m < 9; ++m) V[y * kSize + x] += sign[m / 3] * sign[m % 3] * axis[x][m] * axis[y][m];
  return V;
}

struct Simulated {
  TermPtr slopes, V;
};
/// side^2 jittered samples a pixel; slopes from 3x3 of their own.
Simulated simulate(const std::vector<Grid>& grids, int side, uint64_t seed) {
  const Extent e{kSize, kSize, 1};
  auto slopes = std::make_shared<Term>("shadow_slopes", Domain::ViewSample, e), V = std::make_shared<Term>("visibility", Domain::ViewSample, e);
  auto sMax = slopes->addPlane<float>("sMax"), sMin = slopes->addPlane<float>("sMin"), v = V->addPlane<float>("V");
  auto occluded = slopes->addPlane<uint8_t>("occluded");
  auto light = [&](int i, int n, uint64_t s, size_t p) {
    const uint64_t h = hash64(hash64(s, uint64_t(i)), p);
    return Vec2(gauss((float(i % n) + toUnit(uint32_t(h))) / float(n)), gauss((float(i / n) + toUnit(uint32_t(h >> 32))) / float(n)));
  };
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      const size_t p = size_t(y) * kSize + x;
      for (int i = 0; i < 9; ++i) {
        const Vec2 l = light(i, 3, seed * 2, p);
        for (const Grid& g : grids) {
          if (!blocked(g, crossing(g, pixelCentre(x), l.x), crossing(g, pixelCentre(y), l.y))) continue;
          const float slope = formulas::aaSlope(kD1 - g.d2, kD1);
          sMax[p] = std::max(sMax[p], slope);
          sMin[p] = occluded[p] ? std::min(sMin[p], slope) : slope;
          occluded[p] = 1;
        }
      }
      int seen = 0;
      for (int i = 0; i < side * side; ++i) {
        const Vec2 l = light(i, side, seed * 2 + 1, p);
        bool hit = false;
        for (const Grid& g : grids) hit = hit || blocked(g, crossing(g, pixelCentre(x), l.x), crossing(g, pixelCentre(y), l.y));
        seen += !hit;
      }
      v[p] = float(seen) / float(side * side);
    }
  return {slopes, V};
}

TermPtr filterSimulated(const Simulated& s, const TermPtr& V, float mu, float threshold = 1) {
  PlaneView view;
  view.width = view.height = kSize;
  view.du = Vec3(kPixel, 0, 0);
  view.dv = Vec3(0, kPixel, 0);
  const Extent e{kSize, kSize, 1};
  const TermPtr g = planeGBuffer(view);
  const auto dilated = runFilter(makeShadowSlopeDilation(10, e), {s.slopes, g});
  ShadowRateSettings rate;  // sigma 1
  const auto count = runFilter(makeShadowSampleCount(rate, e), {dilated, g, runFilter(makeShadowMu(mu, 0, rate), {})});
  AxisAlignedFilterSettings f = lightAbove(3, 32);
  f.betaThreshold = threshold;
  return runFilter(axisAligned(f), {V, g, count});
}
double rms(const Term& t, const std::vector<double>& truth) {
  double sum = 0;
  const auto v = t.floats("V");
  for (int y = kBorder; y < kSize - kBorder; ++y)
    for (int x = kBorder; x < kSize - kBorder; ++x) sum += std::pow(v[y * kSize + x] - truth[y * kSize + x], 2);
  return std::sqrt(sum / (256.0 * 256.0));
}

// The study does not print its bars. A's are pinned down by the Monte Carlo column (every entry within 1 %), B's by that column at 9
// samples and the bias floor. Its filter rejected nothing on these scenes (absolute band-limit threshold), hence threshold 1.
const std::vector<Grid> kGridsA{{6, 1.2f, 0.4f, 2.4f}, {8, 0.9f, 0.3f, 2.7f}};
const std::vector<Grid> kGridsB{{5, 1.5f, 0.5f, 2.4f}};

struct Row {
  int side;
  double mc, fixedMu, schedule;
};
void checkTable(const std::vector<Grid>& grids, const std::vector<Row>& rows) {
  const auto truth = exactVisibility(grids);
  for (const Row& r : rows) {
    const auto s = simulate(grids, r.side, 1);
    const float mu = std::pow(float(r.side * r.side) / 9.0f, 0.25f);
    const double mc = rms(*s.V, truth), filtered = rms(*filterSimulated(s, s.V, 1), truth), scheduled = rms(*filterSimulated(s, s.V, mu), truth);
    printf("%4d spp: MC %.4f (%.4f)  AAF %.4f (%.4f)  AAF mu %.4f (%.4f)\n", r.side * r.side, mc, r.mc, filtered, r.fixedMu, scheduled, r.schedule);
    EXPECT_NEAR(mc / r.mc, 1, 0.10) << r.side;
    EXPECT_NEAR(filtered / r.fixedMu, 1, 0.10) << r.side;
    EXPECT_NEAR(scheduled / r.schedule, 1, 0.10) << r.side;
  }
}
TEST(AxisAlignedOracle, ReferenceSimulationTwoGrids) {
  std::vector<Row> rows{{2, .190, .0220, .0207}, {3, .112, .0146, .0146}, {4, .0771, .0124, .0120}, {5, .0572, .0111, .0099}};
  if (!testing::thorough()) rows = {rows.front(), rows.back()};
  checkTable(kGridsA, rows);
}
TEST(AxisAlignedOracle, ReferenceSimulationOneGrid) { checkTable(kGridsB, {{3, .135, .0112, .0112}, {5, .0681, .0111, .0075}, {8, .0351, .0110, .0052}}); }

TEST(AxisAlignedOracle, MuScheduleConvergesAndFixedKDoesNot) {
  const auto truth = exactVisibility(kGridsA);
  const auto a = simulate(kGridsA, 4, 3), b = simulate(kGridsA, 8, 3);
  const double fixed4 = rms(*filterSimulated(a, a.V, 1), truth), fixed8 = rms(*filterSimulated(b, b.V, 1), truth);
  const double mu4 = rms(*filterSimulated(a, a.V, std::pow(16 / 9.0f, 0.25f)), truth), mu8 = rms(*filterSimulated(b, b.V, std::pow(64 / 9.0f, 0.25f)), truth);
  EXPECT_LE(mu8 / mu4, 0.65);
  EXPECT_GT(fixed8 / fixed4, 0.75);  // its bias stays
}

TEST(AxisAlignedOracle, TightBetaThresholdCostsMoreThanItSaves) {
  // Where pixels that see one layer meet pixels that see both, widths differ 2.7 times. Rejecting there makes kernels one-sided: the error of
  // threshold 0.5 is half again that of the default 0.75.
  const auto truth = exactVisibility(kGridsA);
  const auto s = simulate(kGridsA, 3, 1);
  const double tight = rms(*filterSimulated(s, s.V, 1, 0.5f), truth), usual = rms(*filterSimulated(s, s.V, 1, 0.75f), truth);
  EXPECT_LT(usual, 0.016);
  EXPECT_GT(tight, 1.4 * usual);
}

}  // namespace
}  // namespace gobo
