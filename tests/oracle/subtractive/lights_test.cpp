// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows of a scene's lights against closed forms and against the house's own lights and shadow rays.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "lamp_stage.h"
#include "techniques/subtractive/samples_node.h"
#include "terms/dropped_samples.h"

namespace gobo::subtractive_test {
namespace {

TEST(SubtractiveLights, WithoutAnOccluderLightIsTheUnshadowedToTheBit) {
  std::vector<Light> lamps = manyLamps(13);
  for (const Light& l : lampsOfSize()) lamps.push_back(l);
  for (const int size : {1, 23}) {
    LampStage s(floorScene([](SceneMaker&, int) {}, Vec3(0.3f, 0.0f, 0.9f)), lamps, size, size, 3);
    const TermPtr c = s.full();
    for (const int most : {1, 5, 40})
      for (const int r : {1, 2, 5, 32}) {
        const TermPtr samples = s.traced(r, most);
        for (const Form form : kForms) {
          const TermPtr light = s.light(form, samples, c, std::min(most, 17), r);
          const auto out = light->floats("diffuse"), full = c->floats("diffuse");
          for (size_t i = 0; i < out.size(); ++i) {
            float mean = 0;
            for (size_t layer = 0; layer < 3; ++layer) mean += full[layer * 3 * s.pixels() + i] * (1.0f / 3.0f);
            ASSERT_EQ(out[i], mean) << "most " << most << " r " << r << " form " << int(form) << " at " << i;
            ASSERT_EQ(light->floats("negative")[i], 0.0f);
          }
        }
      }
  }
}

TEST(SubtractiveLights, UnshadowedLightIsTheSumOfTheHousesNodes) {
  LampStage s(stageScene(), manyLamps(13), 32, 24);
  const std::vector<double> truth = s.additive(false), sum = s.meanOfSamples(s.full());
  const double mean = meanOf(truth);
  ASSERT_GT(mean, 0.03);
  for (size_t i = 0; i < truth.size(); ++i) ASSERT_NEAR(sum[i], truth[i], 1e-5 * (truth[i] + 0.01 * mean)) << i;
}

/// Every lamp's light by this many samples, means over view samples.
std::vector<double> drawnLight(const LampStage& s, int samples) {
  const SceneView view(*s.scene, Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission, s.subset);
  const auto sampler = LightSampler::build(view);
  const subtractive::Receivers in(*s.g, *s.surface, s.view);
  std::vector<double> out(3 * s.pixels(), 0.0);
  for (size_t e = 0; e < in.instance.size(); ++e)
    for (const int l : s.subset) {
      if (!in.lit(e)) continue;
      const BsdfValue f = UnoccludedLight(*sampler, view.lightShape(l), l, samples, 77).lobes(in.point(e, in.bsdf(e)), e);
      for (int c = 0; c < 3; ++c) out[3 * (e % s.pixels()) + size_t(c)] += double(f.sum()[c] * s.scene->lights[size_t(l)].power[c]) / s.view.viewSamples;
    }
  return out;
}

// Of lights of some size the sum, and so the house's nodes, is nearer to the truth than 32 samples: against 4096. Far lamps, then near ones.
TEST(SubtractiveLights, UnshadowedLightOfLampsOfSomeSizeIsThatOfManySamples) {
  for (const float size : {0.02f, 0.3f}) {
    std::vector<Light> lamps = lampsOfSize();
    for (Light& l : lamps) {
      l.shape.radius *= size / 0.3f;
      l.shape.u *= size / 0.3f;
      l.shape.v *= size / 0.3f;
      l.power *= sqr(0.3f / size);
    }
    lamps.push_back(lamp(LightKind::Directional, Vec3(0), Vec3(0.5f), Vec3(0.3f, -1, 0.2f)));
    lamps.back().shape.angularSize = 0.3f * size;
    LampStage s(stageScene(), lamps, 16, 12);
    const std::vector<double> truth = drawnLight(s, 4096), drawn = drawnLight(s, 32), house = s.additive(false), sum = s.meanOfSamples(s.full());
    const double mean = meanOf(truth);
    ASSERT_GT(mean, 0.03);
    double worst = 0, own = 0, theirs = 0;
    for (size_t i = 0; i < truth.size(); ++i) {
      worst = std::max(worst, std::abs(sum[i] - truth[i]) / (truth[i] + 0.01 * mean));
      own += (sum[i] - truth[i]) * (sum[i] - truth[i]);
      theirs += (drawn[i] - truth[i]) * (drawn[i] - truth[i]);
      ASSERT_NEAR(sum[i], house[i], 1e-3 * (house[i] + 0.01 * mean)) << i << ", of which what is Lambert is exact";
    }
    EXPECT_LT(worst, size < 0.1f ? 0.003 : 0.01) << size << ": the rules' error and the noise of 4096 samples";
    EXPECT_LE(own, (size < 0.1f ? 2.0 : 0.1) * theirs) << size << ": one direction to a far lamp is as good as 32";
  }
}

/// Rough glass of some thickness: no diffuse lobe, and none of its gloss is in bsdfLobeAlbedos.
void roughGlass(Material& x) {
  x.bsdf = {};
  x.bsdf.roughness = 0.4f;
  x.bsdf.transmission = 1.0f;
  x.bsdf.thickness = 0.5f;
}

/// A floor with a ball of rough glass, under a roof that hides two thirds of what the ball would show.
ScenePtr glassStage() {
  SceneMaker m;
  const int white = m.material(Vec3(0.7f));
  m.instance(m.mesh(tests::ground(4.0f), white));
  m.instance(m.mesh(tests::sphere(Vec3(0.7f, 0.6f, 0.6f), 0.5f, 24, true), m.material(Vec3(1.0f), roughGlass)));
  m.instance(m.mesh(tests::box(Vec3(-1.4f, 1.12f, -1.2f), Vec3(1.1f, 1.16f, 0.9f)), white));
  m.camera(Vec3(2.0f, 2.2f, 3.5f), Vec3(0.1f, 0.6f, 0), 0.7f);
  return m.finish();
}

TEST(SubtractiveLights, AllLightsAtFullResolutionAreTheirDirectLight) {
  for (const bool glass : {false, true}) {
    LampStage s(glass ? glassStage() : stageScene(), manyLamps(24), 40, 30);
    const std::vector<double> truth = s.additive(true), bare = s.additive(false);
    const double mean = meanOf(truth);
    ASSERT_GT(mean, 0.03);
    ASSERT_LT(mean, 0.9 * meanOf(bare)) << "something is in shadow";
    for (const int most : {24, 40})
      for (const Form form : kForms) {
        const TermPtr light = s.picture(form, 1, most);
        double worst = 0;
        for (size_t i = 0; i < truth.size(); ++i)
          worst = std::max(worst, std::abs(double(light->floats("diffuse")[i]) + double(light->floats("specular")[i]) - truth[i]) / (truth[i] + 0.01 * mean));
        EXPECT_LT(worst, glass ? 1e-4 : 1e-5) << int(form);  // deep shadows, of which DIFFERENCE has the rounding of unshadowed light
      }
  }
}

// At every pixel and at every third.
TEST(SubtractiveLights, ReflectionsOnRoughGlassAreInShadow) {
  LampStage s(glassStage(), manyLamps(24), 48, 36);
  const TermPtr c = s.full(), all = s.picture(Form::Ratio, 1, 24);
  const auto glass = s.g->plane<uint32_t>("instance");
  const auto gloss = [&](const TermPtr& light) {
    double sum = 0;
    for (size_t p = 0; p < s.pixels(); ++p)
      if (glass[p] == 1 && glass[p + s.pixels()] == 1)  // in both view samples
        for (size_t k = 0; k < 3; ++k) sum += double(light->floats("specular")[3 * p + k]);
    return sum;
  };
  double unshadowed = 0;
  for (size_t p = 0; p < s.pixels(); ++p)
    if (glass[p] == 1 && glass[p + s.pixels()] == 1)
      for (size_t k = 0; k < 3; ++k) unshadowed += 0.5 * double(c->floats("specular")[3 * p + k] + c->floats("specular")[3 * (p + s.pixels()) + k]);
  const double truth = gloss(all);
  ASSERT_GT(truth, 0.0);
  ASSERT_LT(truth, 0.9 * unshadowed) << "the roof hides some lamps";
  for (const Form form : kForms) {
    EXPECT_NEAR(gloss(s.picture(form, 1, 24)) / truth, 1.0, 1e-4) << int(form);
    EXPECT_LT(gloss(s.picture(form, 3, 24)), truth + 0.75 * (unshadowed - truth)) << int(form);  // BETA is 0.55 of the way
  }
}

// What grazes a ball of few facets is above one of its normals and below the other.
TEST(SubtractiveLights, UnshadowedLightIsAboveBothHorizons) {
  std::vector<Light> low;
  for (int i = 0; i < 12; ++i)
    low.push_back(lamp(LightKind::Point, Vec3(3.0f * std::cos(0.5f * float(i)), 1.0f, 3.0f * std::sin(0.5f * float(i))), Vec3(2.0f)));
  LampStage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::sphere(Vec3(0, 1, 0), 1.5f, 8, true), white)); }), low, 40, 30);
  const std::vector<double> truth = s.additive(false), sum = s.meanOfSamples(s.full());
  const double mean = meanOf(truth);
  ASSERT_GT(mean, 0.01);
  for (size_t i = 0; i < truth.size(); ++i) ASSERT_NEAR(sum[i], truth[i], 1e-5 * (truth[i] + 0.01 * mean)) << i;
}

