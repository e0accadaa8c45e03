// SPDX-License-Identifier: Apache-2.0
// What widths of least predicted error rest on: the squared bias of the two kernels in penumbras of uniform lights, worked out here in double by
// convolution, the noise of screen-space points, and that the width chosen by formula is near the best one on a scene that nothing was fitted to.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "filters/axis_aligned/filter.h"
#include "filters/axis_aligned/predicted_width.h"
#include "filters/axis_aligned/sample_count.h"
#include "formulas/axis_aligned.glsl.h"
#include "terms/screen_sequence.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

// --- the squared bias of an edge ---------------------------------------------------------------------------------------------------

constexpr double kStep = 0.01;
constexpr int kHalf = 800;  // +-8 standard deviations of the penumbra
std::vector<double> sampled(const std::function<double(double)>& f) {
  std::vector<double> v(2 * kHalf + 1);
  for (int i = -kHalf; i <= kHalf; ++i) v[size_t(i + kHalf)] = f(i * kStep);
  return v;
}
std::vector<double> convolved(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size(), 0.0);
  for (int i = -kHalf; i <= kHalf; ++i)
    for (int j = -kHalf; j <= kHalf; ++j) {
      const int k = std::clamp(i - j, -kHalf, kHalf);  // the edge goes on as 0 and 1
      if (b[size_t(j + kHalf)] != 0) out[size_t(i + kHalf)] += a[size_t(k + kHalf)] * b[size_t(j + kHalf)];
    }
  return out;
}
std::vector<double> normalised(std::vector<double> v) {
  double sum = 0;
  for (double x : v) sum += x;
  for (double& x : v) x /= sum;
  return v;
}
std::vector<double> kernel(double r, bool fourthOrder) {
  auto g = normalised(sampled([&](double x) { return std::fabs(x) <= 3 * r + 0.5 * kStep ? std::exp(-x * x / (2 * r * r)) : 0.0; }));
  if (!fourthOrder) return g;
  double q1 = 0, q2 = 0;
  const auto q = sampled([&](double x) { return x * x / (2 * r * r); });
  for (size_t i = 0; i < g.size(); ++i) {
    q1 += g[i] * q[i];
    q2 += g[i] * q[i] * q[i];
  }
  for (size_t i = 0; i < g.size(); ++i) g[i] *= (q2 - q1 * q[i]) / (q2 - q1 * q1);
  return g;
}
/// The profile of a square of side sqrt(12) (standard deviation 1) across an edge at that angle, or of the disk of radius 2, cumulated.
std::vector<double> edgeOf(double angle, bool disk) {
  const double a = std::sqrt(12.0) * std::cos(angle), b = std::sqrt(12.0) * std::sin(angle);
  auto box = [](double width) { return normalised(sampled([=](double x) { return std::clamp((0.5 * width - std::fabs(x)) / kStep + 0.5, 0.0, 1.0); })); };
  auto p = disk ? normalised(sampled([](double x) { return std::sqrt(std::max(0.0, 4 - x * x)); })) : box(a);
  if (!disk && b > kStep) {
    const auto other = box(b);
    std::vector<double> both(p.size(), 0.0);
    for (int i = -kHalf; i <= kHalf; ++i)
      for (int j = -kHalf; j <= kHalf; ++j)
        if (std::abs(i - j) <= kHalf) both[size_t(i + kHalf)] += p[size_t(i - j + kHalf)] * other[size_t(j + kHalf)];
    p = normalised(both);
  }
  double sum = 0;
  for (double& x : p) {
    sum += x;
    x = sum - 0.5 * x;
  }
  return p;
}
/// Mean over 6 standard deviations; the separable kernel lies along the axes, the edge at an angle to them.
double squaredBias(double angle, bool disk, double r, bool fourthOrder) {
  const auto edge = edgeOf(angle, disk);
  auto f = convolved(edge, kernel(r * std::cos(angle), fourthOrder));
  if (std::sin(angle) > 0.01) f = convolved(f, kernel(r * std::sin(angle), fourthOrder));
  double sum = 0;
  for (int i = -300; i <= 300; ++i) sum += std::pow(f[size_t(i + kHalf)] - edge[size_t(i + kHalf)], 2);
  return sum / 601;
}

