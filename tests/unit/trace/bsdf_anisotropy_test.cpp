// SPDX-License-Identifier: Apache-2.0
// Two alphas in a white furnace: brushed metal and brushed glass at albedo 1 lose less than 2 % and gain nothing, over roughness,
// strength, angle and azimuth; their bounced light is reciprocal and its sampling weights are bounded.
#include <gtest/gtest.h>

#include "support/furnace.h"

namespace gobo::bsdf_anisotropy_test {
namespace {

using test::Furnace;
using test::localDirection;

struct Model {
  const char* name;
  bool glass, entering, thin;
  float ior;
  double least;
};

BsdfParams brushed(const Model& m, float roughness, float strength) {
  BsdfParams p;
  p.albedo = Vec3(1.0f);
  p.metallic = m.glass ? 0.0f : 1.0f;
  p.transmission = m.glass ? 1.0f : 0.0f;
  p.entering = m.entering;
  p.thin = m.thin;
  p.ior = m.ior;
  p.roughness = roughness;
  p.anisotropy = strength;
  return p;
}

TEST(BsdfAnisotropy, BrushedMetalAndGlassLoseLessThanTwoPercent) {
  uint32_t seed = 700;
  for (const Model& m : {Model{"metal", false, true, false, 1.5f, 0.98}, Model{"thin glass", true, true, true, 1.5f, 0.98},
                         Model{"glass 1.3 from outside", true, true, false, 1.3f, 0.98}, Model{"glass 1.5 from outside", true, true, false, 1.5f, 0.98},
                         Model{"glass 2.1 from outside", true, true, false, 2.1f, 0.98}, Model{"glass 1.3 from inside", true, false, false, 1.3f, 0.96},
                         Model{"glass 1.5 from inside", true, false, false, 1.5f, 0.96}, Model{"glass 2.1 from inside", true, false, false, 2.1f, 0.96}}) {
    double lowest = 2, highest = 0, sum = 0;
    int cases = 0, below = 0;
    for (float roughness : {0.1f, 0.3f, 0.6f, 0.9f})
      for (float strength : {0.3f, 0.7f, 1.0f})
        for (double c : {0.06, 0.3, 0.8})
          for (double phi : {0.1, 0.8, 1.5}) {
            const BsdfParams p = brushed(m, roughness, strength);
            const Vec3 wo = localDirection(c, phi);
            Furnace f = test::furnace(p, wo, ++seed, 4, 512);
            if (f.mean + 3.0 * f.error < m.least || f.mean - 3.0 * f.error > 1.0) f = test::furnace(p, wo, ++seed, 8, 4096);
            EXPECT_GT(f.mean + 3.0 * f.error, m.least) << m.name << " roughness " << roughness << " strength " << strength << " cos " << c << " phi " << phi;
            EXPECT_LT(f.mean - 4.0 * f.error, 1.003) << m.name << " roughness " << roughness << " strength " << strength << " cos " << c << " phi " << phi;
            lowest = std::min(lowest, f.mean);
            highest = std::max(highest, f.mean);
            sum += f.mean;
            below += f.mean + 3.0 * f.error < 0.98;
            ++cases;
          }
    std::printf("  %-24s %d cases: %.4f .. %.4f, mean %.4f, %d below 0.98\n", m.name, cases, lowest, highest, sum / cases, below);
    EXPECT_GT(sum / cases, 0.985) << m.name;
  }
}

TEST(BsdfAnisotropy, TheDielectricOnWhiteKeepsItsEnergyToo) {
  uint32_t seed = 9000;
  for (float roughness : {0.2f, 0.6f, 1.0f})
    for (float strength : {0.4f, 1.0f})
      for (double c : {0.08, 0.4, 0.9})
        for (double phi : {0.1, 1.5}) {
          BsdfParams p;
          p.albedo = Vec3(1.0f);
          p.roughness = roughness;
          p.anisotropy = strength;
          const Furnace f = test::furnace(p, localDirection(c, phi), ++seed, 8, 2048);
          EXPECT_NEAR(f.mean, 0.995, 0.012 + 3.0 * f.error) << roughness << " " << strength << " cos " << c << " phi " << phi;
        }
}

TEST(BsdfAnisotropy, BouncedLightIsReciprocalThroughBrushedGlass) {
  test::Rng rng(4);
  const auto upper = [&] { return localDirection(0.05 + 0.95 * rng.next(), 6.28 * rng.next()); };
  for (int k = 0; k < 400; ++k) {
    const float roughness = rng.next(), strength = rng.next(), ior = 1.1f + rng.next();
    const Vec3 a = upper(), b = upper();
    const BsdfParams metal = brushed({"", false, true, false, 1.5f, 0}, roughness, strength);
    const float ab = bsdfEval(metal, a, b).sum().x / b.z, ba = bsdfEval(metal, b, a).sum().x / a.z;
    EXPECT_NEAR(ab, ba, 1e-3f * std::max(ab, ba) + 1e-6f);
    const BsdfParams in = brushed({"", true, true, false, ior, 0}, roughness, strength), out = brushed({"", true, false, false, ior, 0}, roughness, strength);
    const float through = bsdfEval(in, a, -b).sum().x / b.z, back = bsdfEval(out, Vec3(-b.x, -b.y, b.z), Vec3(a.x, a.y, -a.z)).sum().x / a.z;
    EXPECT_NEAR(through * ior * ior, back, 2e-3f * std::max(through * ior * ior, back) + 1e-5f) << roughness << " " << strength << " " << ior;
  }
}

TEST(BsdfAnisotropy, SamplingWeightsAreBounded) {
  test::Rng rng(8);
  float most = 0;
  for (int k = 0; k < 60000; ++k) {
    const Model m{"", k % 2 == 0, k % 4 < 2, false, 1.1f + 1.2f * rng.next(), 0};
    const BsdfParams p = brushed(m, rng.next(), rng.next());
    BsdfSample s;
    const Vec3 wo = localDirection(0.01 + 0.99 * rng.next(), 6.28 * rng.next());
    const float lobe = rng.next();
    if (!bsdfSample(p, wo, lobe, rng.next2(), s)) continue;
    const float eta = p.entering ? p.ior : 1.0f / p.ior;
    most = std::max(most, maxComponent(s.weight) * (s.transmitted ? eta * eta : 1.0f));
  }
  std::printf("  largest weight (as flux) of 60000: %.2f\n", most);
  EXPECT_LT(most, 12.0f);
  EXPECT_GT(most, 1.0f);
}

}  // namespace
}  // namespace gobo::bsdf_anisotropy_test
