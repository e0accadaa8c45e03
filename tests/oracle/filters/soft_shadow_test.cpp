// SPDX-License-Identifier: Apache-2.0
// Soft shadow maps against closed forms: the ramp of parallel planes, brute-force means, limits in which two techniques must agree.
#include <gtest/gtest.h>

#include <bit>
#include <limits>
#include <map>

#include "filters/soft_shadow/convolution_soft_kernels.h"
#include "formulas/soft_shadow.glsl.h"
#include "oracle/filters/soft_shadow_cases.h"

namespace gobo {
namespace {

using namespace test;
using Soft = v1::ConvolutionSoftShadow;
using Hard = v1::ConvolutionShadow;

/// Digest 7.11: half-plane blocker x < 0 at linear depth 0.8 - gap over receivers at d = 10 m; what is not covered lies at the receivers' depth.
struct Ramp {
  explicit Ramp(float gap, float side = 1.0f, int resolution = 512) {
    c.size = Vec2(side);
    c.resolution = resolution;
    const float z = 0.8f - gap;
    c.depth = [z](float x, float) { return x < 0 ? z : 0.8f; };
    metres = 2 + 10 * z;
    width = side * (10 - metres) / metres;
    g = facingRow(301, -1.5f * width, 1.5f * width, 10);
  }
  double truth(size_t i) const { return std::clamp(0.5 + (double(i) / 300 - 0.5) * 3, 0.0, 1.0); }
  double rms(const TermPtr& V) const {
    return rmsDifference(V, [&](size_t i) { return truth(i); });
  }
  SoftCase c;
  float metres, width;
  TermPtr g;
};

double convolutionRamp(const Ramp& r, const SoftMaps& m, const TermPtr& sums, int order, Hard::Correction correction, Soft::Search search) {
  auto l = r.c.lookup<ConvolutionSoftLookup>();
  l.order = order;
  l.correction = correction;
  l.search = search;
  return r.rms(runFilter(makeConvolutionSoftNode(l), {r.g, m.bounds, sums}));
}

TEST(SoftShadowRamp, ConvolutionMapsFollowTheDigestsTable) {
  const float gaps[5] = {0.6f, 0.4f, 0.2f, 0.1f, 0.04f};
  struct Row {
    int order;
    Hard::Correction correction;
    double golden[5];
  };
  const Row rows[] = {{4, Hard::OFFSET, {.022, .003, .028, .211, .520}},           {4, Hard::SHIFTED_SCALING, {.011, .026, .046, .129, .475}},
                      {8, Hard::SHIFTED_SCALING, {.024, .011, .023, .044, .246}},  {16, Hard::OFFSET, {.001, .006, .009, .002, .008}},
                      {16, Hard::SHIFTED_SCALING, {.019, .015, .011, .022, .034}}, {16, Hard::NONE, {.33, .33, .33, .33, .33}}};
  for (int g = 0; g < 5; ++g) {
    const Ramp r(gaps[g]);
    const SoftMaps m(r.c);
    std::map<int, TermPtr> sums;
    for (const Row& row : rows) {
      if (!sums[row.order]) sums[row.order] = m.sums(row.order);
      for (Soft::Search search : {Soft::NEAR_PLANE, Soft::Z_MIN, Soft::ITERATED}) {
        const double e = convolutionRamp(r, m, sums[row.order], row.order, row.correction, search);
        std::printf("M=%d correction %d search %d gap %.2f: rms %.4f, digest %.3f\n", row.order, int(row.correction), int(search), double(gaps[g]), e,
                    row.golden[g]);
        // The digest's program reads the series as they are; taking out what one blocker and the plane read makes two depths exact.
        EXPECT_LT(e, std::min(row.golden[g] + 0.01, 0.012)) << row.order << " " << int(row.correction) << " gap " << gaps[g];
      }
    }
  }
}

TEST(SoftShadowRamp, ComparisonsGiveTheExactRamp) {
  // One blocker depth, parallel planes: percentage-closer soft shadows are exact up to the texels (1.4e-3 of tangent; ramps of 0.4 .. 0.004).
  for (float gap : {0.6f, 0.4f, 0.2f, 0.1f, 0.04f}) {
    const Ramp r(gap);
    const SoftMaps m(r.c);
    const double dense = r.rms(softDenseShadow(r.c, m, r.g));
    auto l = r.c.lookup<PercentageCloserSoftLookup>();
    const double taps = r.rms(runFilter(makePercentageCloserSoftNode(l), {r.g, m.bounds}));
    auto v = r.c.lookup<VarianceSoftLookup>();
    const double variance = r.rms(runFilter(makeVarianceSoftNode(v), {r.g, m.bounds, m.moments()}));
    auto x = r.c.lookup<ExponentialVarianceSoftLookup>();
    const double exponential = r.rms(runFilter(makeExponentialVarianceSoftNode(x), {r.g, m.bounds, m.exponentials(x)}));
    std::printf("gap %.2f: dense %.4f taps %.4f variance %.4f exponential variance %.4f\n", double(gap), dense, taps, variance, exponential);
    EXPECT_LT(dense, 0.005) << gap;
    EXPECT_LT(taps, 0.03) << gap;         // 64 taps of a shifted lattice across an edge
    EXPECT_LT(variance, 0.01) << gap;     // two depths: Chebyshev's bound is tight
    EXPECT_LT(exponential, 0.09) << gap;  // a tent on the chain's grid instead of a box (0.053 over all alignments, 0.08 on a grid line), bleeding reduction
  }
}

TEST(SoftShadowRamp, DistantLightsOfAnAngularSize) {
  SoftCase c;
  c.perspective = false;
  c.half = 4;
  c.near = -3;
  c.far = 7;
  c.size = Vec2(0.5f, 0.25f);
  c.depth = [](float x, float) { return x < 0 ? 0.2f : 0.8f; };  // 6 m apart: a ramp of 3 m
  const SoftMaps m(c);
  const TermPtr g = facingRow(301, -4, 4, 5);
  const auto V = softDenseShadow(c, m, g);
  const auto ramp = [](size_t i) { return std::clamp(0.5 + (-4 + 8.0 * double(i) / 300) / 3.0, 0.0, 1.0); };
  // Kernels that leave the map at its sides see only a part of the blocker or of the gap: 0.5 m of the row on either side.
  double worst = 0;
  for (size_t i = 20; i < 281; ++i) worst = std::max(worst, std::fabs(double(V->floats("V")[i]) - ramp(i)));
  EXPECT_LT(worst, 0.01);
  c.size = Vec2(0.0f);  // no width: the hard map with a kernel of one texel
  const auto hard = softDenseShadow(c, m, g);
  PercentageCloserLookup p{c.frames(), c.lookup<SoftLookup>().map, {}};
  p.map.slopeBias = 0;
  p.pattern = v1::PercentageCloserShadow::REGULAR;
  p.taps = 2;
  const auto filtered = runFilter(makePercentageCloserNode(p), {g, m.bounds});
  for (size_t i = 0; i < 301; ++i) ASSERT_NEAR(hard->floats("V")[i], filtered->floats("V")[i], 1e-6) << i;
}

TEST(SoftShadowRamp, WidthAndHeightOfRectanglesAreKeptApart) {
  for (float aspect : {1.0f, 2.0f, 4.0f, 8.0f}) {
    SoftCase c;
    c.size = Vec2(1.0f, 1.0f / aspect);
    for (bool alongX : {true, false}) {
      c.depth = [alongX](float x, float y) { return (alongX ? x : y) < 0 ? 0.4f : 0.8f; };
      const SoftMaps m(c);
      const double side = alongX ? 1 : 1 / aspect, width = side * 4 / 6;
      PlaneView v;
      v.width = 201;
      v.height = 1;
      v.du = float(2 * width / 200) * (alongX ? Vec3(1, 0, 0) : Vec3(0, 1, 0));
      v.origin = Vec3(0, 0, 10) - 100.0f * v.du;
      v.normal = Vec3(0, 0, -1);
      const TermPtr g = planeGBuffer(v);
      const auto ramp = [](size_t i) { return std::clamp(0.5 + (double(i) - 100) / 100, 0.0, 1.0); };
      auto l = c.lookup<ConvolutionSoftLookup>();
      l.order = 16;
      l.correction = Hard::OFFSET;
      const double boxes = rmsDifference(runFilter(makeConvolutionSoftNode(l), {g, m.bounds, m.sums(16)}), ramp);
      l.map.lookup = v1::ShadowMapSettings::TRILINEAR;
      const double chain = rmsDifference(runFilter(makeConvolutionSoftNode(l), {g, m.bounds, m.chain(16)}), ramp);
      std::printf("aspect %g along %c: dense %.4f, boxes %.4f, chain %.4f\n", double(aspect), alongX ? 'x' : 'y', rmsDifference(softDenseShadow(c, m, g), ramp),
                  boxes, chain);
      EXPECT_LT(rmsDifference(softDenseShadow(c, m, g), ramp), 0.01);
      EXPECT_LT(boxes, 0.015);  // table 7.11: 0.006 at this gap
      EXPECT_LT(chain, 0.09);   // tents on a grid of 2^l texels whose line the edge lies on
    }
  }
}

TEST(ConvolutionSoft, MeanBlockerDepthForEveryBlockedShare) {
  // Digest 7.3: with f(d = z) = 1 receivers count as nothing blocked, so that the mean is the blockers'; plain series are off by up to 0.8 gaps.
  for (int order : {4, 8, 16, 32})
    for (float gap : {0.2f, 0.4f})
      for (float p : {0.05f, 0.1f, 0.3f, 0.5f, 0.9f, 1.0f}) {
        const ConvolutionCorrection c = convolutionCorrection(Hard::OFFSET, order, 0);
        const ConvolutionParameters series{order, 0, float(c.scale), float(c.offset * (1 + 1.0 / order)), false};
        const float z[2] = {0.8f - gap, 0.8f}, d = 0.8f, zero = 0;
        std::vector<float> texels(2 * size_t(4 * order + 1)), mean(size_t(4 * order + 1));
        encodeConvolutionSoft(z, texels.data(), 2, order);
        for (size_t k = 0; k < mean.size(); ++k) mean[k] = p * texels[k] + (1 - p) * texels[mean.size() + k];
        float blocked, depth, s;
        convolutionBlockers(mean.data(), 1, &d, &zero, &zero, &blocked, &depth, 1, series);
        EXPECT_NEAR(depth / blocked, z[0], 0.01f * gap) << order << " " << gap << " " << p;
        // Second stage: the same series read as visibility.
        reconstructConvolution(mean.data(), 1, &d, &s, 1, series);
        EXPECT_NEAR(blocked, 1 - s, 1e-6) << order << " " << p;
        // The lit part has the rest of the mean depth.
        EXPECT_NEAR(depth + ((1 - blocked) * 0.8f + (blocked - p) * 0), p * z[0] + (1 - p) * 0.8f, 0.02f + std::fabs(blocked - p)) << order << " " << p;
      }
}

TEST(ConvolutionSoft, BlockersOfOrder256AreTheBruteForceMean) {
  // The series in double for a random depth distribution that keeps away from d: num / den tends to the mean of what lies in front.
  const int order = 256;
  const double d = 0.7, P = 1 + 1.0 / order, o = 0.613 / (2 * order) * P;
  double num = 0, den = 0, sum = 0, n = 0, all = 0, lit = 0;
  for (int i = 0; i < 400; ++i) {
    const double z = i % 2 ? 0.6 * toUnit(hash32(1, i)) : 0.78 + 0.2 * toUnit(hash32(2, i));
    double f = 0.5;
    for (int k = 1; k <= order; ++k) {
      const double c = M_PI * (2 * k - 1) / P;
      f -= 2 / (c * P) * std::sin(c * (z - d + o));
    }
    num += z * f;
    den += f;
    lit += z * (1 - f);
    all += z;
    if (z < d) {
      sum += z;
      ++n;
    }
  }
  EXPECT_NEAR(num / den, sum / n, 2e-3);
  EXPECT_NEAR(num + lit, all, 1e-9 * all);  // blocked and lit parts add up to the mean depth
}

TEST(ConvolutionSoft, ClosedFormOfATiltedPlanesOwnShadow) {
  // Means over a box of a plane that changes by x and y depth ranges from its centre to its sides, 400 x 400 points.
  const int order = 8;
  const ConvolutionCorrection c = convolutionCorrection(Hard::SHIFTED_SCALING, order, 0);
  const ConvolutionParameters series{order, 0, float(c.scale), float(c.offset * (1 + 1.0 / order)), false};
  for (float x : {0.0f, 0.02f, 0.1f, 0.25f})
    for (float y : {0.0f, 0.07f, 0.2f}) {
      const float d = 0.5f, shift = 0.01f, receiver = d - shift, zero = 0;
      std::vector<double> sum(size_t(4 * order + 1));
      std::vector<float> one(sum.size()), mean(sum.size());
      const int n = 400;
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          const float z = d + x * (2 * (float(i) + 0.5f) / float(n) - 1) + y * (2 * (float(j) + 0.5f) / float(n) - 1);
          encodeConvolutionSoft(&z, one.data(), 1, order);
          for (size_t k = 0; k < sum.size(); ++k) sum[k] += one[k];
        }
      for (size_t k = 0; k < sum.size(); ++k) mean[k] = float(sum[k] / (n * n));
      float blocked, depth, self, selfDepth;
      convolutionBlockers(mean.data(), 1, &receiver, &zero, &zero, &blocked, &depth, 1, series);
      convolutionSelf(&x, &y, &receiver, &shift, &self, &selfDepth, 1, series);
      EXPECT_NEAR(self, blocked, 2e-4) << x << " " << y;
      // depth still has the plane's (1 - blocked) share of `zero` in it: compare E[z fbar] itself.
      EXPECT_NEAR(selfDepth, depth, 4e-4) << x << " " << y;
    }
}

TEST(ConvolutionSoft, OrderThirtyTwoIsDensePercentageCloser) {
  // Random steps of depth: what is left is the series' own step width, 1 / (2 M) of the range, where blockers are that near to the receivers.
  SoftCase c;
  c.resolution = 256;
  c.depth = [](float x, float y) { return std::sin(40 * x) * std::sin(31 * y + 1) > 0.2f ? 0.3f + 0.2f * std::sin(9 * x + 5 * y) : 0.8f; };
  const SoftMaps m(c);
  PlaneView v;
  v.width = v.height = 48;
  v.origin = Vec3(-2, -2, 10);
  v.du = Vec3(4.0f / 47, 0, 0);
  v.dv = Vec3(0, 4.0f / 47, 0);
  v.normal = Vec3(0, 0, -1);
  const TermPtr g = planeGBuffer(v), dense = softDenseShadow(c, m, g);
  double before = 1;
  for (int order : {4, 8, 16, 32}) {
    auto l = c.lookup<ConvolutionSoftLookup>();
    l.order = order;
    l.correction = order == 4 ? Hard::SHIFTED_SCALING : Hard::OFFSET;
    const double e = rmsDifference(runFilter(makeConvolutionSoftNode(l), {g, m.bounds, m.sums(order)}), [&](size_t i) { return dense->floats("V")[i]; });
    std::printf("M=%d against dense comparison: rms %.4f\n", order, e);
    EXPECT_LT(e, before);
    before = e;
  }
  EXPECT_LT(before, 0.01);
  auto l = c.lookup<ConvolutionSoftLookup>();
  l.order = 16;
  l.correction = Hard::OFFSET;
  l.map.lookup = v1::ShadowMapSettings::TRILINEAR;
  const double chain = rmsDifference(runFilter(makeConvolutionSoftNode(l), {g, m.bounds, m.chain(16)}), [&](size_t i) { return dense->floats("V")[i]; });
  std::printf("M=16, mip chain: rms %.4f\n", chain);
  EXPECT_LT(chain, 0.09);  // thesis fig. 8.5: mip maps are visibly rougher than tables
  // Taps against every texel.
  auto p = c.lookup<PercentageCloserSoftLookup>();
  for (int taps : {16, 64, 1024}) {
    p.searchTaps = p.filterTaps = taps;
    const double e = rmsDifference(runFilter(makePercentageCloserSoftNode(p), {g, m.bounds}), [&](size_t i) { return dense->floats("V")[i]; });
    std::printf("%d taps: rms %.4f\n", taps, e);
    // Random taps: at most 1/2 over the root; 0.03: boxes that the probe drew together look at other blockers than the whole box does.
    EXPECT_LT(e, 0.6 / std::sqrt(double(taps)) + 0.03);
  }
}

TEST(ConvolutionSoft, LightsWithoutWidthCastTheFilteredHardShadow) {
  SoftCase c;
  c.size = Vec2(1e-6f);
  c.resolution = 128;
  c.depth = [](float x, float y) { return x + 0.3f * y < 0.02f ? 0.35f : 0.8f; };
  const SoftMaps m(c);
  const TermPtr g = facingRow(200, -1, 1, 10, 0.1f);
  auto l = c.lookup<ConvolutionSoftLookup>();
  l.order = 16;
  l.correction = Hard::OFFSET;
  const auto soft = runFilter(makeConvolutionSoftNode(l), {g, m.bounds, m.sums(16)});
  v1::ConvolutionShadow basis;
  basis.set_order(16);
  ShadowLookup h{c.frames(), l.map, {}};
  h.map.blur = 0;
  h.map.slopeBias = 0;
  const auto images = runFilter(makeShadowEncodeNode(makeConvolutionBasis(basis), 0, 128, 1, false), {m.map});
  const auto hard = runFilter(makeShadowLookupNode(makeConvolutionBasis(basis), h), {g, images});
  for (size_t i = 0; i < 200; ++i) ASSERT_NEAR(soft->floats("V")[i], hard->floats("V")[i], 0.012) << i;  // the gate's last 1 % and 2^-15 steps
}

TEST(ConvolutionSoft, SharpeningDarkensContactsAloneAndNothingWithoutStrength) {
  using formulas::softSharpen;
  for (float s = 0; s <= 1; s += 0.125f) {
    EXPECT_NEAR(softSharpen(s, 0.3f, 0, 20), s, 1e-6);     // A = 0: p = 1
    EXPECT_NEAR(softSharpen(s, 0.5f, 30, 1000), s, 1e-6);  // far from contact
    EXPECT_NEAR(softSharpen(s, 0, 1, 20), s * s, 2e-6);    // p = 2
  }
  const Ramp r(0.04f, 1, 256), far(0.4f, 1, 256);
  for (const Ramp* at : {&r, &far}) {
    const SoftMaps m(at->c);
    const TermPtr sums = m.sums(4);
    auto l = at->c.lookup<ConvolutionSoftLookup>();
    const auto plain = runFilter(makeConvolutionSoftNode(l), {at->g, m.bounds, sums});
    l.sharpening = 30;
    l.sharpeningExtent = 20;
    const auto sharp = runFilter(makeConvolutionSoftNode(l), {at->g, m.bounds, sums});
    const double change = rmsDifference(sharp, [&](size_t i) { return plain->floats("V")[i]; });
    EXPECT_TRUE(at == &r ? change > 0.1 : change < 0.01) << change;  // e^(-20 0.04) = 0.45: p = 14; e^(-20 0.4) = 3e-4
    for (size_t i = 0; i < 301; ++i) ASSERT_LE(sharp->floats("V")[i], plain->floats("V")[i] + 1e-6f);
  }
}

// --- all techniques ----------------------------------------------------------------------------------------------------------------

struct Technique {
  const char* name;
  std::function<TermPtr(const SoftCase&, const SoftMaps&, const TermPtr&, int threads)> run;
};
std::vector<Technique> techniques() {
  const auto comparisons = [](bool dense, bool skip) {
    return [=](const SoftCase& c, const SoftMaps& m, const TermPtr& g, int threads) {
      auto l = c.lookup<PercentageCloserSoftLookup>();
      l.dense = dense;
      l.skip = skip;
      return runFilter(makePercentageCloserSoftNode(l), {g, m.bounds}, threads);
    };
  };
  const auto convolution = [](int order, bool mips, Soft::Search search) {
    return [=](const SoftCase& c, const SoftMaps& m, const TermPtr& g, int threads) {
      auto l = c.lookup<ConvolutionSoftLookup>();
      l.order = order;
      l.search = search;
      if (mips) l.map.lookup = v1::ShadowMapSettings::TRILINEAR;
      return runFilter(makeConvolutionSoftNode(l), {g, m.bounds, mips ? m.chain(order) : m.sums(order)}, threads);
    };
  };
  const auto variance = [](bool subdivide) {
    return [=](const SoftCase& c, const SoftMaps& m, const TermPtr& g, int threads) {
      auto l = c.lookup<VarianceSoftLookup>();
      l.subdivide = subdivide;
      return runFilter(makeVarianceSoftNode(l), {g, m.bounds, m.moments()}, threads);
    };
  };
  return {{"dense", comparisons(true, true)},
          {"dense, no skip", comparisons(true, false)},
          {"taps", comparisons(false, true)},
          {"taps, no skip", comparisons(false, false)},
          {"convolution 4", convolution(4, false, Soft::Z_MIN)},
          {"convolution 16", convolution(16, false, Soft::Z_MIN)},
          {"convolution 4 near", convolution(4, false, Soft::NEAR_PLANE)},
          {"convolution 4 iterated", convolution(4, false, Soft::ITERATED)},
          {"convolution 4 chain", convolution(4, true, Soft::Z_MIN)},
          {"variance", variance(true)},
          {"variance, whole", variance(false)},
          {"exponential variance", [](const SoftCase& c, const SoftMaps& m, const TermPtr& g, int threads) {
             const auto l = c.lookup<ExponentialVarianceSoftLookup>();
             return runFilter(makeExponentialVarianceSoftNode(l), {g, m.bounds, m.exponentials(l)}, threads);
           }}};
}

/// Receivers all over: on a tilted plane that reaches beyond the map, behind the light and through it.
TermPtr scattered(int n) {
  PlaneView v;
  v.width = n;
  v.height = n;
  v.origin = Vec3(-6, -6, -1);
  v.du = Vec3(12.0f / float(n), 0, 0.02f);
  v.dv = Vec3(0, 12.0f / float(n), 13.0f / float(n));
  v.normal = glm::normalize(glm::cross(v.du, v.dv));
  if (v.normal.z > 0) v.normal = -v.normal;
  return planeGBuffer(v);
}

TEST(SoftShadows, StayInRangeWhateverTheMapHolds) {
  for (float half : {0.35f, 3.0f})
    for (float size : {0.0f, 0.3f, 50.0f}) {  // 50 m: every kernel is wider than the map
      SoftCase c;
      c.resolution = 33;
      c.half = half;
      c.near = half > 1 ? 0.0f : 2.0f;
      c.size = Vec2(size, 0.7f * size);
      c.depth = [](float x, float y) {
        const uint32_t h = hash32(uint64_t(std::bit_cast<uint32_t>(x)), std::bit_cast<uint32_t>(y));
        if (h % 11 == 0) return std::numeric_limits<float>::quiet_NaN();
        if (h % 11 == 1) return std::numeric_limits<float>::infinity();
        if (h % 11 == 2) return -3.0f;
        if (h % 11 == 3) return 7.0f;
        if (h % 11 == 4) return 0.0f;
        return toUnit(h);
      };
      const SoftMaps m(c);
      const TermPtr g = scattered(40);
      for (const Technique& t : techniques()) {
        const TermPtr V = t.run(c, m, g, 2);
        for (float s : V->floats("V")) ASSERT_TRUE(s >= 0 && s <= 1) << t.name << " half " << half << " size " << size << ": " << s;
      }
    }
}

TEST(SoftShadows, SameBitsForAnyNumberOfThreads) {
  SoftCase c;
  c.resolution = 64;
  c.depth = [](float x, float y) { return std::sin(20 * x) * std::cos(17 * y) > 0 ? 0.3f : 0.9f; };
  const SoftMaps m(c);
  const TermPtr g = scattered(70);
  for (const Technique& t : techniques()) EXPECT_EQ(t.run(c, m, g, 1)->content(), t.run(c, m, g, 5)->content()) << t.name;
}

TEST(SoftShadows, SkippingChangesNothing) {
  SoftCase c;
  c.resolution = 128;
  c.depth = [](float x, float y) { return x * x + y * y < 0.01f ? 0.2f : x > 0.1f ? 0.4f : 0.8f; };
  const SoftMaps m(c);
  const TermPtr g = scattered(64);
  const auto all = techniques();
  for (int k : {0, 2}) {
    const auto a = all[size_t(k)].run(c, m, g, 2), b = all[size_t(k) + 1].run(c, m, g, 2);
    EXPECT_EQ(a->content(), b->content()) << all[size_t(k)].name;
    int dark = 0, lit = 0;
    for (float s : a->floats("V")) {
      dark += s == 0;
      lit += s == 1;
    }
    EXPECT_GT(dark, 20);
    EXPECT_GT(lit, 20);
  }
}

TEST(SoftShadows, TiltedPlanesDoNotShadeThemselves) {
  // A plane that falls away from the light, its own depths in the map, nothing else: lit everywhere, at every tilt, for kernels of up to 100 texels
  // (digest 7.10; without softBlocks' plane test, the unmixing of Fourier maps or the variance maps' plane depth, half the kernel reads as blocked).
  for (float tilt : {0.0f, 0.5f, 1.0f, 2.0f, 4.0f}) {
    SoftCase c;
    c.resolution = 256;
    c.bias = 0.0005f;
    c.depth = [&](float x, float) { return 1 + tilt * x > 0.1f ? std::clamp((8 / (1 + tilt * x) - 2) / 10, 0.0f, 1.0f) : 1.0f; };  // Z + tilt X = 8
    const SoftMaps m(c);
    PlaneView v;
    v.width = 64;
    v.height = 5;
    v.origin = Vec3(-0.5f, -0.1f, 8 + 0.5f * tilt);
    v.du = Vec3(1.0f, 0, -tilt) / 63.0f;
    v.dv = Vec3(0, 0.05f, 0);
    v.normal = -glm::normalize(Vec3(tilt, 0, 1));
    const TermPtr g = planeGBuffer(v);
    for (const Technique& t : techniques()) {
      double least = 1;
      const TermPtr V = t.run(c, m, g, 2);
      for (float s : V->floats("V")) least = std::min(least, double(s));
      std::printf("tilt %g %s: least V %.4f\n", double(tilt), t.name, least);
      const bool exact = std::string_view(t.name).find("dense") == 0 || std::string_view(t.name).find("taps") == 0;
      // Bounds of the others: what was measured (0.78 at worst, variance at tilt 4) with a margin; without the guards 0.3 .. 0.6.
      EXPECT_TRUE(exact ? least == 1.0 : least > (tilt <= 1 ? 0.97 : 0.7)) << t.name << " tilt " << tilt << ": " << least;
    }
  }
}

TEST(SoftShadows, VisibilityIsOneBelowTheHorizonAndSplitsAtIt) {
  SoftCase c;
  c.depth = [](float, float) { return 0.0f; };  // everything blocked at the near plane
  const SoftMaps m(c);
  for (const Technique& t : techniques()) {
    auto g = facingRow(3, -0.1f, 0.1f, 10);
    auto N = g->writable<float>("N"), Ng = g->writable<float>("Ng");
    N[2] = Ng[2] = 1;  // turned away: the light cannot shine
    Ng[5] = 1;         // shading normal towards it on a surface that is not
    const TermPtr V = t.run(c, m, g, 1);
    EXPECT_EQ(V->floats("V")[0], 1.0f) << t.name;
    EXPECT_EQ(V->floats("V")[1], 0.0f) << t.name;
    EXPECT_EQ(V->floats("V")[2], 0.0f) << t.name;
  }
  // Nothing in the way, the light half below the horizon: what is above is all visible.
  c.depth = [](float, float) { return 1.0f; };
  const SoftMaps open(c);
  auto g = facingRow(1, 0, 0, 10);
  auto N = g->writable<float>("N"), Ng = g->writable<float>("Ng");
  N[0] = Ng[0] = 1;
  N[2] = Ng[2] = 0;
  for (const Technique& t : techniques()) EXPECT_EQ(t.run(c, open, g, 1)->floats("V")[0], 1.0f) << t.name;
}

TEST(MomentSums, AreExactForEveryBox) {
  SoftCase c;
  c.resolution = 61;
  c.depth = [](float x, float y) { return toUnit(hash32(std::bit_cast<uint32_t>(x), std::bit_cast<uint32_t>(y))); };
  const auto map = c.map();
  const auto sums = runFilter(makeMomentSumsNode(61, 1), {map});
  const MomentSums table(*sums, 61);
  const auto z = map->floats("z");
  for (int i = 0; i < 200; ++i) {
    const auto unit = [&](int k) { return toUnit(hash32(uint64_t(i), uint64_t(k))); };
    SoftBox b{60 * unit(0), 0, 60 * unit(1), 0};
    b.x1 = std::min(61.0f, b.x0 + 0.3f + 40 * unit(2));
    b.y1 = std::min(61.0f, b.y0 + 0.3f + 40 * unit(3));
    double m1 = 0, m2 = 0, area = 0;
    for (int y = 0; y < 61; ++y)
      for (int x = 0; x < 61; ++x) {
        const auto overlap = [](float lo, float hi, int at) { return std::max(0.0, std::min(double(hi), at + 1.0) - std::max(double(lo), double(at))); };
        const double w = overlap(b.x0, b.x1, x) * overlap(b.y0, b.y1, y);
        const double m = double(z[size_t(y) * 61 + size_t(x)]) - 0.5;
        m1 += w * m;
        m2 += w * m * m;
        area += w;
      }
    float first, second;
    table.box(0, b, first, second);
    ASSERT_NEAR(first, m1 / area, 1e-7);
    ASSERT_NEAR(second, m2 / area, 1e-7);
  }
}

}  // namespace
}  // namespace gobo