TEST(PredictedWidth, SquaredBiasFollowsItsPower) {
  for (bool fourth : {false, true})
    for (double r : {0.4, 0.7, 1.0}) {
      double mean = squaredBias(0, true, r, fourth) / 2;
      for (double angle : {0.0, M_PI / 8, M_PI / 4}) mean += squaredBias(angle, false, r, fourth) / 6;
      const double model = fourth ? AA_BIAS_4 * std::pow(r, AA_BIAS_POWER_4) : AA_BIAS_2 * std::pow(r, AA_BIAS_POWER_2);
      EXPECT_LT(std::fabs(std::log(mean / model)), std::log(fourth ? 2.5 : 1.4)) << fourth << " r " << r << ": " << mean << " of " << model;
      if (fourth) { EXPECT_LT(8 * mean, squaredBias(0, false, r, false)) << r; }  // what it is for
    }
}

TEST(PredictedWidth, IsTheMinimumOfItsModel) {
  for (bool fourth : {false, true})
    for (float S : {2.0f, 5.0f, 20.0f})
      for (float n : {4.0f, 16.0f, 64.0f}) {
        const double B = fourth ? AA_BIAS_4 : AA_BIAS_2, p = fourth ? AA_BIAS_POWER_4 : AA_BIAS_POWER_2, gain = fourth ? AA_GAIN_4 : 1;
        auto error = [&](double w) { return B * std::pow(w / S, p) + formulas::aaNoise(n) * gain / (4 * M_PI * w * w); };
        const double w = formulas::aaPredictedWidth(S, n, fourth);
        EXPECT_LE(w, S * 1.00001);
        EXPECT_LE(error(w), error(0.98 * w));
        if (w < 0.99 * S) { EXPECT_LE(error(w), error(1.02 * w)) << S << " " << n; }
      }
  for (float S : {0.0f, 1e-30f, 1e30f, std::numeric_limits<float>::infinity()})
    for (float n : {1.0f, 1e9f}) EXPECT_FALSE(std::isnan(formulas::aaPredictedWidth(S, n, true))) << S << " " << n;
}

// --- screen-space points -----------------------------------------------------------------------------------------------------------

/// Mean of u + v < t over `n` points a pixel, blocks of side `block` taken together: RMS error over many blocks.
double blockError(int n, int block, bool screen) {
  const Extent e{64, 64, 1};
  const ScreenSequence points(5, e, {}, uint32_t(n));
  double sum = 0;
  int count = 0;
  for (double t : {0.37, 0.81, 1.13})
    for (int by = 0; by < 64; by += block)
      for (int bx = 0; bx < 64; bx += block, ++count) {
        double mean = 0;
        for (int y = by; y < by + block; ++y)
          for (int x = bx; x < bx + block; ++x)
            for (int i = 0; i < n; ++i) {
              const size_t p = size_t(y) * 64 + size_t(x);
              const Vec2 u = screen ? points(p, uint32_t(i)).next2D() : SobolSampler(hash64(9, p), uint32_t(i)).next2D();
              mean += (u.x + u.y < t) / double(n * block * block);
            }
        const double truth = t < 1 ? t * t / 2 : 1 - (2 - t) * (2 - t) / 2;
        sum += (mean - truth) * (mean - truth);
      }
  return std::sqrt(sum / count);
}

TEST(ScreenSequence, NeighboursAreSpreadTogether) {
  for (int n : {4, 16}) {
    EXPECT_NEAR(blockError(n, 1, true) / blockError(n, 1, false), 1, 0.25) << n;  // a pixel's own are as good as ever
    EXPECT_LT(blockError(n, 4, true), 0.6 * blockError(n, 4, false)) << n;
    EXPECT_LT(blockError(n, 8, true), 0.45 * blockError(n, 8, false)) << n;
  }
}

TEST(ScreenSequence, DependsOnThePlaceInTheWholePictureAlone) {
  const Extent whole{40, 30, 2}, part{8, 5, 2};
  ViewPlace place;
  place.x = 17;
  place.y = 11;
  place.filmWidth = 40;
  place.filmHeight = 30;
  const ScreenSequence a(3, whole, {}, 9), b(3, part, place, 16);  // 9 and 16 have one stride
  for (int layer = 0; layer < 2; ++layer)
    for (int y = 0; y < 5; ++y)
      for (int x = 0; x < 8; ++x)
        for (uint32_t i : {0u, 8u}) {
          const Vec2 u = a(size_t((layer * 30 + y + 11) * 40 + x + 17), i).next2D(), v = b(size_t((layer * 5 + y) * 8 + x), i).next2D();
          ASSERT_TRUE(u.x == v.x && u.y == v.y);
        }
  const ScreenSequence c(4, whole, {}, 9);
  EXPECT_NE(a(5, 0).next2D().x, c(5, 0).next2D().x);
  EXPECT_NE(a(5, 0).next2D().x, a(5 + 40 * 30, 0).next2D().x);
}

