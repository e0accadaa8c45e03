// SPDX-License-Identifier: Apache-2.0
// Convolution shadow maps against the Fourier series in double: truncation error, ringing, corrections, the period's guard, bytes, slanted
// receivers. Golden values: digest of Annen 2008, 5.4, 5.7 and 7.3 (measured there in double with period 1; ours has P = 1 + 1/M, so lengths
// are in units of P).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filters/shadow_map/summed_area.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Correction = v1::ConvolutionShadow;

v1::ConvolutionShadow settings(int order, Correction::Correction correction = Correction::NONE, double attenuation = 0) {
  v1::ConvolutionShadow m;
  m.set_order(uint32_t(order));
  m.set_correction(correction);
  m.set_attenuation(attenuation);
  return m;
}
double period(int order) { return 1.0 + 1.0 / order; }

/// The series in t = (z - d) / P, in double: eq. 6.5 with c_k = pi (2 k - 1).
double series(double t, int order, double attenuation = 0) {
  double s = 0.5;
  for (int k = 1; k <= order; ++k)
    s += 2 * std::exp(-attenuation * (double(k) / order) * (double(k) / order)) * std::sin(M_PI * (2 * k - 1) * t) / (M_PI * (2 * k - 1));
  return s;
}

/// What the shipped float code makes of one depth and one receiver, before limiting.
class Shipped {
 public:
  explicit Shipped(const v1::ConvolutionShadow& m) : basis_(makeConvolutionBasis(m)), P_(period(int(m.order()))) {}
  double at(double z, double d) const {
    const float zf = float(z), df = float(d);
    float v[64], s;
    basis_->encode(&zf, v, 1);
    basis_->reconstruct(v, 1, &df, &s, 1);
    return s;
  }
  /// At (z - d) / P = t, |t| <= 1/2, about the middle of the range.
  double operator()(double t) const { return at(0.5 + 0.5 * t * P_, 0.5 - 0.5 * t * P_); }

 private:
  ShadowBasisPtr basis_;
  double P_;
};

TEST(ConvolutionShadow, ShippedSeriesIsTheSeries) {
  for (int order = 1; order <= 32; ++order)
    for (double attenuation : {0.0, 1.0}) {
      const Shipped f(settings(order, Correction::NONE, attenuation));
      double worst = 0;
      for (int i = 0; i <= 100; ++i)
        for (int j = 0; j <= 100; j += 7)
          worst = std::max(worst, std::fabs(f.at(i / 100.0, j / 100.0) - series((float(i / 100.0) - float(j / 100.0)) / period(order), order, attenuation)));
      EXPECT_LT(worst, 1e-5) << order;  // float angles up to 63 pi: 2^-24 * 200 for each of d and z, weights sum below 2.7
    }
}

TEST(ConvolutionShadow, TruncationErrorIsParsevals) {
  // RMS over a period of the error is sqrt(sum_{k > M} 2 / c_k^2) ~ 1 / (pi sqrt(2 M)); mean |error| of the limited series as measured in the
  // digest, 5.7. Both to 4 digits.
  struct Golden {
    int order;
    double rms, limited;
  };
  for (const Golden& g : {Golden{4, 0.1123, 0.0456}, {8, 0.0795, 0.0256}, {16, 0.0563, 0.0142}, {32, 0.0398, 0.0078}}) {
    const Shipped f(settings(g.order));
    const int n = 40000;
    double square = 0, limited = 0;
    for (int i = 0; i < n; ++i) {
      const double t = -0.5 + (i + 0.5) / n, step = t > 0 ? 1 : 0, v = f(t);
      square += (v - step) * (v - step);
      limited += std::fabs(std::clamp(v, 0.0, 1.0) - step);
    }
    EXPECT_NEAR(std::sqrt(square / n), g.rms, 6e-5) << g.order;
    EXPECT_NEAR(std::sqrt(square / n), 1 / (M_PI * std::sqrt(2.0 * g.order)), 0.003 * g.rms) << g.order;
    EXPECT_NEAR(limited / n, g.limited, 6e-5) << g.order;
  }
}