// A light of some size has the shadow of the one point that the house's node takes with one ray.
TEST(SubtractiveLights, OneLightOfSomeSizeHasTheHousesShadowOfOneRay) {
  for (const Light& l : lampsOfSize()) {
    LampStage s(stageScene(), {l}, 32, 24);
    const TermPtr c = s.full(), V = s.shadows(s.subset[0]);
    std::vector<double> truth(3 * s.pixels(), 0.0);
    for (size_t e = 0; e < 2 * s.pixels(); ++e)
      for (const char* lobe : {"diffuse", "specular"})
        for (size_t i = 0; i < 3; ++i) truth[3 * (e % s.pixels()) + i] += 0.5 * double(c->floats(lobe)[3 * e + i]) * double(V->floats("V")[e]);
    const double mean = meanOf(truth);
    ASSERT_GT(mean, 0.001);
    const TermPtr light = s.picture(Form::Ratio, 1, 40);
    for (size_t i = 0; i < truth.size(); ++i)
      ASSERT_NEAR(double(light->floats("diffuse")[i]) + double(light->floats("specular")[i]), truth[i], 1e-5 * (truth[i] + mean))
          << int(l.shape.kind) << " " << i;
  }
}

// Their points are spread over one another's strata: the mean over samples is the soft shadow, and lamps in one place do not share their points.
TEST(SubtractiveLights, LampsInOnePlaceHavePointsOfTheirOwn) {
  const Light ball = lamp(LightKind::Sphere, Vec3(0, 3, 0), Vec3(1.0f));
  LampStage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::quad(Vec3(0, 1.5f, 9), Vec3(9, 0, 0), Vec3(0, 0, -18)), white)); }),
              std::vector<Light>(8, ball), 24, 18, 1);
  const TermPtr traced = s.traced(1, 40);
  int part = 0;
  for (size_t p = 0; p < s.pixels(); ++p) {
    const float u = traced->floats("unshadowed")[6 * p], v = traced->floats("visible")[6 * p];
    part += v > 0.05f * u && v < 0.95f * u;
  }
  EXPECT_GT(part, 10) << "with the same point all eight would be seen, or none";
}