// --- the penumbra around a pixel ----------------------------------------------------------------------------------------------------

struct Pilots {
  std::shared_ptr<Term> slopes, gbuffer;
};
Pilots pilots(int width, int height) {
  PlaneView view;
  view.width = width;
  view.height = height;
  Pilots p;
  p.gbuffer = planeGBuffer(view);
  p.slopes = std::make_shared<Term>("shadow_slopes", Domain::ViewSample, Extent{width, height, 1});
  p.slopes->addPlane<float>("sMin");
  auto v = p.slopes->addPlane<float>("sumV");
  p.slopes->addPlane<uint8_t>("occluded");
  auto w = p.slopes->addPlane<float>("sumW");
  std::fill(v.begin(), v.end(), 1.0f);  // everything sees the light
  std::fill(w.begin(), w.end(), 1.0f);
  return p;
}

TEST(ShadowPenumbra, TakesTheMeanOfFourthPowersWithinItsWindow) {
  const Extent e{40, 3, 1};
  Pilots p = pilots(40, 3);
  const float sigma = 0.5f, footprint = 0.1f;
  auto set = [&](int x, int y, float s) {
    p.slopes->writable<float>("sMin")[size_t(y * 40 + x)] = s;
    p.slopes->writable<uint8_t>("occluded")[size_t(y * 40 + x)] = 1;
  };
  set(10, 1, 1.0f);  // S = 5 pixels
  set(12, 2, 0.4f);  // 2
  set(30, 0, 1e-6f);
  const auto out = runFilter(makeShadowPenumbra(3, sigma, e), {p.slopes, p.gbuffer});
  const auto size = out->floats("size");
  const auto seen = out->plane<uint8_t>("seen");
  EXPECT_EQ(size[40 + 6], 0.0f);
  EXPECT_NEAR(size[40 + 7], sigma * 1.0f / footprint, 1e-4);
  EXPECT_NEAR(size[40 + 11], std::pow((std::pow(5.0, -4) + std::pow(2.0, -4)) / 2, -0.25), 1e-4);
  EXPECT_NEAR(size[15], 2.0f, 1e-4);
  EXPECT_NEAR(size[30], kNarrowestPenumbra, 1e-5);
  for (int x = 0; x < 40; ++x) EXPECT_EQ(seen[size_t(40 + x)], size[size_t(40 + x)] > 0.0f ? 1 : 0) << x;
}

TEST(ShadowPenumbra, OtherInstancesSayThatThereIsOneNotHowWide) {
  Pilots p = pilots(12, 1);
  const Extent e{12, 1, 1};
  p.slopes->writable<float>("sMin")[5] = 1;
  p.slopes->writable<uint8_t>("occluded")[5] = 1;
  p.gbuffer->writable<uint32_t>("instance")[6] = 3;
  p.gbuffer->writable<uint32_t>("instance")[7] = ~0u;
  const auto out = runFilter(makeShadowPenumbra(2, 1, e), {p.slopes, p.gbuffer});
  EXPECT_GT(out->floats("size")[4], 0.0f);
  EXPECT_EQ(out->floats("size")[6], 0.0f);
  EXPECT_EQ(out->plane<uint8_t>("seen")[6], 1);
  EXPECT_EQ(out->plane<uint8_t>("seen")[7], 0);  // no surface
  // Turned away from the light: visibility means nothing there.
  p.slopes->writable<float>("sumW")[4] = 0;
  const auto away = runFilter(makeShadowPenumbra(2, 1, e), {p.slopes, p.gbuffer});
  EXPECT_EQ(away->floats("size")[4], 0.0f);
  EXPECT_EQ(away->plane<uint8_t>("seen")[4], 1);  // more points may find a part of the light
  EXPECT_GT(away->floats("size")[3], 0.0f);
  p.slopes->writable<float>("sumW")[4] = 1;
  // All light blocked around: nothing to find out.
  for (float& v : p.slopes->writable<float>("sumV")) v = 0;
  EXPECT_EQ(runFilter(makeShadowPenumbra(2, 1, e), {p.slopes, p.gbuffer})->plane<uint8_t>("seen")[4], 0);
}

