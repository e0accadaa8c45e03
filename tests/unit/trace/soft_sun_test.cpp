// SPDX-License-Identifier: Apache-2.0
// Directional lights of some angular size. Oracles: quadrature of the density, the cosine law, the segment of a disk behind a straight edge,
// quadrature of the BSDF over the disk, radiance by definition, the sun without size.
#include <gtest/gtest.h>

#include <numbers>

#include "support/chi2.h"
#include "support/lit_scene.h"
#include "support/tiny_scenes.h"
#include "trace/bsdf.h"
#include "trace/distant_light.h"

namespace gobo {
namespace {

using namespace tests;

constexpr double kDegree = std::numbers::pi / 180;

LightShape sun(double degrees, const Vec3& axis = Vec3(0, -1, 0)) {
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = glm::normalize(axis);
  s.angularSize = float(degrees * kDegree);
  return s;
}
LightShape skyRectangle(double x, double y, const Vec3& axis) {
  LightShape s = sun(0, axis);
  s.u = Frame(s.axis).x;
  s.skyRectangle = Vec2(float(x), float(y));
  return s;
}
double radianceOf(double degrees) { return 1 / (std::numbers::pi * sqr(std::sin(0.5 * degrees * kDegree))); }

TEST(SoftSun, ChiSquaredOfSamplesAgainstDensity) {
  struct Case {
    const char* name;
    LightShape shape;
    double reach;  ///< a half angle that holds it
  };
  const Vec3 slant(0.4f, -1, 0.3f);
  const Case cases[] = {{"0.1 degrees", sun(0.1, slant), 0.06 * kDegree},
                        {"0.53 degrees", sun(0.53), 0.3 * kDegree},
                        {"10 degrees", sun(10, slant), 6 * kDegree},
                        {"90 degrees", sun(90, slant), 50 * kDegree},
                        {"rectangle", skyRectangle(0.5, 0.2, slant), 20 * kDegree},
                        {"wide rectangle", skyRectangle(2, 3, slant), 70 * kDegree}};
  for (const Case& c : cases) {
    test::LitScene lit;
    lit.add(c.shape);
    const LightSampler& s = lit.build();
    const double gap = 2 * sqr(std::sin(0.5 * c.reach));
    const test::Chi2Result r = test::chi2Test(
        {-c.shape.axis, gap, 24, 24}, 60000, uint64_t(&c - cases) + 1,
        [&](test::Rng& rng, Vec3& w) {
          LightSample out;
          if (!s.sample(0, Vec3(1, 2, 3), rng.next2(), out)) return false;
          w = out.direction;
          return true;
        },
        [&](const Vec3& w) { return double(s.pdf(0, Vec3(1, 2, 3), w, 3e38f, 0)); }, 16);
    EXPECT_GT(r.p, test::sidak(int(std::size(cases)))) << c.name << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral;
    EXPECT_NEAR(r.integral, 1.0, 5e-3) << c.name;
  }
}

// sample, pdf and emitted tell one story, and no sample is lost.
TEST(SoftSun, SamplesLieOnTheLightWithTheStatedDensity) {
  for (const LightShape& shape : {sun(2e-4), sun(0.01), sun(0.53, Vec3(1, -2, 3)), sun(30), sun(90), skyRectangle(0.01, 0.02, Vec3(1, -1, 0))}) {
    test::LitScene lit;
    lit.add(shape);
    const LightSampler& s = lit.build();
    test::Rng rng(3);
    int beside = 0;
    for (int i = 0; i < 2000; ++i) {
      LightSample out;
      ASSERT_TRUE(s.sample(0, Vec3(0), rng.next2(), out)) << "light would be lost";
      EXPECT_FALSE(out.delta);
      EXPECT_GE(out.distance, 3e38f);
      EXPECT_NEAR(glm::length(out.direction), 1.0f, 1e-6f);
      const float pdf = s.pdf(0, Vec3(0), out.direction, 3e38f, 0);
      if (pdf > 0.0f) {
        EXPECT_EQ(pdf, out.pdf);
        EXPECT_EQ(s.emitted(0, out.direction, 0, 0, 0, Vec3(0)), out.radiance);
      } else {
        ++beside;
      }
    }
    // Directions in single precision end 6e-8 from where they should: of the smallest sun a tenth of its rim.
    EXPECT_LE(beside, shape.angularSize > 0.0f && shape.angularSize < 1e-5f ? 400 : 0) << shape.angularSize;
    EXPECT_EQ(s.emitted(0, shape.axis, 0, 0, 0, Vec3(0)), Vec3(0.0f)) << "the way that the light goes is not where it is";
    EXPECT_EQ(s.pdf(0, Vec3(0), shape.axis, 3e38f, 0), 0.0f);
  }
}

// A disk above the horizon: irradiance falls with the cosine of its centre, exactly, whatever its size. It is not that of the mean direction.
TEST(SoftSun, IrradianceIsThePowerByTheCosine) {
  for (const double degrees : {0.53, 10.0, 60.0, 90.0})
    for (const double tilt : {0.0, 20.0, 44.0}) {
      test::LitScene lit;
      lit.add(sun(degrees));
      const Vec3 n(float(std::sin(tilt * kDegree)), float(std::cos(tilt * kDegree)), 0);
      EXPECT_NEAR(test::irradiance(lit.build(), 0, Vec3(0), n, 16384).mean, std::cos(tilt * kDegree), 3e-4) << degrees << " tilt " << tilt;
    }
}

/// Radiance of a Lambert ground (albedo 0.5) that a camera sees from the side, light by `shape`.
Estimate groundUnder(const LightShape& shape, const Vec3& normal, const std::function<void(Material&)>& change = {}, int blocks = 16) {
  SceneMaker m;
  const Frame f(normal);
  m.instance(m.mesh(quad(-20.0f * f.x - 20.0f * f.y, 40.0f * f.x, 40.0f * f.y), m.material(Vec3(0.5f), change)));
  m.light(shape);
  m.camera(glm::normalize(normal + 0.4f * f.x) * 5.0f, Vec3(0), 0.01f);
  Traced t(m.finish());
  t.settings.maxBounces = 2;
  return estimate(t, blocks)[0];
}

TEST(SoftSun, PlanesReflectThePowerByTheCosine) {
  const Vec3 axis = glm::normalize(Vec3(0.2f, -1, 0.1f));
  for (const double degrees : {0.0, 0.53, 20.0, 90.0})
    for (const Vec3& normal : {-axis, glm::normalize(Vec3(0.2f, 1, -0.3f))}) {
      const double cosine = -glm::dot(axis, normal);
      SCOPED_TRACE(std::to_string(degrees) + " cosine " + std::to_string(cosine));
      expectNear(groundUnder(sun(degrees, axis), normal), DVec3(0.5 * cosine / std::numbers::pi), 2e-4);
    }
}

TEST(SoftSun, SizeGoesToZeroAsTheSunWithoutSize) {
  const Vec3 axis = glm::normalize(Vec3(0.5f, -1, 0.1f));
  const auto rough = [](Material& x) {
    x.bsdf.specular = 1;
    x.bsdf.roughness = 0.5f;
  };
  const Estimate hard = groundUnder(sun(0, axis), Vec3(0, 1, 0), rough);
  double last = 1e9;
  for (const double degrees : {30.0, 3.0, 0.3, 0.003, 1e-4}) {
    const Estimate soft = groundUnder(sun(degrees, axis), Vec3(0, 1, 0), rough);
    const double off = std::fabs(soft.mean.x - hard.mean.x);
    if (degrees < 1.0) { EXPECT_NEAR(soft.mean.x, hard.mean.x, 4.5 * soft.error.x + 1e-4 * hard.mean.x) << degrees; }
    EXPECT_LE(off, last + 4.5 * soft.error.x) << degrees;
    last = off;
  }
}

// A glossy plane, whose BSDF rays meet the disk as often as light samples do: quadrature of f cos over the disk, no sampling at all.
TEST(SoftSun, WeightedStrategiesAddUpToTheIntegral) {
  for (const double degrees : {2.0, 30.0})
    for (const float roughness : {0.25f, 0.6f}) {
      const Vec3 n(0, 1, 0);
      const auto gloss = [&](Material& x) {
        x.bsdf.metallic = 1;
        x.bsdf.specular = 1;
        x.bsdf.roughness = roughness;
      };
      const Frame ground(n);
      const Vec3 to = glm::normalize(n + 0.4f * ground.x);                           // towards the camera
      const Vec3 axis = glm::normalize(Vec3(to.x, -to.y, to.z) + 0.05f * ground.y);  // near its mirror direction
      BsdfParams p;
      p.albedo = Vec3(0.5f);
      p.metallic = 1;
      p.specular = 1;
      p.roughness = roughness;
      const Frame f(-axis);
      const double half = 0.5 * degrees * kDegree;
      double sum = 0;
      constexpr int kRings = 400, kSteps = 400;
      for (int i = 0; i < kRings; ++i) {
        const double theta = half * (i + 0.5) / kRings;
        for (int k = 0; k < kSteps; ++k) {
          const double phi = 2 * std::numbers::pi * (k + 0.5) / kSteps;
          const Vec3 w = f.toWorld(Vec3(float(std::sin(theta) * std::cos(phi)), float(std::sin(theta) * std::sin(phi)), float(std::cos(theta))));
          if (w.y <= 0) continue;
          sum += bsdfEval(p, ground.toLocal(to), ground.toLocal(w)).sum().x * std::sin(theta);
        }
      }
      const double truth = sum * half / kRings * 2 * std::numbers::pi / kSteps * radianceOf(degrees);
      SCOPED_TRACE(std::to_string(degrees) + " roughness " + std::to_string(roughness));
      const Estimate e = groundUnder(sun(degrees, axis), n, gloss, 32);
      EXPECT_LT(e.error.x, 0.01 * truth);
      expectNear(e, DVec3(truth), 2e-3);  // the camera's window spans a hundredth of a radian
    }
}

/// Share of a disk of radius 1 on the far side of a line at `d` from its centre (+1: all of it is cut away).
double segment(double d) {
  if (d >= 1) return 0;
  if (d <= -1) return 1;
  return (std::acos(d) - d * std::sqrt(1 - d * d)) / std::numbers::pi;
}

// The penumbra of a straight edge: of the disk the part beyond a line. The whole stage is turned, so that no axis is a special one.
TEST(SoftSun, PenumbraOfAnEdgeIsTheSegmentOfADisk) {
  for (const bool turned : {false, true})
    for (const double degrees : {0.53, 3.0}) {
      SCOPED_TRACE(std::to_string(degrees) + (turned ? " turned" : ""));
      const Frame f = turned ? Frame(glm::normalize(Vec3(0.3f, 0.5f, -0.7f))) : Frame(Vec3(0, 1, 0), Vec3(1, 0, 0));
      const double tangent = std::tan(0.5 * degrees * kDegree), height = 2.0, width = height * tangent;
      SceneMaker m;
      m.instance(m.mesh(quad(-9.0f * f.x - 9.0f * f.y, 18.0f * f.x, 18.0f * f.y), m.material(Vec3(0.5f))));
      m.instance(m.mesh(quad(-9.0f * f.x - 9.0f * f.y + float(height) * f.z, 9.0f * f.x, 18.0f * f.y), m.material(Vec3(0.0f))));  // over x < 0
      m.light(sun(degrees, -f.z));
      Camera c;
      c.perspective = false;
      constexpr int kPixels = 15;
      c.yheight = float(2.2 * width / kPixels);  // of a row; the picture is 2.2 penumbras wide
      c.toWorld = Mat4(Vec4(f.x, 0), Vec4(f.y, 0), Vec4(f.z, 0), Vec4(f.z, 1));
      m.scene.cameras.assign(1, c);
      Traced t(m.finish(), kPixels, 1);
      t.settings.maxBounces = 0;
      const auto tracer = t.tracer();
      double worst = 0;
      constexpr int kBlocks = 4096;
      static_assert(kBlocks < int(kBlocksPerStream));
      for (int x = 0; x < kPixels; ++x) {
        double sum = 0;
        for (int b = 0; b < kBlocks; ++b) {
          double out[3] = {};
          uint64_t rays = 0, dropped = 0;
          tracer->traceBlock(x, 0, uint32_t(b), out, rays, dropped);
          sum += out[0] / t.settings.blockSize / kBlocks;
        }
        double truth = 0;
        for (int k = 0; k < 64; ++k) truth += segment(-1.1 * (2 * (x + (k + 0.5) / 64) / kPixels - 1)) / 64;  // at +1 all is seen
        const double seen = sum * std::numbers::pi / 0.5;
        worst = std::max(worst, std::fabs(seen - truth));
      }
      std::printf("penumbra of %.2f degrees%s: largest error %.5f\n", degrees, turned ? ", turned" : "", worst);
      EXPECT_LT(worst, 2e-3);  // 65536 samples a pixel: independent ones would have a deviation of that size, these a third of it
    }
}

/// Mean radiance of a camera at the origin that looks at the sun, at -z, past `add`.
double seenSun(double degrees, const std::function<void(SceneMaker&)>& add, const Vec3& axis = Vec3(0, 0, 1)) {
  SceneMaker m;
  add(m);
  if (m.scene.instances.empty()) m.instance(m.mesh(ground(1, -50), m.material(Vec3(0.0f))));
  m.light(sun(degrees, axis));
  m.camera(Vec3(0.0f), Vec3(0, 0, -4), 0.5f * float(degrees * kDegree));  // half the sun's height: its corners are within
  Traced t(m.finish());
  return estimate(t, 8)[0].mean.x;
}

TEST(SoftSun, CamerasDoNotSeeItMirrorsAndGlassDo) {
  const auto glass = [](bool thin) {
    return [=](SceneMaker& m) {
      const int material = m.material(Vec3(1.0f), [&](Material& x) {
        x.bsdf = {};
        x.bsdf.transmission = 1;
        x.bsdf.ior = 1.5f;
        x.bsdf.roughness = 0;
        x.bsdf.thickness = thin ? 0.0f : 1.0f;
      });
      m.instance(m.mesh(thin ? quad(Vec3(-2, -2, -2), Vec3(4, 0, 0), Vec3(0, 4, 0)) : box(Vec3(-2, -2, -2), Vec3(2, 2, -1)), material));
    };
  };
  const auto mirror = [](SceneMaker& m) {
    m.instance(m.mesh(quad(Vec3(-3, -3, -2), Vec3(6, 0, 0), Vec3(0, 6, 0)), m.material(Vec3(0.5f), [](Material& x) {
      x.bsdf.metallic = 1;
      x.bsdf.roughness = 0;
      x.bsdf.specular = 1;
    })));
  };
  for (const double degrees : {0.53, 8.0}) {
    const double L = radianceOf(degrees);
    EXPECT_EQ(seenSun(degrees, [](SceneMaker&) {}), 0.0);
    EXPECT_EQ(seenSun(degrees, glass(true)), 0.0) << "a clear pane is no event";
    EXPECT_NEAR(seenSun(degrees, glass(false)) / L, 0.96 * 0.96 / (1 - 0.04 * 0.04), 0.02);
    EXPECT_NEAR(seenSun(degrees, mirror, Vec3(0, 0, -1)) / L, 0.5, 0.002) << degrees;
    EXPECT_EQ(seenSun(degrees, mirror), 0.0) << "the mirror hides it";
  }
}

TEST(SoftSun, BadSizesAreNamed) {
  const auto check = [](const std::function<void(LightShape&)>& change) {
    Scene s;
    Light l;
    l.name = "sun";
    l.shape = sun(1);
    change(l.shape);
    s.lights = {l};
    return s.seal();
  };
  EXPECT_TRUE(check([](LightShape&) {}).ok());
  EXPECT_TRUE(check([](LightShape& s) { s.angularSize = 0.5f * kPi; }).ok());
  EXPECT_TRUE(check([](LightShape& s) { s.angularSize = kLeastAngularSize; }).ok());
  for (const float bad : {-0.1f, 1e-7f, 1.58f, NAN, INFINITY}) {
    const Status status = check([&](LightShape& s) { s.angularSize = bad; });
    EXPECT_FALSE(status.ok()) << bad;
    EXPECT_NE(status.toString().find("angular"), std::string::npos) << status.toString();
  }
  for (const Vec2& bad : {Vec2(0.1f, 0), Vec2(-0.1f, 0.1f), Vec2(NAN, 0.1f)})
    EXPECT_FALSE(check([&](LightShape& s) {
                   s.angularSize = 0;
                   s.skyRectangle = bad;
                 }).ok());
  EXPECT_FALSE(check([](LightShape& s) { s.skyRectangle = Vec2(0.1f); }).ok()) << "a disk and a rectangle";
}

}  // namespace
}  // namespace gobo