TEST(SubtractiveLights, BehindClosedWallsTheRatioIsZeroAndNothingLeavesItsRange) {
  const ScenePtr closed = floorScene([](SceneMaker& m, int white) {
    m.instance(m.mesh(tests::box(Vec3(-40, -0.5f, -40), Vec3(40, 9, 40)), white));
    m.instance(m.mesh(tests::box(Vec3(0, 0, -0.5f), Vec3(0.8f, 0.7f, 0.5f)), white));
    m.instance(m.mesh(tests::sphere(Vec3(-0.9f, 0.6f, 0.2f), 0.6f, 24, true), m.material(Vec3(1.0f), roughGlass)));
  });
  std::vector<Light> lamps;
  for (int i = 0; i < 30; ++i)
    lamps.push_back(lamp(i % 2 ? LightKind::Point : LightKind::Sphere, Vec3(float(i) - 15.0f, 12.0f + 0.1f * float(i), 3), Vec3(200.0f)));
  LampStage s(closed, lamps, 24, 18);
  for (const int most : {7, 30})
    for (const int r : {1, 4}) {
      const TermPtr samples = s.traced(r, most), c = s.full();
      float lit[2] = {0, 0};
      double gloss = 0, left = 0;
      for (const float v : c->floats("diffuse")) lit[0] = std::max(lit[0], v);
      for (const float v : c->floats("specular")) lit[1] = std::max(lit[1], v), gloss += double(v) / s.view.viewSamples;
      ASSERT_GT(lit[0], 1.0f);
      ASSERT_GT(lit[1], 0.01f) << "glass";
      const TermPtr ratio = s.light(Form::Ratio, samples, c, most, r);
      for (const float v : ratio->floats("diffuse")) ASSERT_EQ(v, 0.0f);
      for (const float v : ratio->floats("specular")) left += double(v);
      if (r == 1) { ASSERT_EQ(left, 0.0); }
      ASSERT_LT(left, 0.02 * gloss) << "r " << r;  // at grazing samples about which no lamp is above the horizon
      for (const Form form : kForms) {
        const TermPtr light = s.light(form, samples, c, most, r);
        for (const int lobe : {0, 1})
          for (const float v : light->floats(lobe ? "specular" : "diffuse")) ASSERT_TRUE(v >= 0.0f && v <= (r == 1 ? 1e-5f : 1.0f) * lit[lobe]) << v;
      }
    }
  LampStage open(stageScene(), manyLamps(60), 40, 30);
  const TermPtr c = open.full();
  for (const int most : {4, 60})
    for (const int r : {1, 3, 8}) {
      const TermPtr light = open.light(Form::Ratio, open.traced(r, most), c, most, r);
      for (const char* lobe : {"diffuse", "specular"})
        for (size_t i = 0; i < light->floats(lobe).size(); ++i) {
          const float mean = 0.5f * (c->floats(lobe)[i] + c->floats(lobe)[i + 3 * open.pixels()]);
          ASSERT_TRUE(light->floats(lobe)[i] >= 0.0f && light->floats(lobe)[i] <= mean * 1.000001f) << r;
        }
    }
}