TEST(ShadowPenumbra, StaysFiniteWhateverTheSlopesAre) {
  Pilots p = pilots(16, 16);
  const Extent e{16, 16, 1};
  const float odd[] = {1e-38f, 1e38f, 1e-4f, 1e3f};
  for (int i = 0; i < 256; ++i) {
    p.slopes->writable<float>("sMin")[size_t(i)] = odd[i % 4];
    p.slopes->writable<uint8_t>("occluded")[size_t(i)] = uint8_t(i % 3 != 0);
    p.gbuffer->writable<float>("footprint")[size_t(i)] = i % 5 == 0 ? 0.0f : i % 7 == 0 ? 1e-38f : 0.1f;
  }
  const auto penumbra = runFilter(makeShadowPenumbra(4, 1e20f, e), {p.slopes, p.gbuffer});
  for (float v : penumbra->floats("size")) ASSERT_TRUE(std::isfinite(v) && v >= 0);
}

TEST(ShadowPenumbra, FootprintsOfNothingSayNothing) {
  Pilots p = pilots(8, 8);
  for (int i = 0; i < 64; ++i) {
    p.slopes->writable<float>("sMin")[size_t(i)] = 1;
    p.slopes->writable<uint8_t>("occluded")[size_t(i)] = 1;
    p.gbuffer->writable<float>("footprint")[size_t(i)] = 0;
  }
  const auto out = runFilter(makeShadowPenumbra(2, 1, {8, 8, 1}), {p.slopes, p.gbuffer});
  for (float v : out->floats("size")) ASSERT_EQ(v, 0.0f);
}

TEST(ShadowPenumbra, LightsOfAnySizeStayFinite) {
  Pilots p = pilots(4, 4);
  for (int i = 0; i < 16; ++i) {
    p.slopes->writable<float>("sMin")[size_t(i)] = 1;
    p.slopes->writable<uint8_t>("occluded")[size_t(i)] = 1;
  }
  const auto out = runFilter(makeShadowPenumbra(2, 1e20f, {4, 4, 1}), {p.slopes, p.gbuffer});
  for (float v : out->floats("size")) ASSERT_TRUE(v > 1e8f && std::isfinite(v));
}

TEST(PredictedWidth, BandLimitsFollowWidthRaysAndMu) {
  PlaneView view;
  view.width = 8;
  view.height = 2;
  const Extent e{8, 2, 1};
  const auto g = planeGBuffer(view);  // pixels of 0.1 m
  auto penumbra = std::make_shared<Term>("shadow_penumbra", Domain::ViewSample, e);
  auto size = penumbra->addPlane<float>("size");
  penumbra->addPlane<uint8_t>("seen");
  auto counts = std::make_shared<Term>("shadow_penumbra_count", Domain::ViewSample, e);
  auto n = counts->addPlane<uint32_t>("n");
  for (int i = 0; i < 16; ++i) {
    size[size_t(i)] = i == 3 ? 0.0f : 1.0f + float(i);
    n[size_t(i)] = i == 5 ? 0 : 4u << (i % 3);
  }
  for (float mu : {1.0f, 2.0f})
    for (bool fourth : {false, true}) {
      const auto out = runFilter(makeShadowPredictedWidth(fourth, e), {penumbra, g, counts, runFilter(makeShadowMu(mu, 0, {}), {})});
      for (int i = 0; i < 16; ++i) {
        const float omega = out->floats("Omega")[size_t(i)];
        if (i == 3 || i == 5) {
          EXPECT_EQ(omega, 0.0f) << i;
          continue;
        }
        const float width = formulas::aaPredictedWidth(size[size_t(i)], float(n[size_t(i)]), fourth) * 0.1f;
        EXPECT_NEAR(formulas::aaBeta(omega, 3.0f) * mu / width, 1, 1e-5) << i << " mu " << mu;
      }
    }
}

// --- the fourth order on a picture ---------------------------------------------------------------------------------------------------

TermPtr filtered(const TermPtr& V, float betaPx, bool fourth, bool exact2d = false) {
  PlaneView view;
  view.width = V->extent().width;
  view.height = V->extent().height;
  AxisAlignedFilterSettings s = axisAlignedSettings(64);
  s.fourthOrder = fourth;
  s.exact2d = exact2d;
  const auto omega = floatTerm(V->extent(), "Omega", [&](int, int, int) { return 1 / (3 * betaPx * 0.1f); });
  return runFilter(axisAligned(s), {V, planeGBuffer(view), omega});
}

