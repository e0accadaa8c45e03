// SPDX-License-Identifier: Apache-2.0
// The framework of filterable shadow maps (Annen 2008, ch. 5): filtering basis images is filtering the test. Commutation, shift
// invariance and linearity, each against sums in double; and the negative control: a blurred depth map stays binary.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

v1::ConvolutionShadow convolution(uint32_t order, v1::ConvolutionShadow::Correction correction = v1::ConvolutionShadow::OFFSET) {
  v1::ConvolutionShadow m;
  m.set_order(order);
  m.set_correction(correction);
  return m;
}

struct Family {
  const char* name;
  ShadowBasisPtr basis;
  double scale;
};  // scale: largest |basis value| that sums meet
std::vector<Family> linearInTheBasis() {
  return {{"exponential 20", makeExponentialBasis(20, false), 1},
          {"exponential 80", makeExponentialBasis(80, false), 1},
          {"convolution 4", makeConvolutionBasis(convolution(4)), 1},
          {"convolution 16", makeConvolutionBasis(convolution(16)), 1},
          {"convolution 32 scaled", makeConvolutionBasis(convolution(32, v1::ConvolutionShadow::SCALING)), 1}};
}
std::vector<Family> everyBasis() {
  auto list = linearInTheBasis();
  list.push_back({"exponential 500, logarithmic", makeExponentialBasis(500, true), 1});
  list.push_back({"variance", makeVarianceBasis({}), 1});
  list.push_back({"exponential variance", makeExponentialVarianceBasis(40, 10, 1e-6f, 0.1f), 1});
  list.push_back({"exponential variance 42", makeExponentialVarianceBasis(42, 42, 1e-6f, 0.0f), 1});
  list.push_back({"moment", makeMomentBasis({}), 1});
  return list;
}

std::vector<float> encoded(const ShadowBasis& b, float z) {
  std::vector<float> v(size_t(b.channels()));
  b.encode(&z, v.data(), 1);
  return v;
}
float reconstructed(const ShadowBasis& b, const std::vector<float>& v, float d) {
  float s;
  b.reconstruct(v.data(), 1, &d, &s, 1);
  return s;
}

// Filter and reconstruct == the kernel's mean of single reconstructions (eq. 5.8). The bound is float's: sums of channels of at most 1.
TEST(ShadowBasis, FilteringTheBasisIsFilteringTheTest) {
  const int size = 24;
  const auto z = [](int x, int y) { return 0.1f + 0.4f * random01(21, uint64_t(y * 100 + x)); };
  for (const Family& f : linearInTheBasis())
    for (int blur : {0, 1, 4}) {
      const TermPtr map = encodeBasis(depthMap(size, z), f.basis, blur);
      const auto B = values(map, "B");
      const std::vector<double> w = gaussian(blur);
      const int C = f.basis->channels();
      double worst = 0;
      for (int y = 0; y < size; y += 5)
        for (int x = 0; x < size; x += 3) {
          const float d = 0.5f + 0.3f * random01(22, uint64_t(y * 100 + x));  // behind every texel: the exponential stays within [0,1]
          double sum = 0;
          for (int j = -blur; j <= blur; ++j)
            for (int i = -blur; i <= blur; ++i)
              sum += w[size_t(i + blur)] * w[size_t(j + blur)] *
                     reconstructed(*f.basis, encoded(*f.basis, z(std::clamp(x + i, 0, size - 1), std::clamp(y + j, 0, size - 1))), d);
          const size_t at = (size_t(y) * size + size_t(x)) * size_t(C);
          worst = std::max(worst, std::fabs(reconstructed(*f.basis, {B.begin() + long(at), B.begin() + long(at) + C}, d) - sum));
        }
      EXPECT_LT(worst, 5e-6) << f.name << " blur " << blur;
    }
}

TEST(ShadowBasis, OnlyDepthDifferencesMatter) {
  // Truncation error depends on d - z alone. Not so for the exponential variance bound, whose two warps
  // differ in slope, nor for four moments, whose bias pulls towards the middle of the range.
  std::vector<Family> list = linearInTheBasis();
  list.push_back({"variance", makeVarianceBasis({}), 1});
  for (const Family& f : list) {
    double worst = 0;
    for (int i = 0; i < 200; ++i) {
      const float a = 0.3f * random01(23, uint64_t(i)), b = 0.3f * random01(24, uint64_t(i)), d = std::max(a, b) + 0.2f * random01(25, uint64_t(i)) + 0.01f;
      const auto mean = [&](float t) {
        auto u = encoded(*f.basis, a + t), v = encoded(*f.basis, b + t);
        for (size_t k = 0; k < u.size(); ++k) u[k] = 0.25f * u[k] + 0.75f * v[k];
        return reconstructed(*f.basis, u, d + t);
      };
      // Powers of two: the sums a + t round by at most 2^-25; times the exponent or 2 pi M that is below the bounds.
      for (float t : {0.125f, 0.25f, 0.375f}) worst = std::max(worst, double(std::fabs(mean(t) - mean(0.0f))));
    }
    EXPECT_LT(worst, std::string(f.name) == "variance" ? 2e-4 : 3e-5) << f.name;
  }
}