TEST(ConvolutionShadow, SlopePeakAndRippleHaveTheirClosedForms) {
  struct Golden {
    int order;
    double peak, minimum, dark;
  };
  for (const Golden& g : {Golden{4, 1.0921, 0.9459, 0.065}, {8, 1.0901, 0.9501, 0.033}, {16, 1.0897, 0.9511, 0.016}}) {
    const Shipped f(settings(g.order));
    const double h = 1e-3 / g.order;
    EXPECT_NEAR((f(h) - f(-h)) / (2 * h), 2 * g.order, 0.02 * g.order) << g.order;  // f'(0) = 2 M, 1/P of it per depth range
    EXPECT_NEAR(f(0.5 / g.order), g.peak, 6e-5) << g.order;                         // the first peak, at 1 / (2 M)
    double lowest = 2;
    for (double t = 0.5 / g.order; t < 1.5 / g.order; t += 1e-4 / g.order) lowest = std::min(lowest, f(t));
    EXPECT_NEAR(lowest, g.minimum, 6e-5) << g.order;
    double gap = 0;
    while (f(-gap) >= 0.05) gap += 1e-4;
    EXPECT_NEAR(gap, g.dark, 6e-4) << g.order;
  }
  EXPECT_NEAR(Shipped(settings(32))(0.5 / 32), 0.5 + 1.8519370519824662 / M_PI, 3e-4);  // 1/2 + Si(pi) / pi = 1.08949
}

TEST(ConvolutionShadow, AttenuationTradesOvershootForSlope) {
  struct Golden {
    int order;
    double alpha, peak, where, slope;
  };
  for (const Golden& g : {Golden{4, 1, 0.984, 0.167, 5.31},
                          {8, 1, 1.004, 0.081, 11.3},
                          {16, 1, 1.013, 0.040, 23.3},
                          {4, 2, 0.966, -1, 3.9},
                          {8, 2, 0.993, -1, 8.7},
                          {16, 2, 0.999, -1, 18.3}}) {
    const Shipped f(settings(g.order, Correction::NONE, g.alpha));
    double peak = 0, where = 0;
    const double end = g.alpha == 1 ? 1.0 / g.order : 0.5;  // alpha = 1: the first peak; alpha = 2: the largest value of all
    for (double t = 0; t <= end; t += 1e-4) {
      const double v = f(t);
      if (v > peak) {
        peak = v;
        where = t;
      }
    }
    EXPECT_NEAR(peak, g.peak, 6e-4) << g.order << " " << g.alpha;
    if (g.where > 0) { EXPECT_NEAR(where, g.where, 1.5e-3) << g.order; }
    const double h = 1e-3 / g.order;
    EXPECT_NEAR((f(h) - f(-h)) / (2 * h), g.slope, 0.06) << g.order << " " << g.alpha;
  }
}

TEST(ConvolutionShadow, OffsetsAndScalesAreTheTables) {
  struct Golden {
    int order;
    double offset, scale, shift, dark, peak;
  };
  for (const Golden& g :
       {Golden{4, 0.0763, 1.1214, 0.0642, 0.120, 1.164}, {8, 0.0383, 1.1109, 0.0326, 0.061, 1.156}, {16, 0.0192, 1.1084, 0.0164, 0.031, 1.154}}) {
    EXPECT_NEAR(convolutionCorrection(Correction::OFFSET, g.order, 0).offset, g.offset, 5.1e-5);
    EXPECT_EQ(convolutionCorrection(Correction::OFFSET, g.order, 0).scale, 1.0);
    EXPECT_EQ(convolutionCorrection(Correction::SCALING, g.order, 0).scale, 2.0);
    EXPECT_EQ(convolutionCorrection(Correction::SCALING, g.order, 0).offset, 0.0);
    const ConvolutionCorrection c = convolutionCorrection(Correction::SHIFTED_SCALING, g.order, 0);
    EXPECT_NEAR(c.scale, g.scale, 5.1e-5) << g.order;
    EXPECT_NEAR(c.offset, g.shift, 5.1e-5) << g.order;
    // What they promise. Residuals of 1 - f*(0) are divided by small coverages in soft shadows (7.3): 1e-12.
    EXPECT_NEAR(0.5 + c.scale * (series(c.offset, g.order) - 0.5), 1.0, 1e-12) << g.order;
    EXPECT_NEAR(series(convolutionCorrection(Correction::OFFSET, g.order, 0).offset, g.order), 1.0, 1e-12) << g.order;
    double lowest = 2, peak = 0;
    for (double t = c.offset; t <= 0.5; t += 1e-5) lowest = std::min(lowest, 0.5 + c.scale * (series(t, g.order) - 0.5));
    for (double t = 0; t <= 0.5; t += 1e-5) peak = std::max(peak, 0.5 + c.scale * (series(t, g.order) - 0.5));
    EXPECT_GE(lowest, 1.0 - 1e-9) << "a ripple dips below 1 for M = " << g.order;
    EXPECT_NEAR(peak, g.peak, 6e-4) << g.order;
    const Shipped f(settings(g.order, Correction::SHIFTED_SCALING));
    double gap = 0;
    while (f(-gap) >= 0.05) gap += 1e-4;
    EXPECT_NEAR(gap, g.dark, 6e-4) << g.order;
    EXPECT_NEAR(f(0.0), 1.0, 2e-5) << g.order;
  }
  // Attenuated below 1: scaled to reach 1 at the peak.
  for (int order : {4, 8, 16}) {
    const ConvolutionCorrection c = convolutionCorrection(Correction::OFFSET, order, 2);
    EXPECT_GT(c.scale, 1.0);
    EXPECT_NEAR(0.5 + c.scale * (series(c.offset, order, 2) - 0.5), 1.0, 1e-12);
  }
}

