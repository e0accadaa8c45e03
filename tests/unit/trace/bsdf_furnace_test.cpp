// SPDX-License-Identifier: Apache-2.0
// White furnaces. Metal, dielectric, rough and thin glass at albedo 1: less than 1 % is lost, nothing is gained. Layered models: nothing
// is gained over a random sweep of all parameters.
#include <gtest/gtest.h>

#include "support/furnace.h"
#include "support/thorough.h"

namespace gobo::bsdf_furnace_test {
namespace {

using test::Furnace;
using test::localDirection;

struct Model {
  const char* name;
  void (*set)(BsdfParams&);
  bool hasIor;
};
const Model kModels[] = {
    {"metal", [](BsdfParams& p) { p.metallic = 1; }, false},
    {"dielectric on white", [](BsdfParams&) {}, true},
    {"glass from outside", [](BsdfParams& p) { p.transmission = 1; }, true},
    {"glass from inside",
     [](BsdfParams& p) {
       p.transmission = 1;
       p.entering = false;
     },
     true},
    {"thin glass",
     [](BsdfParams& p) {
       p.transmission = 1;
       p.thin = true;
     },
     false},  // the split between both sides changes with the index, the sum does not
};

TEST(BsdfFurnace, WhiteMetalDielectricAndGlassLoseLessThanAPercent) {
  uint32_t seed = 1;
  size_t combination = 0;
  for (const Model& m : kModels) {
    double lowest = 2, highest = 0, lossR = 0, lossC = 0, lossIor = 0;
    int cases = 0;
    for (float ior : {1.1f, 1.3f, 1.5f, 1.8f, 2.4f}) {
      if (!m.hasIor && ior > 1.2f) break;
      for (float roughness : {0.0f, 0.04f, 0.1f, 0.2f, 0.3f, 0.45f, 0.6f, 0.8f, 1.0f})
        for (double c : {0.02, 0.05, 0.12, 0.3, 0.6, 0.85, 1.0}) {
          if (m.hasIor && !testing::inSweep(combination++, 3)) {
            ++seed;  // that of the others stays
            continue;
          }
          BsdfParams p;
          p.albedo = Vec3(1.0f);
          p.roughness = roughness;
          p.ior = ior;
          m.set(p);
          const Vec3 wo = localDirection(c, 0.3);
          Furnace f;
          EXPECT_FALSE(test::gains(p, wo, ++seed, f)) << m.name << " roughness " << roughness << " ior " << ior << " cos " << c << ": " << f.mean << " +- "
                                                      << f.error;
          if (f.mean < 0.99 + 3.0 * f.error && f.mean > 0.97) f = test::furnace(p, wo, ++seed, 16, 8192);
          EXPECT_GT(f.mean + 3.0 * f.error, 0.99) << m.name << " roughness " << roughness << " ior " << ior << " cos " << c << " +- " << f.error;
          if (f.mean < lowest) {
            lowest = f.mean;
            lossR = roughness;
            lossC = c;
            lossIor = ior;
          }
          highest = std::max(highest, f.mean);
          ++cases;
        }
    }
    std::printf("  %-20s %3d cases: lowest %.4f (ior %.1f, roughness %.2f, cos %.2f), highest %.4f\n", m.name, cases, lowest, lossIor, lossR, lossC, highest);
  }
}

BsdfParams randomMaterial(test::Rng& rng) {
  const auto pick = [&](float share, float v) { return rng.next() < share ? v : 0.0f; };
  const auto edge = [&] {
    const float u = rng.next();
    return u < 0.1f ? 0.0f : u > 0.9f ? 1.0f : (u - 0.1f) / 0.8f;
  };
  BsdfParams p;
  p.albedo = rng.next() < 0.7f ? Vec3(1.0f) : Vec3(rng.next(), rng.next(), rng.next());
  p.metallic = pick(0.4f, edge());
  p.roughness = edge();
  p.specular = rng.next() < 0.6f ? 1.0f : edge();
  p.specularColor = rng.next() < 0.6f ? Vec3(1.0f) : Vec3(rng.next(), rng.next(), rng.next()) * 4.0f;
  p.ior = rng.next() < 0.1f ? 1e9f : 1.0f + 1.5f * rng.next();
  p.transmission = pick(0.4f, edge());
  p.entering = rng.next() < 0.6f;
  p.thin = rng.next() < 0.3f;
  p.clearcoat = pick(0.5f, edge());
  p.clearcoatRoughness = edge();
  if (rng.next() < 0.4f) p.clearcoatNormal = glm::normalize(Vec3(rng.next() - 0.5f, rng.next() - 0.5f, 0.6f));
  if (rng.next() < 0.4f) p.sheenColor = rng.next() < 0.5f ? Vec3(1.0f) : Vec3(rng.next(), rng.next(), rng.next());
  p.sheenRoughness = edge();
  p.iridescence = pick(0.3f, edge());
  p.iridescenceIor = 1.0f + 1.5f * rng.next();
  p.iridescenceThickness = 1200.0f * rng.next();
  // Into a volume only the interface compresses radiance; the furnace could not tell the two kinds of transmitted light apart.
  if (p.transmission == 0.0f || p.thin) p.diffuseTransmission = pick(0.4f, edge());
  p.anisotropy = pick(0.3f, edge());
  return p;
}

TEST(BsdfFurnace, NoStackOfLayersGains) {
  test::Rng rng(5);
  double highest = 0;
  const int n = testing::thoroughOr(500, 160);
  for (int k = 0; k < n; ++k) {
    const BsdfParams p = randomMaterial(rng);
    const double u = rng.next(), c = k % 3 ? 0.01 + 0.99 * u : 0.01 + 0.3 * u * u, phi = 6.28 * rng.next();
    Furnace f;
    EXPECT_FALSE(test::gains(p, localDirection(c, phi), uint32_t(k) + 5000, f))
        << k << ": " << f.mean << " +- " << f.error << " cos " << c << " metallic " << p.metallic << " roughness " << p.roughness << " specular " << p.specular
        << " colour " << p.specularColor.x << " " << p.specularColor.y << " " << p.specularColor.z << " ior " << p.ior << " transmission " << p.transmission
        << " entering " << p.entering << " thin " << p.thin << " coat " << p.clearcoat << " " << p.clearcoatRoughness << " sheen " << p.sheenColor.x << " "
        << p.sheenRoughness << " film " << p.iridescence << " " << p.iridescenceIor << " " << p.iridescenceThickness << " through " << p.diffuseTransmission
        << " anisotropy " << p.anisotropy;
    if (f.error < 0.003) highest = std::max(highest, f.mean);
  }
  std::printf("  %d random stacks: highest reflectance (of those known to 0.003) %.4f\n", n, highest);
}

/// The table of docs/materials.md.
TEST(BsdfFurnace, LayeredModelsMeasured) {
  struct Row {
    const char* name;
    void (*set)(BsdfParams&);
  };
  const Row rows[] = {
      {"dielectric on white, roughness 0.4", [](BsdfParams& p) { p.roughness = 0.4f; }},
      {"coat 1 on white metal 0.4",
       [](BsdfParams& p) {
         p.metallic = 1;
         p.roughness = 0.4f;
         p.clearcoat = 1;
       }},
      {"rough coat 0.5 on white metal 0.4",
       [](BsdfParams& p) {
         p.metallic = 1;
         p.roughness = 0.4f;
         p.clearcoat = 1;
         p.clearcoatRoughness = 0.5f;
       }},
      {"coat 1 on white Lambert",
       [](BsdfParams& p) {
         p.specular = 0;
         p.clearcoat = 1;
       }},
      {"sheen 1, roughness 0.3, on white",
       [](BsdfParams& p) {
         p.sheenColor = Vec3(1.0f);
         p.sheenRoughness = 0.3f;
       }},
      {"sheen 1, roughness 0.8, on white",
       [](BsdfParams& p) {
         p.sheenColor = Vec3(1.0f);
         p.sheenRoughness = 0.8f;
       }},
      {"film 400 nm on white dielectric",
       [](BsdfParams& p) {
         p.roughness = 0.3f;
         p.iridescence = 1;
         p.iridescenceThickness = 400;
       }},
      {"film 400 nm on metal 0.5",
       [](BsdfParams& p) {
         p.metallic = 1;
         p.albedo = Vec3(0.5f);
         p.roughness = 0.3f;
         p.iridescence = 1;
         p.iridescenceThickness = 400;
       }},
      {"anisotropy 0.7, white metal 0.3",
       [](BsdfParams& p) {
         p.metallic = 1;
         p.roughness = 0.3f;
         p.anisotropy = 0.7f;
       }},
      {"anisotropy 1, white metal 0.3",
       [](BsdfParams& p) {
         p.metallic = 1;
         p.roughness = 0.3f;
         p.anisotropy = 1;
       }},
      {"diffuse transmission 0.5", [](BsdfParams& p) { p.diffuseTransmission = 0.5f; }},
      {"all: coat, sheen, film, anisotropy",
       [](BsdfParams& p) {
         p.roughness = 0.4f;
         p.clearcoat = 0.5f;
         p.sheenColor = Vec3(0.5f);
         p.sheenRoughness = 0.4f;
         p.iridescence = 0.5f;
         p.iridescenceThickness = 300;
         p.anisotropy = 0.5f;
       }},
  };
  for (const Row& row : rows) {
    BsdfParams p;
    p.albedo = Vec3(1.0f);
    row.set(p);
    std::printf("  | %-36s |", row.name);
    for (double c : {1.0, 0.7, 0.4, 0.15, 0.05}) {
      const Furnace f = test::furnace(p, localDirection(c, 0.5), 77, 8, 2048);
      EXPECT_LE(f.mean, 1.0 + 4.0 * f.error + 1e-4) << row.name;
      EXPECT_GT(f.mean, 0.4) << row.name;
      std::printf(" %.3f |", f.mean);
    }
    std::printf("\n");
  }
}

/// Ends of every range, which decide which lobes there are.
BsdfParams extremeMaterial(test::Rng& rng) {
  BsdfParams p = randomMaterial(rng);
  const auto end = [&](float& v, std::initializer_list<float> ends) {
    if (rng.next() < 0.6f) v = ends.begin()[std::min(ends.size() - 1, size_t(rng.next() * float(ends.size())))];
  };
  end(p.roughness, {0.0f, 0.03f, 0.0317f, 1.0f, -1.0f, 2.0f});
  end(p.metallic, {0.0f, 1.0f, 1.5f, -0.1f});
  end(p.specular, {0.0f, 1.0f});
  end(p.transmission, {0.0f, 1.0f, 1.1f});
  end(p.ior, {0.0f, 1.0f, 1.0005f, 1.5f, 2000.0f});
  end(p.anisotropy, {0.0f, 1.0f});
  end(p.diffuseTransmission, {0.0f, 1.0f});
  end(p.iridescence, {0.0f, 1.0f});
  end(p.clearcoat, {0.0f, 1.0f});
  end(p.clearcoatRoughness, {0.0f, 0.5f});
  if (rng.next() < 0.3) p.albedo = Vec3(0.0f);
  if (rng.next() < 0.5) p.sheenColor = Vec3(0.0f);
  return p;
}

// One look that is asked twice, and after a sample, has the bits of a look for each question; and whether a material is a mirror is told in two ways.
TEST(Bsdf, AViewAnswersAsOftenAsItIsAsked) {
  test::Rng rng(77);
  size_t mirrors = 0, others = 0, values = 0;
  for (int k = 0; k < 20000; ++k) {
    const BsdfParams p = k % 2 ? extremeMaterial(rng) : randomMaterial(rng);
    const auto direction = [&] { return localDirection(2.0 * rng.next() - 1.0, 6.28 * rng.next()); };
    const Vec3 wo = direction(), wi = direction(), other = direction();
    const BsdfView view(p, wo);
    ASSERT_EQ(view.isDelta(), bsdfIsDelta(p)) << k;
    ++(view.isDelta() ? mirrors : others);
    const float uLobe = rng.next();
    const Vec2 u(rng.next(), rng.next());
    float pdfs[3], single;
    BsdfSample drawn, fresh;
    const BsdfValue first = view.evalPdf(wi, pdfs[0]);
    BsdfValue value;
    const bool some = view.sample(uLobe, u, drawn, value);
    view.evalPdf(other, pdfs[1]);
    const BsdfValue again = view.evalPdf(wi, pdfs[2]), alone = bsdfEvalPdf(p, wo, wi, single);
    ASSERT_EQ(some, bsdfSample(p, wo, uLobe, u, fresh)) << k;
    for (const BsdfValue& v : {again, alone}) ASSERT_TRUE(v.diffuse == first.diffuse && v.specular == first.specular) << k;
    ASSERT_EQ(pdfs[0], pdfs[2]) << k;
    ASSERT_EQ(pdfs[0], single) << k;
    ASSERT_TRUE(drawn.wi == fresh.wi && drawn.weight == fresh.weight && drawn.pdf == fresh.pdf && drawn.delta == fresh.delta) << k;
    if (!(wo.z > 0.0f)) { ASSERT_TRUE(!some && single == 0.0f) << k; }
    if (!some) continue;
    const BsdfValue there = view.evalPdf(drawn.wi, single);
    if (drawn.delta) {
      ASSERT_EQ(value.sum(), Vec3(0.0f)) << k;
      continue;
    }
    ASSERT_TRUE(value.diffuse == there.diffuse && value.specular == there.specular) << k;
    ASSERT_EQ(drawn.pdf, single) << k;
    ++values;
  }
  EXPECT_GT(mirrors, 500u);
  EXPECT_GT(others, 5000u);
  EXPECT_GT(values, 5000u);
}

}  // namespace
}  // namespace gobo::bsdf_furnace_test
