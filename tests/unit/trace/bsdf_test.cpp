// SPDX-License-Identifier: Apache-2.0
// Oracles: quadrature of the density and of the function, Helmholtz reciprocity, energy, Snell, Lambert's closed form.
#include "trace/bsdf.h"

#include <gtest/gtest.h>

#include <vector>

#include "support/chi2.h"
#include "support/thorough.h"

namespace gobo::bsdf_test {
namespace {

using test::Moments;
using test::Rng;
using test::SphereDomain;

Vec3 direction(double cosine, double phi) {
  const double s = std::sqrt(1.0 - cosine * cosine);
  return Vec3(float(s * std::cos(phi)), float(s * std::sin(phi)), float(cosine));
}

BsdfParams lambert(Vec3 albedo = Vec3(0.5f)) {
  BsdfParams p;
  p.albedo = albedo;
  p.specular = 0;
  return p;
}
BsdfParams metal(float roughness) {
  BsdfParams p;
  p.albedo = Vec3(0.9f, 0.6f, 0.3f);
  p.metallic = 1;
  p.roughness = roughness;
  return p;
}
BsdfParams plastic(float roughness) {
  BsdfParams p;
  p.albedo = Vec3(0.2f, 0.5f, 0.7f);
  p.roughness = roughness;
  return p;
}
BsdfParams glass(float roughness, bool entering, float ior = 1.5f) {
  BsdfParams p;
  p.albedo = Vec3(1.0f);
  p.roughness = roughness;
  p.transmission = 1;
  p.ior = ior;
  p.entering = entering;
  return p;
}
BsdfParams mixed() {
  BsdfParams p;
  p.albedo = Vec3(0.8f, 0.4f, 0.2f);
  p.metallic = 0.3f;
  p.roughness = 0.5f;
  p.transmission = 0.4f;
  return p;
}

struct Case {
  const char* name;
  BsdfParams p;
  double cosine;
};
std::vector<Case> roughCases() {
  std::vector<Case> cases;
  for (double c : {0.95, 0.5, 0.08}) {
    cases.push_back({"lambert", lambert(), c});
    cases.push_back({"metal 1", metal(1.0f), c});
    cases.push_back({"metal 0.5", metal(0.5f), c});
    cases.push_back({"metal 0.25", metal(0.25f), c});
    cases.push_back({"plastic 0.4", plastic(0.4f), c});
    cases.push_back({"glass 0.5 in", glass(0.5f, true), c});
    cases.push_back({"glass 0.5 out", glass(0.5f, false), c});
    cases.push_back({"glass 1 in", glass(1.0f, true), c});
    cases.push_back({"glass 0.4 ior 1.1", glass(0.4f, true, 1.1f), c});
    cases.push_back({"mixed", mixed(), c});
  }
  return cases;
}

/// Density of the accepted, non-delta directions only.
bool drawDirection(const BsdfParams& p, const Vec3& wo, Rng& rng, Vec3& wi) {
  BsdfSample s;
  const float lobe = rng.next();
  if (!bsdfSample(p, wo, lobe, rng.next2(), s) || s.delta) return false;
  wi = s.wi;
  return true;
}

TEST(Bsdf, ChiSquaredOfSamplesAgainstDensity) {
  const int samples = testing::thoroughOr(60000, 25000);
  const auto cases = roughCases();
  double lowest = 1, highest = 0;
  for (const Case& c : cases) {
    const Vec3 wo = direction(c.cosine, 0.7);
    const auto r = test::chi2Test(
        {}, samples, uint64_t(&c - cases.data()) + 100, [&](Rng& rng, Vec3& w) { return drawDirection(c.p, wo, rng, w); },
        [&](const Vec3& w) { return double(bsdfPdf(c.p, wo, w)); });
    EXPECT_GT(r.p, test::sidak(int(cases.size()))) << c.name << " cos " << c.cosine << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral
                                                   << " refused " << r.refused;
    EXPECT_LE(r.integral, 1.0 + 1e-3) << c.name;
    lowest = std::min(lowest, r.p);
    highest = std::max(highest, r.p);
  }
  std::printf("  chi2 p-values of %zu BSDF cases: %.4f .. %.4f\n", cases.size(), lowest, highest);
}

/// Lobes of milliradians, in a cone around the mirror or refracted direction.
TEST(Bsdf, ChiSquaredOfNarrowLobes) {
  double lowest = 1;
  const std::vector<float> roughnesses = {0.033f, 0.05f, 0.1f, 0.2f};
  for (float roughness : roughnesses) {
    const Vec3 wo = direction(0.7, 0.3);
    const Vec3 mirror(-wo.x, -wo.y, wo.z);
    const SphereDomain d{mirror, std::min(60.0 * std::pow(roughness, 4.0), 0.3), 16, 16};
    const BsdfParams p = metal(roughness);
    const auto r = test::chi2Test(
        d, 200000, uint64_t(1000 * roughness), [&](Rng& rng, Vec3& w) { return drawDirection(p, wo, rng, w); },
        [&](const Vec3& w) { return double(bsdfPdf(p, wo, w)); });
    EXPECT_GT(r.p, test::sidak(int(roughnesses.size()))) << roughness << " integral " << r.integral << " chi2 " << r.statistic << "/" << r.degrees;
    EXPECT_GT(r.integral, 0.9);
    lowest = std::min(lowest, r.p);
  }
  std::printf("  narrow lobes: lowest p %.4f\n", lowest);
}

TEST(Bsdf, DensityOfLambertIntegratesToOne) {
  for (double c : {1.0, 0.3}) {
    const BsdfParams p = lambert();
    const Vec3 wo = direction(c, 0);
    EXPECT_NEAR(test::integrateSphere({}, [&](const Vec3& w) { return double(bsdfPdf(p, wo, w)); }), 1.0, 1e-4);
  }
}

/// mean(weight) = integral of f cos: the estimator is unbiased for every lobe mixture.
TEST(Bsdf, MeanWeightEqualsIntegralOfTheFunction) {
  const auto cases = roughCases();
  double worst = 0;
  for (const Case& c : cases) {
    const Vec3 wo = direction(c.cosine, 0.7);
    const double truth = test::integrateSphere({}, [&](const Vec3& w) { return double(bsdfEval(c.p, wo, w).sum().x); });
    Moments m;
    Rng rng(23);
    for (int i = 0; i < 60000; ++i) {
      BsdfSample s;
      const float lobe = rng.next();
      m.add(bsdfSample(c.p, wo, lobe, rng.next2(), s) && !s.delta ? s.weight.x : 0.0);
    }
    const double z = (m.mean() - truth) / (m.error() + 1e-5);
    EXPECT_LT(std::fabs(z), 4.0) << c.name << " cos " << c.cosine << " mean " << m.mean() << " quadrature " << truth;
    worst = std::max(worst, std::fabs(z));
  }
  std::printf("  largest |z| of mean weight against quadrature: %.2f of %zu\n", worst, cases.size());
}

TEST(Bsdf, WeightIsFunctionOverDensity) {
  Rng rng(3);
  for (const Case& c : roughCases()) {
    const Vec3 wo = direction(c.cosine, 0.7);
    for (int i = 0; i < 200; ++i) {
      BsdfSample s;
      const float lobe = rng.next();
      if (!bsdfSample(c.p, wo, lobe, rng.next2(), s) || s.delta) continue;
      const Vec3 f = bsdfEval(c.p, wo, s.wi).sum();
      const float pdf = bsdfPdf(c.p, wo, s.wi);
      EXPECT_FLOAT_EQ(pdf, s.pdf);
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(s.weight[k], f[k] / pdf, 1e-4f * (1.0f + s.weight[k])) << c.name;
      EXPECT_NEAR(glm::length(s.wi), 1.0f, 1e-5f);
      EXPECT_EQ(s.transmitted, s.wi.z < 0.0f);
    }
  }
}

TEST(Bsdf, ReflectionIsReciprocal) {
  Rng rng(17);
  for (const BsdfParams& p : {lambert(), metal(0.3f), metal(1.0f), plastic(0.5f), mixed(), glass(0.5f, true)}) {
    for (int i = 0; i < 200; ++i) {
      const Vec3 a = direction(0.02 + 0.97 * rng.next(), 6.28 * rng.next()), b = direction(0.02 + 0.97 * rng.next(), 6.28 * rng.next());
      const Vec3 fab = bsdfEval(p, a, b).sum() / b.z, fba = bsdfEval(p, b, a).sum() / a.z;
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(fab[k], fba[k], 2e-4f * (fab[k] + 1e-3f));
    }
  }
}

TEST(Bsdf, RefractionIsReciprocalUpToEtaSquared) {
  Rng rng(18);
  int compared = 0;
  for (float ior : {1.1f, 1.5f, 2.4f}) {
    const BsdfParams in = glass(0.6f, true, ior), out = glass(0.6f, false, ior);
    for (int i = 0; i < 400; ++i) {
      const Vec3 a = direction(0.05 + 0.94 * rng.next(), 6.28 * rng.next());
      Vec3 b = direction(0.05 + 0.94 * rng.next(), 6.28 * rng.next());
      const float fab = bsdfEval(in, a, Vec3(b.x, b.y, -b.z)).sum().x / b.z;  // viewer outside
      const float fba = bsdfEval(out, Vec3(b.x, b.y, b.z), Vec3(a.x, a.y, -a.z)).sum().x / a.z;
      if (fab > 0) ++compared;
      EXPECT_NEAR(fab * ior * ior, fba, 2e-3f * (fba + 1e-3f)) << ior;
    }
  }
  EXPECT_GT(compared, 200);
}

TEST(Bsdf, LambertIsExact) {
  const BsdfParams p = lambert(Vec3(0.25f, 0.5f, 1.0f));
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 wo = direction(1.0 - rng.next(), rng.next() * 6.28);
    BsdfSample s;
    const float lobe = rng.next();
    ASSERT_TRUE(bsdfSample(p, wo, lobe, rng.next2(), s));
    EXPECT_EQ(s.weight, p.albedo);  // to the last bit
    EXPECT_EQ(bsdfEval(p, wo, s.wi).diffuse, p.albedo * (kInvPi * s.wi.z));
    EXPECT_EQ(bsdfEval(p, wo, s.wi).specular, Vec3(0.0f));
  }
}

double reflectance(const BsdfParams& p, const Vec3& wo, int samples) {
  double sum = 0;
  const float eta = p.entering ? p.ior : 1.0f / p.ior;
  for (int i = 0; i < samples; ++i) {
    SobolSampler u(4, uint32_t(i));
    BsdfSample s;
    const float lobe = u.next1D();
    if (bsdfSample(p, wo, lobe, u.next2D(), s)) sum += maxComponent(s.weight) * (s.transmitted ? eta * eta : 1.0f);
  }
  return sum / samples;
}

TEST(Bsdf, MirrorAndSmoothGlassLoseNothing) {
  for (double c : {1.0, 0.6, 0.1, 0.01}) {
    EXPECT_NEAR(reflectance(glass(0, true), direction(c, 1), 512), 1.0, 1e-5);
    EXPECT_NEAR(reflectance(glass(0, false), direction(c, 1), 512), 1.0, 1e-5);
    BsdfParams white = metal(0);
    white.albedo = Vec3(1.0f);
    EXPECT_NEAR(reflectance(white, direction(c, 1), 16), 1.0, 1e-6);
  }
}

TEST(Bsdf, SmoothGlassSplitsByFresnelAndBendsBySnell) {
  for (bool entering : {true, false}) {
    const BsdfParams p = glass(0, entering, 1.5f);
    const Vec3 wo = direction(0.8, 0.4);
    const double eta = entering ? 1.5 : 1 / 1.5, ci = 0.8, si = 0.6, st = si / eta, ct = std::sqrt(1 - st * st);
    const double rs = (ci - eta * ct) / (ci + eta * ct), rp = (eta * ci - ct) / (eta * ci + ct), F = 0.5 * (rs * rs + rp * rp);
    int reflected = 0;
    const int n = 4096;
    for (int i = 0; i < n; ++i) {
      BsdfSample s;
      ASSERT_TRUE(bsdfSample(p, wo, (float(i) + 0.5f) / n, Vec2(0.5f), s));
      EXPECT_TRUE(s.delta);
      EXPECT_EQ(s.pdf, 0.0f);
      if (s.transmitted) {
        EXPECT_NEAR(std::hypot(s.wi.x, s.wi.y), st, 1e-5);
        EXPECT_LT(glm::dot(Vec2(s.wi.x, s.wi.y), Vec2(wo.x, wo.y)), 0.0f);
        EXPECT_NEAR(s.weight.x, 1.0 / (eta * eta), 1e-4);
      } else {
        ++reflected;
        EXPECT_EQ(s.wi, Vec3(-wo.x, -wo.y, wo.z));
      }
    }
    EXPECT_NEAR(double(reflected) / n, F, 2.0 / n + 1e-4);
  }
}

TEST(Bsdf, BeyondTheCriticalAngleEverythingIsReflected) {
  const BsdfParams p = glass(0, false, 1.5f);
  for (float u : {0.0f, 0.5f, 0.9999999f}) {
    BsdfSample s;
    ASSERT_TRUE(bsdfSample(p, direction(0.3, 0), u, Vec2(0.3f), s));
    EXPECT_FALSE(s.transmitted);
    EXPECT_FLOAT_EQ(s.weight.x, 1.0f);
  }
}

TEST(Bsdf, EqualIndicesPassLightStraightThrough) {
  for (float roughness : {0.0f, 0.5f, 1.0f}) {
    const BsdfParams p = glass(roughness, true, 1.0f);
    EXPECT_TRUE(bsdfIsDelta(p));
    for (double c : {1.0, 0.5, 1e-3}) {
      const Vec3 wo = direction(c, 2);
      BsdfSample s;
      ASSERT_TRUE(bsdfSample(p, wo, 0.7f, Vec2(0.2f, 0.9f), s));
      EXPECT_EQ(s.wi, -wo);
      EXPECT_EQ(s.weight, Vec3(1.0f));
    }
  }
}

TEST(Bsdf, OpaqueSurfacesSendNothingBelowTheHorizon) {
  for (const BsdfParams& p : {lambert(), metal(0.5f), plastic(1.0f)}) {
    const Vec3 wo = direction(0.5, 0), below = Vec3(0.6f, 0, -0.8f);
    EXPECT_EQ(bsdfEval(p, wo, below).sum(), Vec3(0.0f));
    EXPECT_EQ(bsdfPdf(p, wo, below), 0.0f);
    EXPECT_EQ(bsdfEval(p, below, wo).sum(), Vec3(0.0f));
  }
}

TEST(Bsdf, DeltaMeansThatNothingCanBeEvaluated) {
  EXPECT_TRUE(bsdfIsDelta(metal(0)));
  EXPECT_TRUE(bsdfIsDelta(glass(0, true)));
  EXPECT_FALSE(bsdfIsDelta(metal(0.1f)));
  EXPECT_FALSE(bsdfIsDelta(plastic(0)));  // its diffuse lobe
  const Vec3 wo = direction(0.5, 0);
  EXPECT_EQ(bsdfEval(metal(0), wo, Vec3(-wo.x, -wo.y, wo.z)).sum(), Vec3(0.0f));
  EXPECT_EQ(bsdfPdf(metal(0), wo, Vec3(-wo.x, -wo.y, wo.z)), 0.0f);
}

/// Random and extreme parameters and directions: finite, never negative, weights bounded by the lobe floor of a tenth.
TEST(Bsdf, ExtremeInputsStayFinite) {
  const float cosines[] = {1.0f, 0.5f, 1e-2f, 1e-4f, 1e-7f, 1e-20f, 1e-38f, 1e-44f, 0.0f, -0.5f};
  const float roughnesses[] = {0.0f, 0.0316f, 0.0317f, 0.2f, 1.0f, 2.0f, -1.0f};
  const float iors[] = {1.0f, 1.0009f, 1.0011f, 1.5f, 3.0f, 0.7f, 0.0f, 1e9f};
  Rng rng(77);
  int accepted = 0;
  for (float c : cosines)
    for (float roughness : roughnesses)
      for (float ior : iors)
        for (int k = 0; k < 40; ++k) {
          BsdfParams p;
          p.albedo = k & 1 ? Vec3(1.0f) : Vec3(0.0f, rng.next(), 1e-6f);
          p.metallic = float(k % 3) * 0.5f;
          p.transmission = float(k % 4) / 3.0f;
          p.roughness = roughness;
          p.ior = ior;
          p.specular = k & 2 ? 1.0f : 0.0f;
          p.entering = k & 4;
          const float s = std::sqrt(1.0f - c * c), phi = rng.next() * 6.28f;
          const Vec3 wo(s * std::cos(phi), s * std::sin(phi), c);
          BsdfSample sample;
          const float lobe = k < 4 ? 0x1.fffffep-1f : rng.next();
          const Vec2 u = k & 8 ? Vec2(0.0f) : k & 16 ? Vec2(0x1.fffffep-1f) : rng.next2();
          if (bsdfSample(p, wo, lobe, u, sample)) {
            ++accepted;
            ASSERT_TRUE(isFinite(sample.wi) && isFinite(sample.weight) && std::isfinite(sample.pdf));
            ASSERT_GE(std::min({sample.weight.x, sample.weight.y, sample.weight.z}), 0.0f);
            const float eta = 1.0f / std::fmin(std::fmax(ior, 0.1f), 10.0f);
            const float scale = sample.transmitted ? std::fmax(1.0f, std::fmax(eta * eta, 1.0f / (eta * eta))) : 1.0f;
            // A lobe chosen by luminance may be 14 times as strong in blue.
            ASSERT_LE(maxComponent(sample.weight), 14.0f * 11.0f * scale) << "cos " << c << " roughness " << roughness << " ior " << ior;
          }
          const Vec3 wi = direction(2.0 * rng.next() - 1.0, 6.28 * rng.next());
          for (const Vec3& w : {wi, -wo, Vec3(-wo.x, -wo.y, wo.z), wo, Vec3(0, 0, 1), Vec3(1, 0, 0)}) {
            const Vec3 f = bsdfEval(p, wo, w).sum();
            const float pdf = bsdfPdf(p, wo, w);
            ASSERT_TRUE(isFinite(f) && std::isfinite(pdf)) << "cos " << c << " roughness " << roughness << " ior " << ior;
            ASSERT_GE(std::min({f.x, f.y, f.z, pdf}), 0.0f);
          }
        }
  EXPECT_GT(accepted, 5000);
}

TEST(Bsdf, EvalPdfIsEvalAndPdfToTheBit) {
  const auto unit = [](uint64_t a, uint64_t b) { return toUnit(hash32(a, b)); };
  int lit = 0;
  for (uint64_t i = 0; i < 20000; ++i) {
    BsdfParams p;
    p.albedo = Vec3(unit(1, i), unit(2, i), unit(3, i));
    p.metallic = i % 3 ? 0.0f : unit(4, i);
    p.roughness = i % 11 ? unit(5, i) : 0.0f;
    p.specular = i % 5 ? unit(6, i) : 0.0f;
    p.transmission = i % 4 ? 0.0f : unit(7, i);
    p.ior = 1.0f + unit(8, i);
    p.entering = i % 2;
    const Vec3 wo = glm::normalize(Vec3(unit(9, i) - 0.5f, unit(10, i) - 0.5f, unit(11, i))),
               wi = glm::normalize(Vec3(unit(12, i), unit(13, i), unit(14, i)) - 0.5f);
    float pdf = -1.0f;
    const BsdfValue both = bsdfEvalPdf(p, wo, wi, pdf), alone = bsdfEval(p, wo, wi);
    ASSERT_EQ(both.diffuse, alone.diffuse);
    ASSERT_EQ(both.specular, alone.specular);
    ASSERT_EQ(pdf, bsdfPdf(p, wo, wi));
    lit += pdf > 0.0f;
  }
  EXPECT_GT(lit, 5000);
}

}  // namespace
}  // namespace gobo::bsdf_test
