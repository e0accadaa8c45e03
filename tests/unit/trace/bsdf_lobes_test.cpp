// SPDX-License-Identifier: Apache-2.0
// The lobes of the glTF extensions: densities against samples, unbiased weights, reciprocity, layering rules, delta lobes, extremes.
#include <gtest/gtest.h>

#include <vector>

#include "support/furnace.h"
#include "support/thorough.h"

namespace gobo::bsdf_lobes_test {
namespace {

using test::localDirection;
using test::Rng;

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
BsdfParams glass(float roughness) {
  BsdfParams p;
  p.albedo = Vec3(0.9f, 1.0f, 0.8f);
  p.transmission = 1;
  p.roughness = roughness;
  return p;
}
BsdfParams coated(BsdfParams p, float coat, float roughness, Vec3 normal = Vec3(0, 0, 1)) {
  p.clearcoat = coat;
  p.clearcoatRoughness = roughness;
  p.clearcoatNormal = glm::normalize(normal);
  return p;
}
BsdfParams cloth(BsdfParams p, Vec3 color, float roughness) {
  p.sheenColor = color;
  p.sheenRoughness = roughness;
  return p;
}
BsdfParams brushed(BsdfParams p, float a) {
  p.anisotropy = a;
  return p;
}
BsdfParams filmed(BsdfParams p, float thickness, float ior = 1.4f) {
  p.iridescence = 1;
  p.iridescenceThickness = thickness;
  p.iridescenceIor = ior;
  return p;
}
BsdfParams leaf(BsdfParams p, float d) {
  p.diffuseTransmission = d;
  p.diffuseTransmissionColor = Vec3(0.3f, 0.9f, 0.2f);
  return p;
}
BsdfParams thin(BsdfParams p) {
  p.thin = true;
  return p;
}
BsdfParams inside(BsdfParams p) {
  p.entering = false;
  return p;
}

struct Case {
  const char* name;
  BsdfParams p;
};
std::vector<Case> cases() {
  return {{"rough coat on metal", coated(metal(0.6f), 1, 0.4f)},
          {"tilted rough coat on plastic", coated(plastic(0.5f), 0.7f, 0.5f, Vec3(0.4f, -0.2f, 1))},
          {"smooth coat on metal", coated(metal(0.5f), 1, 0)},
          {"sheen 0.3", cloth(plastic(0.8f), Vec3(0.9f, 0.5f, 0.7f), 0.3f)},
          {"sheen 1 on metal", cloth(metal(0.5f), Vec3(0.5f), 1.0f)},
          {"anisotropic metal 0.8", brushed(metal(0.4f), 0.8f)},
          {"anisotropic glass 0.6", brushed(glass(0.5f), 0.6f)},
          {"film on metal", filmed(metal(0.4f), 420)},
          {"film on plastic", filmed(plastic(0.5f), 300, 1.8f)},
          {"film on glass from inside", inside(filmed(glass(0.5f), 500))},
          {"diffuse transmission", leaf(plastic(0.5f), 0.6f)},
          {"thin glass", thin(glass(0.5f))},
          {"glass without reflection",
           [] {
             BsdfParams p = glass(0.6f);
             p.specular = 0.2f;
             p.specularColor = Vec3(0.5f, 1, 2);
             return p;
           }()},
          {"glass inside ior 2.4",
           [] {
             BsdfParams p = inside(glass(0.8f));
             p.ior = 2.4f;
             return p;
           }()},
          {"coat over glass from inside", inside(coated(glass(0.5f), 1, 0.3f))},
          {"everything", coated(cloth(leaf(filmed(brushed(
                                                      [] {
                                                        BsdfParams p = plastic(0.5f);
                                                        p.metallic = 0.3f;
                                                        p.transmission = 0.3f;
                                                        p.thin = true;
                                                        return p;
                                                      }(),
                                                      0.4f),
                                                  350),
                                           0.4f),
                                      Vec3(0.4f), 0.5f),
                                0.6f, 0.3f)}};
}

bool draw(const BsdfParams& p, const Vec3& wo, Rng& rng, Vec3& wi) {
  BsdfSample s;
  const float lobe = rng.next();
  if (!bsdfSample(p, wo, lobe, rng.next2(), s) || s.delta) return false;
  wi = s.wi;
  return true;
}

TEST(BsdfLobes, ChiSquaredOfSamplesAgainstDensity) {
  const auto all = cases();
  double lowest = 1;
  int n = 0, run = 0;
  for (double c : {0.9, 0.35})
    for (const Case& k : all) {
      ++n;
      const bool steep = c > 0.5, even = n % 2 == 0;
      if (!testing::thorough() && steep == even) continue;  // each lobe at one of both angles
      ++run;
      const Vec3 wo = localDirection(c, 0.7);
      const auto r = test::chi2Test(
          {}, 30000, uint64_t(n), [&](Rng& rng, Vec3& w) { return draw(k.p, wo, rng, w); }, [&](const Vec3& w) { return double(bsdfPdf(k.p, wo, w)); }, 3);
      EXPECT_GT(r.p, test::sidak(2 * int(all.size())))
          << k.name << " cos " << c << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral << " refused " << r.refused;
      EXPECT_LE(r.integral, 1.0 + 2e-3) << k.name;
      lowest = std::min(lowest, r.p);
    }
  std::printf("  %d chi2 tests of layered and mixed lobes: lowest p %.4f\n", run, lowest);
}

TEST(BsdfLobes, MeanWeightEqualsIntegralOfTheFunction) {
  const int samples = testing::thoroughOr(20000, 8000);
  double worst = 0;
  for (const Case& k : cases()) {
    const Vec3 wo = localDirection(0.6, 0.7);
    const double truth = test::integrateSphere(
        {Vec3(0, 0, 1), 2.0, 12, 24}, [&](const Vec3& w) { return double(bsdfEval(k.p, wo, w).sum().y); }, 1e-5, 4);
    test::Moments m;
    Rng rng(23);
    for (int i = 0; i < samples; ++i) {
      BsdfSample s;
      const float lobe = rng.next();
      m.add(bsdfSample(k.p, wo, lobe, rng.next2(), s) && !s.delta ? s.weight.y : 0.0);
    }
    const double z = (m.mean() - truth) / (m.error() + 1e-3);
    EXPECT_LT(std::fabs(z), 4.0) << k.name << " mean " << m.mean() << " quadrature " << truth;
    worst = std::max(worst, std::fabs(z));
  }
  std::printf("  largest |z| of mean weight against quadrature: %.2f\n", worst);
}

TEST(BsdfLobes, ReflectionAndThinTransmissionAreReciprocal) {
  Rng rng(17);
  for (const Case& k : cases()) {
    // A coat with its own normal weighs light by that normal's cosine, like every shading normal (Veach 1997, 5.3).
    if (!k.p.entering || k.p.clearcoatNormal != Vec3(0, 0, 1)) continue;
    const bool through = k.p.thin || !(k.p.transmission > 0.0f);
    for (int i = 0; i < 200; ++i) {
      const Vec3 a = localDirection(0.1 + 0.89 * rng.next(), 6.28 * rng.next()), b = localDirection(0.1 + 0.89 * rng.next(), 6.28 * rng.next());
      for (float side : {1.0f, -1.0f}) {
        if (side < 0 && !through) continue;
        const Vec3 fab = bsdfEval(k.p, a, Vec3(b.x, b.y, side * b.z)).sum() / b.z;
        // Below: the same surface seen from its other side.
        const Vec3 fba = bsdfEval(k.p, b, Vec3(a.x, a.y, side * a.z)).sum() / a.z;
        if (side < 0 && k.p.clearcoat > 0) continue;
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(fab[c], fba[c], 1e-3f * (fab[c] + 1e-2f)) << k.name << " side " << side;
      }
    }
  }
}

TEST(BsdfLobes, CoatedGlassIsReciprocalThroughTheInterface) {
  Rng rng(3);
  const BsdfParams out = coated(cloth(glass(0.5f), Vec3(0.5f), 0.5f), 1, 0.3f), in = inside(out);
  int lit = 0;
  for (int i = 0; i < 400; ++i) {
    const Vec3 a = localDirection(0.05 + 0.94 * rng.next(), 6.28 * rng.next()), b = localDirection(0.05 + 0.94 * rng.next(), 6.28 * rng.next());
    const float fab = bsdfEval(out, a, Vec3(b.x, b.y, -b.z)).sum().y / b.z, fba = bsdfEval(in, b, Vec3(a.x, a.y, -a.z)).sum().y / a.z;
    lit += fab > 0;
    EXPECT_NEAR(fab * 2.25f, fba, 3e-3f * (fba + 1e-2f));
  }
  EXPECT_GT(lit, 300);
}

TEST(BsdfLobes, SmoothCoatIsADeltaLobeOverARoughBase) {
  const BsdfParams base = metal(0.5f), p = coated(base, 0.8f, 0);
  EXPECT_FALSE(bsdfIsDelta(p));
  EXPECT_TRUE(bsdfIsDelta(coated(metal(0), 1, 0)));
  EXPECT_FALSE(bsdfIsDelta(coated(metal(0), 1, 0.3f)));
  EXPECT_FALSE(bsdfIsDelta(cloth(metal(0), Vec3(0.1f), 0.5f)));
  EXPECT_FALSE(bsdfIsDelta(leaf(
      [] {
        BsdfParams q = plastic(0);
        q.albedo = Vec3(0.0f);
        return q;
      }(),
      0.5f)));
  EXPECT_TRUE(bsdfIsDelta(thin(glass(0))));
  EXPECT_TRUE(bsdfIsDelta(inside(coated(glass(0), 1, 0.5f))));  // the coat is on the other side
  const Vec3 wo = localDirection(0.6, 0.4);
  const double fresnel = 0.8 * (0.04 + 0.96 * std::pow(0.4, 5));
  double sum = 0;
  const int n = 4000;
  for (int i = 0; i < n; ++i) {
    BsdfSample s;
    if (!bsdfSample(p, wo, (float(i) + 0.5f) / n, Vec2(0.3f, 0.6f), s) || !s.delta) continue;
    EXPECT_EQ(s.pdf, 0.0f);
    EXPECT_NEAR(glm::length(s.wi - Vec3(-wo.x, -wo.y, wo.z)), 0.0f, 1e-6f);
    sum += s.weight.x;
  }
  EXPECT_NEAR(sum / n, fresnel, 2e-3);
  // What is below is dimmed by the larger of both Fresnel reflectances.
  const Vec3 wi = localDirection(0.3, 2.0);
  const float dim = 1.0f - 0.8f * (0.04f + 0.96f * std::pow(0.7f, 5.0f));
  EXPECT_NEAR(bsdfEval(p, wo, wi).sum().x, dim * bsdfEval(base, wo, wi).sum().x, 1e-5f);
}

TEST(BsdfLobes, ThinSmoothGlassPassesLightStraightOnTinted) {
  const BsdfParams p = thin(glass(0));
  const Vec3 wo = localDirection(0.5, 1.0);
  double through[3] = {0, 0, 0}, back = 0;
  const int n = 2000;
  for (int i = 0; i < n; ++i) {
    BsdfSample s;
    ASSERT_TRUE(bsdfSample(p, wo, (float(i) + 0.5f) / n, Vec2(0.5f), s));
    ASSERT_TRUE(s.delta);
    if (s.transmitted) {
      EXPECT_EQ(s.wi, -wo);
      for (int c = 0; c < 3; ++c) through[c] += s.weight[c];
    } else {
      back += s.weight.x;
    }
  }
  const double st = std::sqrt(0.75) / 1.5, ct = std::sqrt(1 - st * st), rs = (0.5 - 1.5 * ct) / (0.5 + 1.5 * ct), rp = (0.75 - ct) / (0.75 + ct);
  const double f = 0.5 * (rs * rs + rp * rp);
  EXPECT_NEAR(back / n, f, 2e-3);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(through[c] / n, (1 - f) * p.albedo[c], 2e-3);
  for (const Vec3& wi : {localDirection(0.4, 2), localDirection(0.9, 5)}) {  // seen from either side it is the same
    const BsdfParams rough = thin(glass(0.5f));
    EXPECT_EQ(bsdfEval(rough, wo, wi).sum(), bsdfEval(inside(rough), wo, wi).sum());
  }
}

TEST(BsdfLobes, SpecularFactorAndColourScaleTheDielectric) {
  BsdfParams p = plastic(0);
  p.albedo = Vec3(0.0f);
  p.specular = 0.5f;
  p.specularColor = Vec3(1, 2, 40);
  BsdfSample s;
  ASSERT_TRUE(bsdfSample(p, Vec3(0, 0, 1), 0.5f, Vec2(0.5f), s));
  EXPECT_NEAR(s.weight.x, 0.02f, 1e-6f);  // F0 = min(0.04 color, 1) specular
  EXPECT_NEAR(s.weight.y, 0.04f, 1e-6f);
  EXPECT_NEAR(s.weight.z, 0.5f, 1e-6f);
  ASSERT_TRUE(bsdfSample(p, localDirection(1e-4), 0.5f, Vec2(0.5f), s));
  EXPECT_NEAR(s.weight.x, 0.5f, 1e-3f);  // F90 = specular
  for (float ior : {0.0f, 1e9f}) {       // the infinite index
    BsdfParams q = glass(0);
    q.ior = ior;
    for (float u : {0.1f, 0.9f}) {
      ASSERT_TRUE(bsdfSample(q, localDirection(0.7), u, Vec2(0.5f), s));
      EXPECT_FALSE(s.transmitted);
      EXPECT_NEAR(s.weight.x, 1.0f, 1e-6f);
    }
  }
}

TEST(BsdfLobes, AnisotropyStretchesAlongX) {
  const BsdfParams p = brushed(metal(0.3f), 0.7f);
  const Vec3 wo(0, 0, 1);
  const float along = bsdfEval(p, wo, localDirection(0.8, 0)).sum().x, across = bsdfEval(p, wo, localDirection(0.8, 1.5708)).sum().x;
  EXPECT_GT(along, 5.0f * across);
  BsdfParams none = brushed(metal(0.3f), 1e-4f);
  EXPECT_NEAR(bsdfEval(none, wo, localDirection(0.9, 1)).specular.x, bsdfEval(metal(0.3f), wo, localDirection(0.9, 1)).specular.x, 0.05f);
}

/// Random and extreme parameters and directions: finite and never negative.
TEST(BsdfLobes, ExtremeInputsStayFinite) {
  const float cosines[] = {1.0f, 0.5f, 1e-2f, 1e-4f, 1e-7f, 1e-20f, 1e-38f, 1e-44f};
  const float edges[] = {0.0f, 1.0f, 0.03f, 0.5f, -1.0f, 2.0f, 1e-20f, std::nanf("")};
  Rng rng(78);
  const auto any = [&] { return edges[size_t(rng.next() * 8.0f)]; };
  int accepted = 0;
  for (float c : cosines)
    for (int k = 0; k < 4000; ++k) {
      BsdfParams p;
      p.albedo = Vec3(any(), any(), any());
      p.metallic = any();
      p.roughness = any();
      p.specular = any();
      p.transmission = k & 1 ? any() : 0.0f;
      p.ior = k % 5 ? 1.0f + rng.next() : any();
      p.entering = k & 2;
      p.thin = k & 4;
      p.specularColor = Vec3(any(), 10.0f * any(), 1);
      p.anisotropy = any();
      p.clearcoat = any();
      p.clearcoatRoughness = any();
      p.clearcoatNormal = k % 3 ? Vec3(any(), any(), any()) : Vec3(0, 0, 1);
      p.sheenColor = Vec3(any(), any(), 0);
      p.sheenRoughness = any();
      p.iridescence = any();
      p.iridescenceIor = 1.0f + any();
      p.iridescenceThickness = 1000.0f * any();
      p.diffuseTransmission = any();
      p.diffuseTransmissionColor = Vec3(any());
      const float s = std::sqrt(1.0f - c * c), phi = rng.next() * 6.28f;
      const Vec3 wo(s * std::cos(phi), s * std::sin(phi), c);
      BsdfSample sample;
      const Vec2 u = k & 8 ? Vec2(0.0f) : k & 16 ? Vec2(0x1.fffffep-1f) : rng.next2();
      if (bsdfSample(p, wo, k % 7 ? rng.next() : 0x1.fffffep-1f, u, sample)) {
        ++accepted;
        ASSERT_TRUE(isFinite(sample.wi) && isFinite(sample.weight) && std::isfinite(sample.pdf)) << k << " cos " << c;
        ASSERT_GE(std::min({sample.weight.x, sample.weight.y, sample.weight.z}), 0.0f) << k << " cos " << c;
        ASSERT_NEAR(glm::length(sample.wi), 1.0f, 1e-4f);
      }
      for (const Vec3& w : {localDirection(2.0 * rng.next() - 1.0, 6.28 * rng.next()), -wo, Vec3(-wo.x, -wo.y, wo.z), wo, Vec3(1, 0, 0), Vec3(0, 0, -1)}) {
        const Vec3 f = bsdfEval(p, wo, w).sum();
        const float pdf = bsdfPdf(p, wo, w);
        ASSERT_TRUE(isFinite(f) && std::isfinite(pdf)) << k << " cos " << c;
        ASSERT_GE(std::min({f.x, f.y, f.z, pdf}), 0.0f) << k << " cos " << c;
      }
    }
  EXPECT_GT(accepted, 8000);
}

}  // namespace
}  // namespace gobo::bsdf_lobes_test