TEST(ShadowBasis, MixtureOfKernelsIsMixtureOfShadows) {
  const int size = 20;
  const auto z = [](int x, int y) { return 0.1f + 0.4f * random01(26, uint64_t(y * 100 + x)); };
  for (const Family& f : linearInTheBasis()) {
    const auto a = values(encodeBasis(depthMap(size, z), f.basis, 1), "B"), b = values(encodeBasis(depthMap(size, z), f.basis, 5), "B");
    const size_t C = size_t(f.basis->channels());
    for (size_t t = 0; t < size_t(size) * size; t += 7) {
      std::vector<float> u(C), v(C), mix(C);
      for (size_t k = 0; k < C; ++k) {
        u[k] = a[t * C + k];
        v[k] = b[t * C + k];
        mix[k] = 0.3f * u[k] + 0.7f * v[k];
      }
      const float d = 0.55f;
      EXPECT_NEAR(reconstructed(*f.basis, mix, d), 0.3 * reconstructed(*f.basis, u, d) + 0.7 * reconstructed(*f.basis, v, d), 5e-6) << f.name;
    }
  }
}

TEST(ShadowBasis, BlurredDepthStaysBinary) {
  // w * f(d, z) is not f(d, w * z) (eq. 5.5): blurring depth moves the edge and leaves it hard, comparing and then blurring softens it.
  const int size = 64, blur = 5;
  const auto z = [&](int x, int) { return x < size / 2 ? 0.3f : 0.7f; };
  const std::vector<double> w = gaussian(blur);
  const TermPtr depth = depthMap(size, z), blurred = depthMap(size, [&](int x, int y) {
                                             double sum = 0;
                                             for (int i = -blur; i <= blur; ++i) sum += w[size_t(i + blur)] * z(std::clamp(x + i, 0, size - 1), y);
                                             return float(sum);
                                           });
  std::vector<Vec3> points;
  for (int i = 0; i < 400; ++i) points.push_back({0.3f + 0.4f * float(i) / 400, 0.5f, 0.65f});
  PercentageCloserLookup hard = unitComparison(size, v1::PercentageCloserShadow::REGULAR, 1);
  hard.hard = true;
  int between = 0;
  for (float v : compare(blurred, hard, receivers(points))) EXPECT_TRUE(v == 0.0f || v == 1.0f) << v;
  for (float v : compare(depth, unitComparison(size, v1::PercentageCloserShadow::GAUSSIAN, blur), receivers(points))) between += v > 0.05f && v < 0.95f;
  EXPECT_GT(between, 50);
  // The blurred map's edge moved: not to where half of the kernel is lit.
  const auto moved = compare(blurred, hard, receivers({{0.5f + 3.0f / size, 0.5f, 0.65f}, {0.5f + 0.5f / size, 0.5f, 0.65f}}));
  EXPECT_EQ(moved[0], 1.0f);
  EXPECT_EQ(moved[1], 0.0f);
}

constexpr float kBasisNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kBasisInf = std::numeric_limits<float>::infinity();

TEST(ShadowBasis, DamagedDepthCountsAsNothingHitInEveryBasis) {
  // A NaN that entered a warp would spread over the whole kernel and every coarser level (playcanvas/engine#7480).
  for (const Family& f : everyBasis())
    for (float bad : {kBasisNan, kBasisInf, -kBasisInf, 1e31f}) {
      const auto z = [](int x, int y) { return 0.2f + 0.5f * random01(27, uint64_t(y * 50 + x)); };
      const auto damaged = [&](int x, int y) { return x == 9 && y == 11 ? bad : z(x, y); };
      const auto repaired = [&](int x, int y) { return x == 9 && y == 11 ? 1.0f : z(x, y); };
      EXPECT_EQ(values(encodeBasis(depthMap(20, damaged), f.basis, 3), "B"), values(encodeBasis(depthMap(20, repaired), f.basis, 3), "B"))
          << f.name << " " << bad;
    }
}