// A rectangle of which two thirds cannot shine on the floor, below its horizon: a point there does not make all of it seen. Behind a plate that hides it.
TEST(SubtractiveLights, AHalfSunkLampBehindAWallIsDark) {
  Light sunk = lamp(LightKind::Rect, Vec3(-3, 0, 0), Vec3(20.0f));
  sunk.shape.axis = Vec3(1, 0, 0);
  sunk.shape.u = Vec3(0, 0, 1);
  sunk.shape.v = Vec3(0, 1.5f, 0);
  LampStage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::box(Vec3(-2.6f, -3, -9), Vec3(-2.5f, 9, 9)), white)); }), {sunk}, 24, 18, 1);
  const TermPtr c = s.full(), light = s.picture(Form::Ratio, 1, 40), V = s.shadows(s.subset[0]);
  const auto P = s.g->floats("P");
  int looked = 0;
  for (size_t p = 0; p < s.pixels(); ++p) {
    if (P[3 * p] < -2.4f || std::abs(P[3 * p + 1]) > 1e-4f || !(c->floats("diffuse")[3 * p] > 0.0f)) continue;
    ++looked;
    ASSERT_EQ(light->floats("diffuse")[3 * p], 0.0f) << p;
    ASSERT_EQ(V->floats("V")[p], 0.0f) << p;
  }
  EXPECT_GT(looked, 100);
}