TEST(FourthOrder, KeepsWhatIsSmoothAndWhatIsConstant) {
  const Extent e{96, 96, 1};
  // Along a parabola a Gaussian is off by beta^2 / 2 times the curvature; a kernel without second moment is not.
  const auto bowl = floatTerm(e, "V", [](int x, int y, int) { return 0.2f + 1e-4f * float((x - 48) * (x - 48)) + 5e-5f * float((y - 48) * (y - 48)); });
  const auto gaussian = filtered(bowl, 4, false), fourth = filtered(bowl, 4, true);
  for (int y = 20; y < 76; y += 5)
    for (int x = 20; x < 76; x += 5) {
      const size_t p = size_t(y * 96 + x);
      EXPECT_NEAR(fourth->floats("V")[p], bowl->floats("V")[p], 2e-6);
      EXPECT_NEAR(gaussian->floats("V")[p] - bowl->floats("V")[p], 1e-4 * 16 + 5e-5 * 16, 2e-4);
    }
  const auto flat = floatTerm(e, "V", [](int, int, int) { return 0.3f; });
  const auto still = filtered(flat, 5, true);
  for (float v : still->floats("V")) ASSERT_EQ(v, 0.3f);
}

TEST(FourthOrder, NoiseGainIsAsPredicted) {
  const Extent e{384, 384, 1};
  for (float beta : {3.0f, 6.0f}) {
    const auto out =
        filtered(floatTerm(e, "V", [](int x, int y, int) { return 0.3f + 0.4f * toUnit(hash32(7, uint64_t(y) * 384 + uint64_t(x))); }), beta, true);
    double sum = 0, count = 0;
    const int margin = int(4 * beta) + 2;
    for (int y = margin; y < 384 - margin; ++y)
      for (int x = margin; x < 384 - margin; ++x, ++count) sum += sqr(out->floats("V")[size_t(y) * 384 + size_t(x)] - 0.5f);
    const double predicted = AA_GAIN_4 / (4 * M_PI * beta * beta), scatter = std::sqrt(2 / (count * predicted));
    EXPECT_NEAR(sum / count * 12 / 0.16 / predicted, 1, 0.06 + 3 * scatter) << beta;
  }
}

TEST(FourthOrder, StaysWithinZeroAndOne) {
  const Extent e{64, 64, 1};
  const auto step = floatTerm(e, "V", [](int x, int y, int) { return x + y / 3 < 40 ? 0.0f : 1.0f; });
  const auto out = filtered(step, 4, true);
  float low = 1, high = 0;
  for (float v : out->floats("V")) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
  EXPECT_EQ(low, 0.0f);
  EXPECT_EQ(high, 1.0f);
}

TEST(FourthOrder, FewTapsFallBackToTheGaussian) {
  const Extent e{64, 64, 1};
  const auto noise = noiseTerm(e, "V", 3);
  for (float beta : {1e-6f, 1e-3f, 0.05f, 0.2f, 0.34f}) {
    const auto out = filtered(noise, beta, true);
    for (float v : out->floats("V")) ASSERT_TRUE(v >= 0 && v <= 1) << beta;
    for (size_t i = 0; beta < 0.1f && i < e.elements(); ++i) ASSERT_NEAR(out->floats("V")[i], noise->floats("V")[i], 1e-6) << beta;
  }
}

TEST(FourthOrder, SeparableIsNearTheRoundOne) {
  // The product of two kernels of order 4 along the axes and the round kernel of order 4 differ, but neither moves a smooth picture.
  const Extent e{96, 96, 1};
  const auto wave = floatTerm(e, "V", [](int x, int y, int) { return 0.5f + 0.3f * std::sin(0.08f * float(x)) * std::cos(0.06f * float(y)); });
  const auto a = filtered(wave, 3, true), b = filtered(wave, 3, true, true);
  for (int y = 20; y < 76; ++y)
    for (int x = 20; x < 76; ++x) {
      const size_t p = size_t(y * 96 + x);
      ASSERT_NEAR(a->floats("V")[p], wave->floats("V")[p], 1e-3);
      ASSERT_NEAR(b->floats("V")[p], wave->floats("V")[p], 1e-3);
    }
}

}  // namespace
}  // namespace gobo