TEST(ShadowBasis, EveryValueIsFiniteAndEveryVisibilityWithinZeroAndOne) {
  // Depth at the ends of its range and between, receivers in and far out of it; values that no encoder makes as well.
  std::vector<Vec3> points;
  for (int i = 0; i < 3000; ++i)
    points.push_back({random01(31, uint64_t(i)), random01(32, uint64_t(i)), i % 7 ? random01(33, uint64_t(i)) : 3.0f * random01(33, uint64_t(i)) - 1.0f});
  points[0].z = kBasisNan;
  points[1].z = kBasisInf;
  points[2].z = -kBasisInf;
  points[3].z = 1e30f;
  const int size = 40;
  const TermPtr depth = depthMap(size, [](int x, int y) {
    const float r = random01(34, uint64_t(x * 999 + y));
    return (x + y) % 3 == 0 ? 1.0f : (x + y) % 7 == 0 ? 0.0f : r;
  });
  for (const Family& f : everyBasis()) {
    for (int blur : {0, 2, 64}) {
      const TermPtr map = encodeBasis(depth, f.basis, blur);
      for (float b : map->floats("B")) ASSERT_TRUE(std::isfinite(b) && std::fabs(b) <= 1.0f + 1e-5f) << f.name << " " << b;
      for (float v : values(lookupBasis(receivers(points), map, f.basis, unitLookup(size, blur)), "V"))
        ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << f.name << " " << v;
    }
    for (float broken : {kBasisNan, kBasisInf, -kBasisInf, 1e30f, -1e30f, 0.0f}) {
      const TermPtr map = basisMap(size, f.basis->channels(), [&](int x, int y, int k) {
        return (x + 3 * y + k) % 5 == 0 ? broken : 2.0f * random01(35, uint64_t(x * 777 + y * 31 + k)) - 1.0f;
      });
      for (float v : values(lookupBasis(receivers(points), map, f.basis, unitLookup(size)), "V"))
        ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << f.name << " " << broken << " " << v;
    }
  }
}

TEST(ShadowBasis, SameBitsForAnyNumberOfThreads) {
  using Settings = v1::ShadowMapSettings;
  const int size = 150;
  const TermPtr depth = depthMap(size, [](int x, int y) { return random01(36, uint64_t(y / 3 * 500 + x / 3)); });
  std::vector<Vec3> points;
  for (int i = 0; i < 30000; ++i) points.push_back({random01(37, uint64_t(i)), random01(38, uint64_t(i)), random01(39, uint64_t(i))});
  const TermPtr g = receivers(points, glm::normalize(Vec3(0.3f, 0.1f, -1)), 0.02f);
  EXPECT_EQ(depthBounds(depth, 1)->content(), depthBounds(depth, 7)->content());
  for (const Family& f : everyBasis()) {
    const TermPtr one = encodeBasis(depth, f.basis, 3, false, 1), seven = encodeBasis(depth, f.basis, 3, false, 7);
    EXPECT_EQ(one->content(), seven->content()) << f.name;
    for (const auto lookup : {Settings::BILINEAR, Settings::TRILINEAR, Settings::ANISOTROPIC, Settings::SUMMED_AREA}) {
      if (lookup == Settings::SUMMED_AREA && !f.basis->bounded()) continue;
      const auto run = [&](int threads) {
        TermPtr map = one;
        if (lookup == Settings::TRILINEAR || lookup == Settings::ANISOTROPIC) map = runNode(makeShadowMipmapNode(f.basis, size, 1, false), {one}, threads);
        if (lookup == Settings::SUMMED_AREA) map = runNode(makeShadowSummedAreaNode(f.basis, size, 1), {one}, threads);
        ShadowLookup l = unitLookup(size, 3);
        l.map.lookup = lookup;
        l.map.slopeBias = 1.0f;
        return lookupBasis(g, map, f.basis, l, nullptr, threads)->content();
      };
      EXPECT_EQ(run(1), run(7)) << f.name << " lookup " << int(lookup);
    }
  }
  for (const auto pattern : {v1::PercentageCloserShadow::REGULAR, v1::PercentageCloserShadow::POISSON, v1::PercentageCloserShadow::GAUSSIAN}) {
    const PercentageCloserLookup l = unitComparison(size, pattern, 5);
    EXPECT_EQ(compare(depth, l, g, 1), compare(depth, l, g, 7)) << int(pattern);
  }
}