TEST(SubtractiveLights, OneLampCastsTheAnalyticShadowOfABall) {
  const Vec3 centre(0.2f, 0.9f, 0.1f), at(0.6f, 2.6f, -0.3f);
  const float radius = 0.4f;
  LampStage s(floorScene([&](SceneMaker& m, int white) { m.instance(m.mesh(tests::sphere(centre, radius, 96, false), white)); }),
              {lamp(LightKind::Point, at, Vec3(5.0f, 3.0f, 1.0f))}, 61, 47, 1);
  const auto P = s.g->floats("P");
  for (const Form form : kForms) {
    const TermPtr light = s.picture(form, 1, 1);
    int dark = 0, bright = 0;
    for (size_t p = 0; p < s.pixels(); ++p) {
      const Vec3 x(P[3 * p], P[3 * p + 1], P[3 * p + 2]);
      if (std::abs(x.y) > 1e-4f) continue;
      const Vec3 d = glm::normalize(at - x), to = centre - x;
      const float off = glm::length(to - d * glm::dot(to, d));
      if (std::abs(off - radius) < 0.01f) continue;  // of its facets
      const Vec3 to2 = at - x;
      const float e = d.y / glm::dot(to2, to2) / kPi;
      const float power[3] = {5, 3, 1};
      (off < radius ? dark : bright)++;
      for (size_t c = 0; c < 3; ++c) ASSERT_NEAR(light->floats("diffuse")[3 * p + c], off < radius ? 0.0f : power[c] * e, 3e-6f * power[c]) << int(form);
    }
    EXPECT_GT(dark, 30);
    EXPECT_GT(bright, 500);
  }
}

/// A floor under three directions along one slope; a lid hides what comes from the left.
struct UnderALid {
  // Irradiances on the floor: 6 from the left, hidden; 4 and 1 from the right.
  static std::vector<Light> lamps() {
    const float slope = 1.0f / std::sqrt(2.0f), floor = kPi / slope;
    return {lamp(LightKind::Directional, Vec3(0), Vec3(1, 1, 1) * floor, Vec3(-1, -1, 0)),
            lamp(LightKind::Directional, Vec3(0), Vec3(6.0f) * floor, Vec3(1, -1, 0)),
            lamp(LightKind::Directional, Vec3(0), Vec3(4.0f) * floor, Vec3(-1, -1, 0))};
  }
  static ScenePtr scene() {
    return floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::quad(Vec3(-9000, 2000, 6000), Vec3(8500, 0, 0), Vec3(0, 0, -12000)), white)); });
  }
};

TEST(SubtractiveLights, WhatHasNoRayIsSeenAsTheOthersOnTheMean) {
  LampStage s(UnderALid::scene(), UnderALid::lamps(), 9, 7, 1);
  const struct {
    int most;
    float expected;
  } cases[] = {{1, 0.0f}, {2, 11.0f * 4.0f / 10.0f}, {3, 5.0f}, {40, 5.0f}};
  for (const auto& k : cases)
    for (const int r : {1, 3})
      for (const Form form : kForms) {
        const TermPtr light = s.picture(form, r, k.most);
        for (const float v : light->floats("diffuse")) ASSERT_NEAR(v, k.expected, 2e-5f) << k.most << " r " << r << " form " << int(form);
      }
}