TEST(ConvolutionShadow, ManyTermsComparePercentageCloser) {
  // Beyond 1/M of the step the truncated series is within 1 / (2 pi M sin(pi t)) of it: the tail of an alternating sum. 5 % slack for
  // the terms after its first.
  for (int order : {4, 16, 32}) {
    const Shipped f(settings(order));
    for (double t = 1.0 / order; t <= 0.5; t += 1e-3) {
      const double bound = 1.05 / (2 * M_PI * order * std::sin(M_PI * t)) + 1e-5;
      ASSERT_LE(std::fabs(f(t) - 1), bound) << order << " " << t;
      ASSERT_LE(std::fabs(f(-t)), bound) << order << " " << t;
    }
  }
  // And over a kernel, against comparisons: random depth, all of it further than P / M from the receiver's.
  const int size = 32, blur = 2, order = 32;
  const TermPtr depth = depthMap(size, [](int x, int y) {
    const float r = random01(41, uint64_t(y * 99 + x));
    return r < 0.5f ? 0.8f * r : 0.2f + 0.8f * r;  // below 0.4 or above 0.6
  });
  std::vector<Vec3> points;
  for (int i = 0; i < 500; ++i) points.push_back({random01(42, uint64_t(i)), random01(43, uint64_t(i)), 0.5f});
  const auto V = visibility(depth, makeConvolutionBasis(settings(order)), blur, points);
  const auto W = compare(depth, unitComparison(size, v1::PercentageCloserShadow::GAUSSIAN, blur), receivers(points));
  double square = 0;
  for (size_t i = 0; i < V.size(); ++i) {
    EXPECT_NEAR(V[i], W[i], 1.05 / (2 * M_PI * order * std::sin(M_PI * 0.1 / period(order))));
    square += (V[i] - W[i]) * double(V[i] - W[i]);
  }
  EXPECT_LT(std::sqrt(square / double(V.size())), 0.006);  // signs mix over the kernel
}

/// Share of the filter kernel (Gaussian and bilinear) at texel position t that lies at or beyond `edge`.
double litShare(double t, int edge, const std::vector<double>& w) {
  const int radius = int(w.size() / 2);
  const auto at = [&](int x) {
    double p = 0;
    for (int k = -radius; k <= radius; ++k) p += x + k >= edge ? w[size_t(k + radius)] : 0.0;
    return p;
  };
  const int x = int(std::floor(t));
  return at(x) * (1 - (t - x)) + at(x + 1) * (t - x);
}

TEST(ConvolutionShadow, HalfPlaneRampsWithOffsetAndWithScaling) {
  // Blocker at 0.2 over x < 1/2. Background in the receiver's plane: both corrections keep the kernel's ramp p. Background far behind:
  // the offset keeps it, doubling makes it min(1, 2 p): sharpened, as the thesis says of scaling (6.1.1).
  const int size = 64, order = 16, blur = 4;
  const auto w = gaussian(blur);
  std::vector<Vec3> points;
  for (int i = 0; i <= 300; ++i) points.push_back({0.35f + 0.3f * float(i) / 300, 0.5f, 0.6f});
  const double offset = convolutionCorrection(Correction::OFFSET, order, 0).offset;
  for (const auto correction : {Correction::OFFSET, Correction::SCALING})
    for (double background : {0.6, 0.95}) {
      const TermPtr depth = depthMap(size, [&](int x, int) { return x < size / 2 ? 0.2f : float(background); });
      const auto V = visibility(depth, makeConvolutionBasis(settings(order, correction)), blur, points);
      const double o = correction == Correction::OFFSET ? offset : 0, scale = correction == Correction::OFFSET ? 1 : 2;
      const double lit = scale * series((background - 0.6) / period(order) + o, order), dark = scale * series((0.2 - 0.6) / period(order) + o, order);
      for (size_t i = 0; i < points.size(); ++i) {
        const double p = litShare(double(points[i].x) * size - 0.5, size / 2, w);
        ASSERT_NEAR(V[i], std::clamp(p * lit + (1 - p) * dark, 0.0, 1.0), 2e-5) << correction << " " << background << " " << points[i].x;
        const double ideal = correction == Correction::SCALING && background > 0.6 ? std::min(1.0, 2 * p) : p;
        ASSERT_NEAR(V[i], ideal, 0.04) << correction << " " << background << " " << points[i].x;  // |f_M - step| at these two gaps
      }
    }
}

