// SPDX-License-Identifier: Apache-2.0
// Sheared and multiple axis-aligned filtering against closed forms: a plane under a rectangular lamp, occluders of known slopes, jittered points, no ray
// tracer. The receivers' visibility behind layers of bars along both axes is a product of sums over the axes, worked out here.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/axis_aligned/filter.h"
#include "filters/multiple_axis_aligned/bands.h"
#include "filters/sheared/filter.h"
#include "filters/sheared/gather_kernels.h"
#include "support/thorough.h"
#include "unit/filters/synthetic.h"

namespace gobo::shearing {  // names of its own: test files are compiled together
namespace {

using namespace test;

constexpr int kSide = 96;
constexpr float kPixel = 1.0f / 32, kHeight = 10.0f, kHalf = 1.0f;

LightRectangle lamp() {
  LightRectangle r;
  r.centre = Vec3(0, 0, kHeight);
  r.axis = Vec3(0, 0, -1);
  r.u = Vec3(1, 0, 0);
  r.v = Vec3(0, 1, 0);
  return r;
}
PlaneView floorView(float angle) {
  PlaneView v;
  v.width = v.height = kSide;
  v.du = Vec3(std::cos(angle), std::sin(angle), 0) * kPixel;
  v.dv = Vec3(-std::sin(angle), std::cos(angle), 0) * kPixel;
  v.origin = -0.5f * float(kSide - 1) * (v.du + v.dv);
  return v;
}

/// Bars along x alone, or along both axes: open where x + s y leaves `share` of its period; half plane: period 0.
struct Bars {
  float s, period, share;
  bool both = true;
  bool open(double t) const { return period > 0 ? t / period - std::floor(t / period) < share : t > 0; }
};
/// The share of light points that one axis leaves open at receiver place x: exact but for 1024 strata.
double openShare(const std::vector<Bars>& layers, double x, bool second) {
  int seen = 0;
  const int strata = 1024;
  for (int k = 0; k < strata; ++k) {
    const double y = ((k + 0.5) / strata * 2 - 1) * kHalf;
    bool all = true;
    for (const Bars& b : layers) all = all && ((second && !b.both) || b.open(x + b.s * y));
    seen += all;
  }
  return double(seen) / strata;
}

struct Case {
  PlaneView view;
  TermPtr samples, count;
  std::vector<double> truth;
};
/// n jittered points of every pixel, and their bands. `noise`: visibilities are independent and even in 0..1 instead.
Case makeCase(const std::vector<Bars>& layers, uint32_t n, uint64_t seed, float angle = 0.0f, bool noise = false) {
  Case c{floorView(angle), nullptr, nullptr, {}};
  const Extent e{kSide, kSide, 1};
  const size_t K = (n + 3) / 4 * 4;
  const LightBands bands{{1.0f, 0.0f}};
  auto s = std::make_shared<Term>("light_samples", Domain::ViewSample, e), k = std::make_shared<Term>("count", Domain::ViewSample, e);
  auto V = s->addPlane<float>("V"), point = s->addPlane<float>("point", int(4 * K)), band = s->addPlane<float>("band", 2);
  auto count = k->addPlane<uint32_t>("n");
  for (size_t p = 0; p < e.elements(); ++p) {
    const Vec3 at = c.view.origin + float(p % kSide) * c.view.du + float(p / kSide) * c.view.dv;
    count[p] = n;
    float of[2] = {};
    for (uint32_t i = 0; i < n; ++i) {
      const Vec2 u = SobolSampler(hash64(seed, p), i).next2D();
      float* to = &point[4 * K * p + i];
      to[0] = 2 * u.x - 1;
      to[K] = 2 * u.y - 1;
      to[2 * K] = 1;
      bool seen = true;
      for (const Bars& b : layers)
        seen = seen && b.open(double(at.x) + double(b.s) * double(to[0]) * kHalf) && (!b.both || b.open(double(at.y) + double(b.s) * double(to[K]) * kHalf));
      to[3 * K] = noise ? toUnit(hash32(seed, n * p + i)) : seen ? 1.0f : 0.0f;
      V[p] += to[3 * K] / float(n);
      for (int j = 0; j < 2; ++j) of[j] += bands.profile(j, to[0], to[K]) / float(n);
      for (int j = 0; j < 2; ++j) band[2 * p + size_t(j)] += bands.profile(j, to[0], to[K]) * to[3 * K] / float(n);
    }
    for (int j = 0; j < 2; ++j) band[2 * p + size_t(j)] += (bands.mean(j) - of[j]) * V[p];
    c.truth.push_back(-1);
  }
  c.samples = s;
  c.count = k;
  for (size_t p = 0; p < e.elements(); p += 7) {
    const Vec3 at = c.view.origin + float(p % kSide) * c.view.du + float(p / kSide) * c.view.dv;
    c.truth[p] = openShare(layers, double(at.x), false) * openShare(layers, double(at.y), true);
  }
  return c;
}
TermPtr constantShear(float a, float deviationPx) {
  const Extent e{kSide, kSide, 1};
  auto t = std::make_shared<Term>("shadow_shear", Domain::ViewSample, e);
  for (float& v : t->addPlane<float>("shear")) v = a;
  for (float& v : t->addPlane<float>("width")) v = sheared::kTentOfDeviation * deviationPx * kPixel;
  return t;
}
TermPtr shear(const Case& c, float a, float deviationPx, ShearedFilterSettings::Passes passes = ShearedFilterSettings::Passes::Never) {
  ShearedFilterSettings s;
  s.light = lamp();
  s.passes = passes;
  return runFilter(makeShearedFilter(s), {c.samples, planeGBuffer(c.view), c.samples, constantShear(a, deviationPx), c.count});
}
TermPtr straight(const Case& c, const TermPtr& V, float deviationPx, bool fourthOrder) {
  AxisAlignedFilterSettings s = axisAlignedSettings(32);
  s.fourthOrder = fourthOrder;
  return runFilter(makeAxisAlignedFilter(s),
                   {V, planeGBuffer(c.view), floatTerm({kSide, kSide, 1}, "Omega", [&](int, int, int) { return 1 / (3 * deviationPx * kPixel); })});
}
/// Root mean square and mean difference to the truth, away from the border.
struct Off {
  double rms = 0, mean = 0;
};
Off off(const Case& c, std::span<const float> V, int border = 26) {
  double sum = 0, mean = 0, count = 0;
  for (int y = border; y < kSide - border; ++y)
    for (int x = border; x < kSide - border; ++x) {
      const size_t p = size_t(y) * kSide + size_t(x);
      if (c.truth[p] < 0) continue;
      sum += sqr(V[p] - float(c.truth[p]));
      mean += double(V[p]) - c.truth[p];
      ++count;
    }
  return {std::sqrt(sum / count), mean / count};
}

TEST(ShearedOracle, OneLayerIsSharedWithoutBias) {
  // 32 rays a pixel and a kernel as wide as the penumbra: what is left is noise, while the axis-aligned Gaussian of that width blurs the bars away.
  for (const float angle : {0.0f, 0.4f})
    for (const float s : {0.5f, 1.0f}) {
      if (!testing::thorough() && (angle > 0) != (s > 0.5f)) continue;  // each angle and each slope
      const Case c = makeCase({{s, 0.9f, 0.6f}}, 32, 1, angle);
      const Off sheared = off(c, shear(c, 1 / s, 6)->floats("V")), blurred = off(c, straight(c, c.samples, 6, false)->floats("V"));
      EXPECT_LT(sheared.rms, 0.006) << s << " " << angle;
      EXPECT_LT(std::fabs(sheared.mean), 0.002) << s << " " << angle;
      EXPECT_GT(blurred.rms, 2 * sheared.rms) << s << " " << angle;
    }
}

TEST(ShearedOracle, HalfPlaneIsTheRampOfAUniformLight) {
  const float s = 0.8f;
  const Case c = makeCase({{s, 0.0f, 0.0f, false}}, 16, 2);
  const auto out = shear(c, 1 / s, 6);
  for (int x = 26; x < kSide - 26; x += 4) {
    double mean = 0;
    for (int y = 26; y < kSide - 26; ++y) mean += out->floats("V")[size_t(y) * kSide + size_t(x)] / double(kSide - 52);
    const double at = (x - 0.5 * (kSide - 1)) * kPixel;
    EXPECT_NEAR(mean, std::clamp(0.5 + at / (2 * s * kHalf), 0.0, 1.0), 0.006) << x;
  }
}

TEST(ShearedOracle, DensityOfPixelsIsNotThatOfTheLight) {
  // Rows ever farther apart, as a floor is seen: each pixel counts by its area. Without it the denser side's end of the light counts more. Half plane across.
  const float s = 1.0f, a = 1 / s;
  PlaneView view = floorView(0);
  Case c{view, nullptr, nullptr, {}};
  const Extent e{kSide, kSide, 1};
  auto place = [](int i) { return 0.02 * std::expm1(0.04 * i) / 0.04 - 1.5; };
  auto samples = std::make_shared<Term>("light_samples", Domain::ViewSample, e), count = std::make_shared<Term>("count", Domain::ViewSample, e);
  auto V = samples->addPlane<float>("V"), point = samples->addPlane<float>("point", 64);
  auto n = count->addPlane<uint32_t>("n");
  auto g = planeGBuffer(view);
  auto P = g->writable<float>("P");
  for (size_t p = 0; p < e.elements(); ++p) {
    const double x = place(int(p % kSide));
    P[3 * p] = float(x);
    n[p] = 16;
    for (uint32_t i = 0; i < 16; ++i) {
      const Vec2 u = SobolSampler(hash64(3, p), i).next2D();
      float* to = &point[64 * p + i];
      to[0] = 2 * u.x - 1;
      to[16] = 2 * u.y - 1;
      to[32] = 1;
      to[48] = x + double(s) * double(to[0]) > 0 ? 1.0f : 0.0f;
      V[p] += to[48] / 16;
    }
  }
  ShearedFilterSettings settings;
  settings.light = lamp();
  settings.passes = ShearedFilterSettings::Passes::Never;
  const auto out = runFilter(makeShearedFilter(settings), {samples, g, samples, constantShear(a, 8), count});
  double worst = 0;
  for (int x = 34; x < 46; ++x) {  // where the kernel neither leaves the picture nor outgrows the radius
    double mean = 0;
    for (int y = 26; y < kSide - 26; ++y) mean += out->floats("V")[size_t(y) * kSide + size_t(x)] / double(kSide - 52);
    worst = std::max(worst, std::fabs(mean - std::clamp(0.5 + 0.5 * place(x), 0.0, 1.0)));
  }
  EXPECT_LT(worst, 0.006);
}

TEST(ShearedOracle, AWrongShearOrDensityWouldBeSeen) {
  // What the first test can tell: half the slope, and the slope's sign.
  const Case c = makeCase({{1.0f, 0.9f, 0.6f}}, 16, 3);
  EXPECT_GT(off(c, shear(c, 2.0f, 8)->floats("V")).rms, 0.02);
  EXPECT_GT(off(c, shear(c, 0.5f, 8)->floats("V")).rms, 0.01);
}

TEST(ShearedOracle, FewRaysGainWhereThereIsOneSlope) {
  // Equal rays, each filter at the best of its widths: independent points of each pixel.
  const float s = 1.0f;
  const Case c = makeCase({{s, 0.9f, 0.6f}}, 4, 4);
  double best = 1, bestStraight = 1;
  for (const float w : {4.0f, 6.0f, 8.0f}) best = std::min(best, off(c, shear(c, 1 / s, w)->floats("V")).rms);
  for (const float w : {3.0f, 4.0f, 6.0f, 8.0f}) bestStraight = std::min(bestStraight, off(c, straight(c, c.samples, w, true)->floats("V")).rms);
  RecordProperty("sheared", std::to_string(best));
  RecordProperty("axis_aligned", std::to_string(bestStraight));
  EXPECT_LT(best, bestStraight);
}

TEST(ShearedOracle, TwoLayersFarApartGainNothing) {
  // The product of two layers has frequencies beyond the wedge of their slopes: no shear between them is better than none.
  const Case c = makeCase({{0.3f, 0.8f, 0.7f}, {0.9f, 0.9f, 0.7f}}, 9, 5);
  double best = 1, bestStraight = 1;
  int k = 0;
  for (const float w : {2.0f, 3.0f, 4.0f, 6.0f}) {
    int j = k++;
    for (const float a : {1.2f, 2.2f, 3.0f})
      if (testing::thorough() || j++ % 3 == 0) best = std::min(best, off(c, shear(c, a, w)->floats("V")).rms);  // each width and each shear
  }
  for (const float w : {2.0f, 3.0f, 4.0f, 6.0f}) bestStraight = std::min(bestStraight, off(c, straight(c, c.samples, w, true)->floats("V")).rms);
  RecordProperty("sheared", std::to_string(best));
  RecordProperty("axis_aligned", std::to_string(bestStraight));
  EXPECT_GT(best, 0.9 * bestStraight);
}

TEST(ShearedOracle, NoiseGainIsThatOfTheTentWhereShearVanishes) {
  // a -> 0: the plain mean under the tent, of independent pixels: a sum of squares of (2/3) / T along each axis.
  const Case c = makeCase({}, 4, 6, 0.0f, true);
  const float deviation = 4, T = sheared::kTentOfDeviation * deviation;
  const auto out = shear(c, 1.0e-6f, deviation);
  double sum = 0, count = 0;
  for (int y = 12; y < kSide - 12; ++y)
    for (int x = 12; x < kSide - 12; ++x, ++count) sum += sqr(out->floats("V")[size_t(y) * kSide + size_t(x)] - 0.5f);
  const double predicted = sqr(2.0f / (3.0f * T)) / 4 / 12, scatter = std::sqrt(2 * (1.5 * T) * (1.5 * T) / count);
  EXPECT_NEAR(sum / count / predicted, 1, 0.1 + 3 * scatter);
}

// --- multiple axis-aligned filters -------------------------------------------------------------------------------------------------

TermPtr multiple(const Case& c, float first, float second, float deviationPx, bool fourthOrder) {
  const auto a = straight(c, runFilter(makeLightBand(0), {c.samples}), first * deviationPx, fourthOrder);
  const auto b = straight(c, runFilter(makeLightBand(1), {c.samples}), second * deviationPx, fourthOrder);
  return runFilter(makeLightBandSum(), {a, b});
}

TEST(MultipleAxisAlignedOracle, BandsSumToTheLight) {
  const Case c = makeCase({{0.5f, 0.9f, 0.6f}}, 9, 7);
  const auto sum = runFilter(makeLightBandSum(), {runFilter(makeLightBand(0), {c.samples}), runFilter(makeLightBand(1), {c.samples})});
  for (size_t p = 0; p < c.truth.size(); ++p) ASSERT_NEAR(sum->floats("V")[p], c.samples->floats("V")[p], 1e-6);
}

TEST(MultipleAxisAlignedOracle, EqualWidthsAreOneFilter) {
  const Case c = makeCase({{0.5f, 0.9f, 0.6f}}, 9, 8);
  const auto many = multiple(c, 1, 1, 4, false), one = straight(c, c.samples, 4, false);
  for (size_t p = 0; p < c.truth.size(); ++p) ASSERT_NEAR(many->floats("V")[p], one->floats("V")[p], 2e-6);
}

TEST(MultipleAxisAlignedOracle, TheSmoothProfileBearsTheWiderFilter) {
  // Which way widths go: widening the smooth profile's filter adds less bias than widening the rim's. 64 rays, so that bias is what is seen.
  const Case c = makeCase({{1.0f, 0.9f, 0.6f}}, 64, 9);
  const double smooth = off(c, multiple(c, 1.5f, 1, 8, true)->floats("V")).rms, rim = off(c, multiple(c, 1, 1.5f, 8, true)->floats("V")).rms;
  EXPECT_LT(smooth, 0.9 * rim);
}

TEST(MultipleAxisAlignedOracle, LitAndDarkStay) {
  for (const bool lit : {false, true}) {
    const Case c = makeCase({{1.0f, 1.0f, lit ? 1.0f : 0.0f}}, 4, 10);
    const auto out = multiple(c, 1.5f, 1, 4, true);
    for (float v : out->floats("V")) ASSERT_NEAR(v, lit ? 1.0f : 0.0f, 1e-6);
  }
}

}  // namespace
}  // namespace gobo::shearing