TEST(SubtractiveLights, HoweverFewRaysTheSamplesHaveTheLightOfAllLamps) {
  LampStage s(stageScene(), manyLamps(24), 40, 30);
  const TermPtr own = s.ownLight(s.traced(1, 5)), c = s.full();
  double mean[2] = {0, 0};
  for (size_t k = 0; k < 2; ++k)
    for (const float v : c->floats(k ? "specular" : "diffuse")) mean[k] += double(v) / double(c->floats("diffuse").size());
  for (size_t k = 0; k < 2; ++k) {
    ASSERT_GT(mean[k], 0.001);
    const auto a = own->floats(k ? "specular" : "diffuse"), b = c->floats(k ? "specular" : "diffuse");
    for (size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(a[i], b[i], 1e-5 * (double(b[i]) + 0.01 * mean[k])) << k << " " << i;
  }
  // Moments: of lamps that together have the light of all.
  LampStage lid(UnderALid::scene(), UnderALid::lamps(), 3, 3, 1);
  const TermPtr two = lid.traced(1, 2);
  for (size_t p = 0; p < lid.pixels(); ++p) {
    ASSERT_NEAR(two->floats("moments")[4 * p], 52.0f * 1.21f, 1e-3f);
    ASSERT_NEAR(two->floats("moments")[4 * p + 1], 16.0f * 1.21f, 1e-3f);
  }
}

TEST(SubtractiveLights, TheRestOfALobeIsSeenAsItsOthersThenAsTheOtherLobeThenWhole) {
  subtractive::Arrivals arrivals;
  arrivals.lights.resize(2);
  arrivals.lights[0].lobe[0] = Vec3(3.0f);
  arrivals.lights[1].lobe[0] = Vec3(1.0f);
  arrivals.rest[0] = DVec3(4.0);
  arrivals.rest[1] = DVec3(2.0, 0.0, 8.0);
  const subtractive::SampleSums some = sumsOf(arrivals, std::vector<char>{1, 0});
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(some.unshadowed[0][c], 8.0, 1e-12);
    EXPECT_NEAR(some.visible[0][c], 6.0, 1e-12);
    EXPECT_NEAR(some.visible[1][c], 0.75 * arrivals.rest[1][c], 1e-12) << "as the diffuse lobe";
  }
  EXPECT_NEAR(some.squares[0], 4.0 * 10.0, 1e-9);
  EXPECT_NEAR(some.seen[0], 4.0 * 9.0, 1e-9);
  EXPECT_EQ(some.squares[1], 0.0);
  arrivals.lights.clear();
  const subtractive::SampleSums none = sumsOf(arrivals, {});
  for (int k = 0; k < 2; ++k) EXPECT_EQ(none.visible[k], arrivals.rest[k]);
}

// A colour that only lamps without rays have: seen as much as the others' light.
TEST(SubtractiveLights, AColourWithoutRaysHasTheOthersShadow) {
  std::vector<Light> lamps = UnderALid::lamps();
  lamps[0].power *= Vec3(0, 0, 1);
  lamps[1].power *= Vec3(1, 0, 0);
  lamps[2].power *= Vec3(1, 0, 0);
  LampStage s(UnderALid::scene(), lamps, 9, 7, 1);
  for (const Form form : kForms) {
    const TermPtr light = s.picture(form, 1, 2);
    for (size_t p = 0; p < s.pixels(); ++p) {
      ASSERT_NEAR(light->floats("diffuse")[3 * p], 4.0f, 2e-5f) << int(form);
      ASSERT_NEAR(light->floats("diffuse")[3 * p + 2], 0.4f, 2e-5f) << int(form);
    }
  }
}