TEST(ConvolutionShadow, SlantedReceiverHasItsClosedFormAndTheSlopeBiasLightsIt) {
  // A lit plane whose depth rises m a texel, box of n texels (5.6): s = 1/2 + sum (2 / c_k) sin(c_k o) D(c_k m), D the mean of cos(c_k m j) over the
  // box, sin(n x / 2) / (n sin(x / 2)) for texels, -> sinc(x n / 2).
  const int size = 64, order = 16, n = 9;
  const ShadowBasisPtr basis = makeConvolutionBasis(settings(order, Correction::OFFSET));
  const double P = period(order), o = convolutionCorrection(Correction::OFFSET, order, 0).offset;
  for (double m : {0.001, 0.004, 0.01}) {
    const TermPtr map = encodeBasis(depthMap(size, [&](int x, int) { return float(0.15 + m * x); }), basis, 0);
    const TermPtr table = runNode(makeShadowSummedAreaNode(basis, size, 1), {map});
    std::vector<float> v(size_t(basis->channels()));
    SummedArea(*table, size).box(0, 32, 20, n, n, v.data());
    const float d = float(0.15 + m * 32);
    float s;
    basis->reconstruct(v.data(), 1, &d, &s, 1);
    double exact = 0.5, sinc = 0.5;
    for (int k = 1; k <= order; ++k) {
      const double c = M_PI * (2 * k - 1), x = c * m / P;
      exact += 2 / c * std::sin(c * o) * std::sin(n * x / 2) / (n * std::sin(x / 2));
      sinc += 2 / c * std::sin(c * o) * std::sin(n * x / 2) / (n * x / 2);
    }
    EXPECT_NEAR(s, exact, 1e-4) << m;  // the table's rounding: 2.7 sqrt(2) 2^-16
    EXPECT_NEAR(exact, sinc, 0.01) << m;
    // False self-shadow once m r exceeds the offset or so (o P = 0.02, r = 4.5 texels).
    if (m * n / 2 > 1.5 * o * P) {
      EXPECT_LT(s, 0.9) << m;
    } else if (m * n / 2 < 0.3 * o * P) {
      EXPECT_GT(s, 0.99) << m;
    }
  }
  // The lookup node's slope bias brings the receiver forward by what its own plane spans: 1 lights it, 0 leaves it half dark.
  const double m = 0.008;
  const int blur = 4;
  const TermPtr map = encodeBasis(depthMap(size, [&](int x, int) { return float(0.15 + m * x); }), basis, blur);
  std::vector<Vec3> points;
  for (int x = 16; x < 48; ++x) points.push_back({(float(x) + 0.5f + 0.4f * float(x % 2)) / size, 0.5f, 0});
  for (Vec3& p : points) p.z = float(0.15 + m * (double(p.x) * size - 0.5));
  const TermPtr g = receivers(points, glm::normalize(Vec3(float(m * size), 0, -1)));
  ShadowLookup l = unitLookup(size, blur);
  for (float v : values(lookupBasis(g, map, basis, l), "V")) EXPECT_LT(v, 0.95f);
  l.map.slopeBias = 1.0f;
  for (float v : values(lookupBasis(g, map, basis, l), "V")) EXPECT_GT(v, 0.97f);
  // With a footprint beyond the pre-filter (9 texels wide), the span is the footprint's.
  const TermPtr flat = encodeBasis(depthMap(size, [&](int x, int) { return float(0.15 + m * x); }), basis, 0);
  const TermPtr wide = receivers(points, glm::normalize(Vec3(float(m * size), 0, -1)), 9.0f / size);
  ShadowLookup box = unitLookup(size);
  box.map.lookup = v1::ShadowMapSettings::SUMMED_AREA;
  const TermPtr table = runNode(makeShadowSummedAreaNode(basis, size, 1), {flat});
  for (float v : values(lookupBasis(wide, table, basis, box), "V")) EXPECT_LT(v, 0.95f);
  box.map.slopeBias = 1.0f;
  for (float v : values(lookupBasis(wide, table, basis, box), "V")) EXPECT_GT(v, 0.97f);
}