TEST(ShadowBasis, KeysFollowEveryParameterThatMatters) {
  const auto digest = [](const NodePtr& n) {
    Hasher h(n->type());
    n->hashParameters(h);
    return h.digest();
  };
  const auto encodeKey = [&](const ShadowBasisPtr& b, int blur = 1, bool bytes = false) { return digest(makeShadowEncodeNode(b, blur, 64, 1, bytes)); };
  const auto lookupKey = [&](const ShadowBasisPtr& b, const ShadowLookup& l) { return digest(makeShadowLookupNode(b, l)); };
  v1::VarianceShadow v, cut, floor;
  cut.set_bleeding_reduction(0.5);
  floor.set_min_variance(1e-3);
  const ShadowLookup l = unitLookup(64, 1);
  // Sliders behind the filter change the lookup alone: the map stays.
  EXPECT_EQ(encodeKey(makeVarianceBasis(v)), encodeKey(makeVarianceBasis(cut)));
  EXPECT_EQ(encodeKey(makeVarianceBasis(v)), encodeKey(makeVarianceBasis(floor)));
  EXPECT_NE(lookupKey(makeVarianceBasis(v), l), lookupKey(makeVarianceBasis(cut), l));
  EXPECT_NE(lookupKey(makeVarianceBasis(v), l), lookupKey(makeVarianceBasis(floor), l));
  v1::ConvolutionShadow damped = convolution(8);
  damped.set_attenuation(1);
  EXPECT_EQ(encodeKey(makeConvolutionBasis(convolution(8))), encodeKey(makeConvolutionBasis(damped)));
  EXPECT_EQ(encodeKey(makeConvolutionBasis(convolution(8))), encodeKey(makeConvolutionBasis(convolution(8, v1::ConvolutionShadow::SCALING))));
  EXPECT_NE(lookupKey(makeConvolutionBasis(convolution(8)), l), lookupKey(makeConvolutionBasis(damped), l));
  EXPECT_NE(lookupKey(makeConvolutionBasis(convolution(8)), l), lookupKey(makeConvolutionBasis(convolution(8, v1::ConvolutionShadow::SCALING)), l));
  EXPECT_NE(encodeKey(makeConvolutionBasis(convolution(8))), encodeKey(makeConvolutionBasis(convolution(9))));
  EXPECT_NE(encodeKey(makeConvolutionBasis(convolution(8))), encodeKey(makeConvolutionBasis(convolution(8)), 2));
  EXPECT_NE(encodeKey(makeConvolutionBasis(convolution(8))), encodeKey(makeConvolutionBasis(convolution(8)), 1, true));
  EXPECT_NE(encodeKey(makeExponentialBasis(40, false)), encodeKey(makeExponentialBasis(40, true)));
  EXPECT_NE(encodeKey(makeExponentialVarianceBasis(40, 10, 1e-6f, 0.1f)), encodeKey(makeExponentialVarianceBasis(40, 11, 1e-6f, 0.1f)));
  EXPECT_EQ(encodeKey(makeExponentialVarianceBasis(40, 10, 1e-6f, 0.1f)), encodeKey(makeExponentialVarianceBasis(40, 10, 1e-5f, 0.2f)));
  v1::MomentShadow m, biased;
  biased.set_moment_bias(1e-4);
  EXPECT_EQ(encodeKey(makeMomentBasis(m)), encodeKey(makeMomentBasis(biased)));
  EXPECT_NE(lookupKey(makeMomentBasis(m), l), lookupKey(makeMomentBasis(biased), l));
  // Two bases with the same numbers are not the same node.
  EXPECT_NE(encodeKey(makeVarianceBasis(v)), encodeKey(makeMomentBasis(m)));
  for (const auto& change : std::vector<std::function<void(ShadowLookup&)>>{
           [](ShadowLookup& k) { k.map.bias = 0.1f; }, [](ShadowLookup& k) { k.map.lookup = v1::ShadowMapSettings::TRILINEAR; },
           [](ShadowLookup& k) { k.classification = v1::ExponentialShadow::Z_MAX; }, [](ShadowLookup& k) { k.frames.face[0].far = 2; }}) {
    ShadowLookup k = l;
    change(k);
    EXPECT_NE(lookupKey(makeExponentialBasis(40, false), l), lookupKey(makeExponentialBasis(40, false), k));
  }
  ShadowLookup z = l, e = l;
  z.classification = e.classification = v1::ExponentialShadow::Z_MAX;
  e.epsilon = 0.1f;
  EXPECT_NE(lookupKey(makeExponentialBasis(40, false), z), lookupKey(makeExponentialBasis(40, false), e));
  e = z;
  e.fallbackKernel = false;
  EXPECT_NE(lookupKey(makeExponentialBasis(40, false), z), lookupKey(makeExponentialBasis(40, false), e));
}

}  // namespace