// Lamp 0 lies by the left half of the floor, lamp 1 by the right; with one ray each half has its own lamp's.
TEST(SubtractiveLights, LampsAreChosenBySampleNotForThePicture) {
  LampStage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::quad(Vec3(0, 1.0f, 20), Vec3(20, 0, 0), Vec3(0, 0, -40)), white)); }),
              {lamp(LightKind::Point, Vec3(-1.5f, 0.5f, 0), Vec3(1.0f)), lamp(LightKind::Point, Vec3(1.5f, 1.5f, 0), Vec3(50.0f))}, 41, 31, 1);
  const TermPtr traced = s.traced(1, 1);
  const auto P = s.g->floats("P"), u = traced->floats("unshadowed"), v = traced->floats("visible");
  int own = 0, lidded = 0;
  for (size_t p = 0; p < s.pixels(); ++p) {
    if (std::abs(P[3 * p + 1]) > 1e-4f) continue;
    const auto given = [&](const Vec3& at, float power) {
      const Vec3 to = at - Vec3(P[3 * p], P[3 * p + 1], P[3 * p + 2]);
      return power * to.y / std::pow(glm::length(to), 3.0f);
    };
    const float near = given(Vec3(-1.5f, 0.5f, 0), 1.0f), far = given(Vec3(1.5f, 1.5f, 0), 50.0f);
    if (std::abs(near / far - 1.0f) < 0.01f) continue;
    // Under the lid the second lamp is hidden; to the left of x = 0 it is seen from below the lid's edge or not at all, by geometry.
    const float cross = P[3 * p] + (1.5f - P[3 * p]) / 1.5f * 1.0f;  // x where the way to it passes the lid's height
    if (std::abs(cross) < 0.02f) continue;
    const bool seen = near > far || cross < 0.0f;
    (near > far ? own : lidded)++;
    ASSERT_NEAR(v[6 * p], seen ? u[6 * p] : 0.0f, 1e-6f * u[6 * p]) << p;
  }
  EXPECT_GT(own, 10);
  EXPECT_GT(lidded, 100);
}

TEST(SubtractiveLights, ThreeHundredLampsAreTheSameOnAnyThreadsAndInAWindow) {
  std::vector<Light> lamps = manyLamps(296);
  for (const Light& l : lampsOfSize()) lamps.push_back(l);
  LampStage one(stageScene(), lamps, 45, 33, 2, {}, 1), two(stageScene(), lamps, 45, 33, 2, {}, 3);
  const ViewPlace place{9, 6, 45, 33};
  LampStage part(stageScene(), lamps, 27, 25, 2, place);
  const int r = 3, halo = one.resampling(r).reach();
  const TermPtr a = one.picture(Form::Ratio, r, 20), b = two.picture(Form::Ratio, r, 20), w = part.picture(Form::Ratio, r, 20);
  double mean = 0;
  for (const char* lobe : {"diffuse", "specular"}) {
    for (size_t i = 0; i < a->floats(lobe).size(); ++i) {
      ASSERT_EQ(a->floats(lobe)[i], b->floats(lobe)[i]) << i;
      mean += double(a->floats(lobe)[i]);
    }
    for (int y = halo; y < 25 - halo; ++y)
      for (int x = halo; x < 27 - halo; ++x)
        for (size_t i = 0; i < 3; ++i)
          ASSERT_EQ(a->floats(lobe)[3 * (size_t(y + place.y) * 45 + size_t(x + place.x)) + i], w->floats(lobe)[3 * (size_t(y) * 27 + size_t(x)) + i])
              << x << "," << y;
  }
  EXPECT_GT(mean, 10.0);
}

// A mirrored stage under mirrored lamps is a mirrored picture.
TEST(SubtractiveLights, SymmetricLampsGiveASymmetricPicture) {
  std::vector<Light> lamps;
  for (const float side : {-1.0f, 1.0f})
    for (int i = 0; i < 5; ++i)
      lamps.push_back(lamp(LightKind::Point, Vec3(side * (0.4f + 0.5f * float(i)), 1.5f + 0.2f * float(i), 0.3f * float(i) - 0.5f), Vec3(1.0f)));
  LampStage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::box(Vec3(-0.5f, 0.3f, -0.4f), Vec3(0.5f, 0.7f, 0.6f)), white)); }), lamps, 48,
              36, 1);
  for (const int most : {3, 10}) {
    const TermPtr light = s.picture(Form::Ratio, 1, most);
    size_t differ = 0;
    for (size_t y = 0; y < 36; ++y)
      for (size_t x = 0; x < 24; ++x) {
        const float a = light->floats("diffuse")[3 * (y * 48 + x)], b = light->floats("diffuse")[3 * (y * 48 + 47 - x)];
        differ += std::abs(a - b) > 1e-4f * (a + b + 1e-3f);
      }
    EXPECT_LT(differ, 24u * 36u / 50u) << "more than edges";
  }
}