TEST(ConvolutionShadow, NothingWrapsAroundThePeriod) {
  // With period 1 the series comes back to 1/2 at |z - d| = 1: a receiver at the far plane behind a blocker at the near plane would be half
  // lit, a near point before a far background darkened by the offset. P = 1 + 1/M leaves no such pair (digest 5.6).
  for (int order = 2; order <= 32; ++order)
    for (const auto correction : {Correction::OFFSET, Correction::SCALING, Correction::SHIFTED_SCALING}) {
      const Shipped f(settings(order, correction));
      const double ripple = order < 4 ? 0.2 : 0.12;  // 2 (1.0895 - 1) / 2 and up, larger for few terms
      for (double z : {0.0, 0.002, 0.01}) EXPECT_LT(f.at(z, 1.0 - z), ripple) << order << " " << correction;
      for (double d : {0.0, 0.002, 0.01}) EXPECT_GT(f.at(1.0 - d, d), 1 - ripple) << order << " " << correction;
    }
  EXPECT_NEAR(series(-0.9999, 16), 0.5, 0.01);  // what the guard is for
}

TEST(ConvolutionShadow, ResultsStayBetweenZeroAndOneForEveryOrder) {
  std::vector<Vec3> points;
  for (int i = 0; i < 500; ++i) points.push_back({random01(44, uint64_t(i)), random01(45, uint64_t(i)), random01(46, uint64_t(i))});
  const TermPtr depth = depthMap(16, [](int x, int y) { return random01(47, uint64_t(y * 99 + x)); });
  for (int order = 1; order <= 32; ++order)
    for (const auto correction : {Correction::OFFSET, Correction::SCALING, Correction::SHIFTED_SCALING, Correction::NONE})
      for (bool bytes : {false, true})
        for (double attenuation : {0.0, 2.0}) {
          const auto V = visibility(depth, makeConvolutionBasis(settings(order, correction, attenuation)), order % 3, points, 0.0f, bytes);
          for (float v : V) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << order << " " << v;
        }
}

TEST(ConvolutionShadow, ByteImagesCostAtMostTheirRounding) {
  // Each image is off by at most 1/254; cos a cos b + sin a sin b of two such errors by sqrt(2) times the weight: (sqrt(2) / 254) sum 2 / c_k.
  for (int order : {4, 8, 16}) {
    double bound = 0;
    for (int k = 1; k <= order; ++k) bound += std::sqrt(2.0) / 254 * 2 / (M_PI * (2 * k - 1));
    const ShadowBasisPtr basis = makeConvolutionBasis(settings(order));
    std::vector<Vec3> points;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) points.push_back({(float(x) + 0.5f) / 64, (float(y) + 0.5f) / 64, random01(48, uint64_t(y * 64 + x))});
    const TermPtr depth = depthMap(64, [](int x, int y) { return random01(49, uint64_t(y * 99 + x)); });
    const TermPtr floats = encodeBasis(depth, basis, 0), bytes = encodeBasis(depth, basis, 0, true);
    EXPECT_EQ(bytes->planes()[0].bytes.size() * 4, floats->planes()[0].bytes.size());
    double worst = 0, square = 0;
    std::vector<float> stored(size_t(basis->channels()));
    const auto b = bytes->plane<uint8_t>("B");
    const auto f = floats->floats("B");
    for (size_t t = 0; t < points.size(); ++t) {
      const size_t C = stored.size();
      for (size_t k = 0; k < C; ++k) stored[k] = formulas::csmFromByte(float(b[t * C + k]));
      float s, e;
      const float d = points[t].z;
      basis->reconstruct(stored.data(), 1, &d, &s, 1);
      basis->reconstruct(&f[t * C], 1, &d, &e, 1);
      worst = std::max(worst, std::fabs(double(s) - e));
      square += (double(s) - e) * (double(s) - e);
    }
    const double rms = std::sqrt(square / double(points.size()));
    std::cout << "M = " << order << ": bytes cost rms " << rms << ", at most " << worst << " (bound " << bound << ")" << std::endl;
    EXPECT_LE(worst, bound);
    EXPECT_GT(worst, 0.2 * bound);                // the comparison sees the rounding
    EXPECT_NEAR(rms, 0.00155, 0.00025) << order;  // digest 5.6: 0.0015 - 0.0016
  }
}

}  // namespace