TEST(SubtractiveLights, LampsThatGiveNothingAreNothing) {
  const ScenePtr bare = stageScene();
  const std::vector<Light> some = manyLamps(5);
  std::vector<Light> more = some;
  more.push_back(lamp(LightKind::Point, Vec3(0, -3, 0), Vec3(100.0f)));                       // below the floor
  more.push_back(lamp(LightKind::Point, Vec3(1, 2, 1), Vec3(0.0f)));                          // off
  more.push_back(lamp(LightKind::Directional, Vec3(0), Vec3(5.0f), Vec3(0.0f, 1.0f, 0.0f)));  // from below
  Light short_ = lamp(LightKind::Point, Vec3(0, 30, 0), Vec3(1e4f));
  short_.shape.range = 1.0f;
  more.push_back(short_);
  LampStage a(floorScene([](SceneMaker&m, int white) { m.instance(m.mesh(tests::box(Vec3(-0.5f, 0.3f, -0.4f), Vec3(0.5f, 0.7f, 0.6f)), white)); }), some, 20,
              15),
      b(floorScene([](SceneMaker&m, int white) { m.instance(m.mesh(tests::box(Vec3(-0.5f, 0.3f, -0.4f), Vec3(0.5f, 0.7f, 0.6f)), white)); }), more, 20, 15);
  for (const int r : {1, 4}) {
    const TermPtr x = a.picture(Form::Ratio, r, 5), y = b.picture(Form::Ratio, r, 5);
    for (size_t i = 0; i < x->floats("diffuse").size(); ++i) ASSERT_EQ(x->floats("diffuse")[i], y->floats("diffuse")[i]) << i;
  }
  LampStage none(bare, {lamp(LightKind::Point, Vec3(0, -3, 0), Vec3(100.0f)), lamp(LightKind::Point, Vec3(1, 2, 1), Vec3(0.0f))}, 20, 15);
  for (const Form form : kForms)
    for (size_t p = 0; p < none.pixels(); ++p) {
      const TermPtr dark = none.picture(form, 2, 40);
      if (none.g->floats("Ng")[3 * p + 1] > 0.99f) { ASSERT_EQ(dark->floats("diffuse")[3 * p], 0.0f); }
      if (p % 7) break;
    }
}

TEST(SubtractiveLights, WhatUnshadowedLightLacksIsStillCounted) {
  LampStage s(stageScene(), manyLamps(3), 12, 9);
  const TermPtr c = s.full();
  auto lacking = std::make_shared<Term>(c->type(), c->domain(), c->extent());
  for (const Plane& p : c->planes()) lacking->addRaw(p.name, p.format, p.channels).bytes = p.bytes;
  lacking->addPlane<uint32_t>(kDroppedPlane)[s.pixels() + 5] = 7;
  for (const Form form : kForms) EXPECT_EQ(droppedTotal(*s.light(form, s.traced(1, 3), lacking, 3, 1)).samples, 7u);
}

// Light beyond single precision is left out and counted; nothing that is not a number leaves a node.
TEST(SubtractiveLights, OverflowIsCountedAndNothingElse) {
  LampStage s(stageScene(),
              {lamp(LightKind::Point, Vec3(0.9f, 1.3f, 0.5f), Vec3(3e38f)), lamp(LightKind::Point, Vec3(0.5f, 1.4f, 0.5f), Vec3(3e38f)),
               lamp(LightKind::Point, Vec3(-1.5f, 2, 1), Vec3(2.0f))},
              24, 18);
  const TermPtr c = s.full();
  EXPECT_GT(droppedTotal(*c).samples, 0u);
  for (const int most : {1, 3})
    for (const Form form : kForms) {
      const TermPtr light = s.light(form, s.traced(2, most), c, most, 2);
      EXPECT_GE(droppedTotal(*light).samples, droppedTotal(*c).samples);
      for (const char* plane : {"diffuse", "specular", "negative"})
        for (const float v : light->floats(plane)) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f);
    }
}

}  // namespace
}  // namespace gobo::subtractive_test
