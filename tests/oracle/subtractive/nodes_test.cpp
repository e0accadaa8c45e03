// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows against closed forms and against the house's own lights and shadow rays.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "subtractive_stage.h"
#include "terms/direct_unoccluded.h"
#include "terms/dropped_samples.h"
#include "terms/visibility.h"

namespace gobo::subtractive_test {
namespace {

using subtractive::FewLights;

FewLights few(float u, float v, float squares = 0, float seen = 0) { return {Vec3(u), Vec3(v), squares, seen}; }

TEST(Subtract, FormsAreTheirFormulas) {
  const Vec3 c(2.0f, 1.0f, 0.5f), albedo(0.5f, 1.0f, 0.25f);
  const FewLights one{Vec3(4.0f, 2.0f, 8.0f), Vec3(1.0f, 2.0f, 0.0f), 0, 0}, none = few(0, 0);
  EXPECT_EQ(subtract(Form::Ratio, c, albedo, one, none, 3), Vec3(0.5f, 1.0f, 0.0f));
  EXPECT_EQ(subtract(Form::Difference, c, albedo, one, none, 3), Vec3(2.0f - 1.5f, 1.0f, 0.5f - 2.0f));
}

TEST(Subtract, AllAndNothingInShadow) {
  const Vec3 c(2.0f, 1.0f, 0.5f), albedo(0.7f, 0.3f, 0.9f);
  for (const Form form : kForms) EXPECT_EQ(subtract(form, c, albedo, few(3, 3, 5, 5), few(0, 0), 4), c) << int(form);
  EXPECT_EQ(subtract(Form::Ratio, c, albedo, few(3, 0, 5, 0), few(0, 0), 4), Vec3(0.0f));
  const Vec3 beta = subtract(Form::Beta, c, albedo, few(3, 0, 5, 0), few(0, 0), 4);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(beta[i], 0.0f, 1e-6f);
  const Vec3 difference = subtract(Form::Difference, c, albedo, few(3, 0, 5, 0), few(0, 0), 4);
  for (int i = 0; i < 3; ++i) EXPECT_FLOAT_EQ(difference[i], c[i] - albedo[i] * 3.0f);
}

TEST(Subtract, ChannelsWithoutLightHaveTheShadowOfTheOthersThenOfTheOtherLobe) {
  const Vec3 c(1.0f), albedo(1.0f);
  const Vec3 blue = subtract(Form::Ratio, c, albedo, {Vec3(0, 0, 2), Vec3(0, 0, 0.5f), 0, 0}, few(1, 1), 1);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(blue[i], 0.25f, 1e-6f) << i;
  const Vec3 other = subtract(Form::Ratio, c, albedo, few(0, 0), few(4, 3), 1);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(other[i], 0.75f, 1e-6f) << i;
  EXPECT_EQ(subtract(Form::Ratio, c, albedo, few(0, 0), few(0, 0), 1), c) << "no light above the horizon: no shadow";
}

// Lights x of which every one with x > 2 is hidden: the regression's weight by hand.
TEST(Subtract, BetaIsTheRegressionOverTheLights) {
  const float x[] = {1, 2, 3, 6};
  FewLights f;
  double mean = 0, seen = 0;
  for (const float v : x) {
    f.unshadowed += Vec3(v), f.squares += v * v, mean += v / 4;
    if (v <= 2) f.visible += Vec3(v), f.seen += v * v, seen += v / 4;
  }
  double variance = 0, covariance = 0;
  for (const float v : x) variance += (v - mean) * (v - mean), covariance += (v - mean) * ((v <= 2 ? v : 0) - seen);
  const double beta = std::clamp(covariance / variance, 0.0, 1.0), c = 10.0;
  EXPECT_EQ(beta, 0.0) << "what is seen falls with the light";
  EXPECT_NEAR(subtract(Form::Beta, Vec3(10.0f), Vec3(1.0f), f, few(0, 0), 4).x, 3.0 + beta * (c - 12.0), 1e-5);
  FewLights g;  // hidden are the dim ones
  mean = seen = variance = covariance = 0;
  for (const float v : x) mean += v / 4, seen += (v > 1 ? v : 0) / 4;
  for (const float v : x) {
    g.unshadowed += Vec3(v), g.squares += v * v;
    if (v > 1) g.visible += Vec3(v), g.seen += v * v;
    variance += (v - mean) * (v - mean), covariance += (v - mean) * ((v > 1 ? v : 0) - seen);
  }
  const double b = covariance / variance;
  ASSERT_GT(b, 1.0);
  EXPECT_NEAR(subtract(Form::Beta, Vec3(10.0f), Vec3(1.0f), g, few(0, 0), 4).x, 11.0 + 1.0 * (c - 12.0), 1e-5) << "no more than 1";
  // Between: lights 1, 2, 4, 5 (mean 3, variance 5 / 2), of which one of h > 3 is hidden before a share s of the samples that speak: covariance
  // 5 / 2 - s h (h - 3) / 4. All of 4: b = 3 / 5; half of 4: 4 / 5; half of 4 and of 5: 3 / 10; all of 5: 0.
  const double u = 12.0, squares = 46.0;
  const struct { double hidden, hiddenSquares, weight; } between[] = {{4.0, 16.0, 0.6}, {2.0, 8.0, 0.8}, {4.5, 20.5, 0.3}, {5.0, 25.0, 0.0}};
  for (const auto& k : between) {
    const FewLights h = few(float(u), float(u - k.hidden), float(squares), float(squares - k.hiddenSquares));
    for (const float a : {1.0f, 0.5f})
      EXPECT_NEAR(subtract(Form::Beta, Vec3(10.0f), Vec3(a), h, few(0, 0), 4).x, a * (u - k.hidden) + k.weight * (10.0 - a * u), 1e-5) << k.hidden << " " << a;
  }
}

TEST(SubtractiveNodes, WithoutAnOccluderLightIsTheUnshadowedToTheBit) {
  for (const int size : {1, 23}) {
    Stage s(floorScene([](SceneMaker&, int) {}, Vec3(0.3f, 0.0f, 0.9f)), size, size, 3);
    const TermPtr c = s.unshadowed([](size_t e, size_t k, size_t i) { return 0.1f + 0.37f * float((e * 7 + k * 3 + i) % 11); });
    for (const int r : {1, 2, 4, 5, 32})
      for (const Form form : kForms) {
        const TermPtr light = s.light(form, s.samples(skyOf(13), r), c, 13, r);
        for (size_t k = 0; k < 2; ++k) {
          const auto out = light->floats(k ? "specular" : "diffuse"), full = c->floats(k ? "specular" : "diffuse");
          for (size_t i = 0; i < out.size(); ++i) {
            float mean = 0;
            for (size_t layer = 0; layer < 3; ++layer) mean += full[layer * 3 * s.pixels() + i] * (1.0f / 3.0f);
            ASSERT_EQ(out[i], mean) << "r " << r << " form " << int(form) << " lobe " << k << " at " << i;
          }
        }
        for (const float n : light->floats("negative")) ASSERT_EQ(n, 0.0f);
      }
  }
}

/// The same lights by the house's own nodes: unoccluded light x visibility, or without that.
std::vector<double> additive(Stage& s, const std::vector<DistantLightSample>& lights, bool shadows = true) {
  auto scene = std::make_shared<Scene>(*s.scene);
  for (size_t i = 0; i < lights.size(); ++i) {
    Light l;
    l.name = "sky" + std::to_string(i);
    l.shape.kind = LightKind::Directional;
    l.shape.axis = -lights[i].direction;
    l.power = lights[i].irradiance;
    scene->lights.push_back(l);
  }
  EXPECT_TRUE(scene->seal().ok());
  tests::NodeRunner run(*scene, s.arena);
  std::vector<double> out(3 * s.pixels(), 0.0);
  for (size_t i = 0; i < lights.size(); ++i) {
    DirectUnoccludedSettings d;
    d.view = s.view;
    d.light = int(scene->lights.size() - lights.size() + i);
    d.nominal = lights[i].irradiance;
    d.samples = 1;
    const TermPtr L = run(makeDirectUnoccludedNode(d), {s.g, s.surface}, {d.light});
    VisibilitySettings v;
    v.samples = 1;
    v.extent = s.view.extent();
    const TermPtr V = run(makeVisibilityNode(v), {s.g}, {d.light});
    const auto l = L->floats("L"), seen = V->floats("V");
    for (size_t e = 0; e < seen.size(); ++e)
      for (size_t c = 0; c < 3; ++c) out[3 * (e % s.pixels()) + c] += double(l[3 * e + c]) * (shadows ? double(seen[e]) : 1.0) / s.view.viewSamples;
  }
  return out;
}

TEST(SubtractiveNodes, AllLightsAtFullResolutionAreTheirDirectLight) {
  Stage s(stageScene(), 40, 30);
  const auto lights = skyOf(24);
  const std::vector<double> truth = additive(s, lights);
  const TermPtr samples = s.samples(lights, 1);
  const auto traced = samples->plane<uint8_t>("traced");
  const auto instance = s.g->plane<uint32_t>("instance");
  for (size_t e = 0; e < traced.size(); ++e) ASSERT_EQ(traced[e] != 0, instance[e] != ~0u) << e;
  double mean = 0;
  for (const double t : truth) mean += t / double(truth.size());
  ASSERT_GT(mean, 0.03);
  for (const Form form : kForms) {
    const TermPtr light = s.light(form, samples, s.ownLight(samples), int(lights.size()), 1);
    const auto diffuse = light->floats("diffuse"), specular = light->floats("specular");
    double most = 0;
    for (size_t i = 0; i < truth.size(); ++i) most = std::max(most, std::abs(double(diffuse[i]) + double(specular[i]) - truth[i]) / (truth[i] + 0.01 * mean));
    EXPECT_LT(most, 1e-5) << int(form);
  }
}

TEST(SubtractiveNodes, TheUnshadowedSumIsThatOfTheLightsAboveBothHorizons) {
  Stage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::sphere(Vec3(0, 1, 0), 1.5f, 12, true), white)); }), 40, 30);
  std::vector<DistantLightSample> lights = skyOf(24);
  for (DistantLightSample& l : lights) l.direction = glm::normalize(l.direction * Vec3(1, 0.15f, 1));  // along the ground: many graze the ball's facets
  const std::vector<double> truth = additive(s, lights, false);
  const TermPtr own = s.ownLight(s.samples(lights, 1));
  std::vector<double> sum(truth.size(), 0.0);
  for (size_t e = 0; e < 2 * s.pixels(); ++e)
    for (const char* lobe : {"diffuse", "specular"})
      for (size_t c = 0; c < 3; ++c) sum[3 * (e % s.pixels()) + c] += 0.5 * double(own->floats(lobe)[3 * e + c]);
  double mean = 0;
  for (const double t : truth) mean += t / double(truth.size());
  ASSERT_GT(mean, 0.01);
  for (size_t i = 0; i < truth.size(); ++i) ASSERT_NEAR(sum[i], truth[i], 1e-5 * (truth[i] + 0.01 * mean)) << i;
}

TEST(SubtractiveNodes, UnderAClosedSkyRatioAndBetaAreBlackAndNegativeLightIsCounted) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f), [](Material& x) { x.bsdf.specular = 1.0f, x.bsdf.roughness = 0.5f; });
  m.instance(m.mesh(tests::box(Vec3(-1), Vec3(1), true), grey));
  m.camera(Vec3(0.3f, 0.4f, 0.6f), Vec3(-0.5f, -0.8f, -0.6f), 1.2f);
  Stage s(m.finish(), 21, 17);
  const auto lights = skyOf(20);
  for (const int r : {1, 4}) {
    const TermPtr samples = s.samples(lights, r);
    for (const float v : samples->floats("visible")) ASSERT_EQ(v, 0.0f);
    const TermPtr c = s.unshadowed([](size_t, size_t, size_t) { return 0.25f; });
    const TermPtr ratio = s.light(Form::Ratio, samples, c, 20, r);
    // The ceiling faces no light: there nothing is in shadow, by the filter's own rule.
    const auto N = s.surface->floats("N");
    int black = 0;
    for (size_t p = 0; p < s.pixels(); ++p) {
      bool facing = true;
      for (size_t layer = 0; layer < 2; ++layer) facing &= N[3 * (p + layer * s.pixels()) + 1] > 0.5f;
      if (!facing) continue;
      ++black;
      for (size_t i = 0; i < 3; ++i) ASSERT_EQ(ratio->floats("diffuse")[3 * p + i] + ratio->floats("specular")[3 * p + i], 0.0f) << p;
    }
    EXPECT_GT(black, 50);
    for (const float n : ratio->floats("negative")) ASSERT_EQ(n, 0.0f);
    // The published form: what C lacks of the lights' sum is counted, never shown.
    const TermPtr none = s.unshadowed([](size_t, size_t, size_t) { return 0.0f; });
    const TermPtr difference = s.light(Form::Difference, samples, none, 20, r);
    for (const char* lobe : {"diffuse", "specular"})
      for (const float v : difference->floats(lobe)) ASSERT_EQ(v, 0.0f);
    if (r > 1) continue;
    const TermPtr own = s.ownLight(samples);
    double expected = 0, counted = 0;
    for (size_t e = 0; e < 2 * s.pixels(); ++e)
      for (const char* lobe : {"diffuse", "specular"}) expected += 0.5 * double(luminance(subtractive::Receivers::at(own->floats(lobe), e)));
    for (size_t p = 0; p < s.pixels(); ++p) counted += double(luminance(subtractive::Receivers::at(difference->floats("negative"), p)));
    EXPECT_GT(expected, 1.0);
    EXPECT_NEAR(counted / expected, 1.0, 1e-5);
  }
}

// A ball over a plane under one direction: who is in its shadow is known.
TEST(SubtractiveNodes, OneLightCastsTheAnalyticShadow) {
  const Vec3 centre(0.3f, 1.2f, 0.1f), towards = glm::normalize(Vec3(0.4f, 1.0f, -0.2f));
  Stage s(floorScene([&](SceneMaker& m, int white) { m.instance(m.mesh(tests::sphere(centre, 0.6f, 96, false), white)); }), 61, 47, 1);
  const std::vector<DistantLightSample> lights{{towards, Vec3(1.0f)}};
  const TermPtr c = s.unshadowed([](size_t, size_t k, size_t) { return k ? 0.0f : 0.5f; });
  const auto P = s.g->floats("P");
  for (const Form form : kForms) {
    const TermPtr samples = s.samples(lights, 1);
    const TermPtr light = s.light(form, samples, form == Form::Ratio ? c : s.ownLight(samples), 1, 1);
    int dark = 0, bright = 0;
    for (size_t p = 0; p < s.pixels(); ++p) {
      const Vec3 at(P[3 * p], P[3 * p + 1], P[3 * p + 2]);
      if (std::abs(at.y) > 1e-4f) continue;  // the ball
      const Vec3 d = centre - at;
      const float off = glm::length(d - towards * glm::dot(d, towards));
      if (std::abs(off - 0.6f) < 0.01f) continue;  // of the ball's facets
      const float expected = off < 0.6f ? 0.0f : form == Form::Ratio ? 0.5f : towards.y / kPi;
      (off < 0.6f ? dark : bright)++;
      ASSERT_NEAR(light->floats("diffuse")[3 * p], expected, 1e-6f) << int(form);
    }
    EXPECT_GT(dark, 30);
    EXPECT_GT(bright, 500);
  }
}

// A lid over a part of the sky, far away: the same share of the lights is seen from everywhere, and resampling does not change it.
TEST(SubtractiveNodes, ConstantShadowsStayAsTheyAreAtAnyResolution) {
  Stage s(floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::quad(Vec3(0.5f, 2000, 6000), Vec3(9000, 0, 0), Vec3(0, 0, -12000)), white)); }),
          37, 29);
  std::vector<DistantLightSample> lights{{glm::normalize(Vec3(0.9f, 1, 0)), Vec3(2.0f, 1, 1)}, {glm::normalize(Vec3(-0.9f, 1, 0)), Vec3(1.0f, 1, 3)}};
  const TermPtr c = s.unshadowed([](size_t, size_t, size_t) { return 1.0f; });
  for (const int r : {1, 2, 3, 8, 32}) {
    const TermPtr light = s.light(Form::Ratio, s.samples(lights, r), c, 2, r);
    const auto out = light->floats("diffuse");
    const float share[3] = {1.0f / 3, 0.5f, 0.75f};
    for (size_t i = 0; i < out.size(); ++i) ASSERT_NEAR(out[i], share[i % 3], 1e-6f) << r << " at " << i;
  }
}

/// A high terrace to the left and a low one to the right, 1.75 m apart: nearly twice what counts as one plane at 1/16 of the resolution.
ScenePtr terraces() {
  return floorScene([](SceneMaker& m, int white) {
    m.instance(m.mesh(tests::box(Vec3(-30, 0, -30), Vec3(0.03f, 2.0f, 30)), white));
    m.instance(m.mesh(tests::quad(Vec3(0.04f, 0.25f, 30), Vec3(40, 0, 0), Vec3(0, 0, -60)), white));
  });
}

TEST(SubtractiveNodes, ShadowsOfOneTerraceDoNotReachTheOther) {
  Stage s(terraces(), 48, 36, 1);
  const std::vector<DistantLightSample> lights{{glm::normalize(Vec3(-1.0f, 0.05f, 0.0f)), Vec3(1.0f)}};  // the step's shadow is 35 m long
  const TermPtr c = s.unshadowed([](size_t, size_t, size_t) { return 1.0f; });
  const auto P = s.g->floats("P");
  for (const int r : {1, 4, 8, 16}) {
    const TermPtr light = s.light(Form::Ratio, s.samples(lights, r), c, 1, r);
    int low = 0, high = 0;
    for (size_t p = 0; p < s.pixels(); ++p) {
      const bool upper = P[3 * p + 1] > 1.99f, lower = P[3 * p + 1] < 0.26f && P[3 * p + 1] > 0.24f;
      if (!upper && !lower) continue;
      (upper ? high : low)++;
      ASSERT_EQ(light->floats("diffuse")[3 * p], upper ? 1.0f : 0.0f) << "r " << r << " at " << p % 48 << "," << p / 48;
    }
    EXPECT_GT(low, 200);
    EXPECT_GT(high, 200);
  }
}

TEST(SubtractiveNodes, WhatNothingSpeaksForHasItsOwnTraced) {
  // Posts of less than a pixel's block over the floor.
  const ScenePtr scene = floorScene([](SceneMaker& m, int white) {
    for (int i = 0; i < 7; ++i) m.instance(m.mesh(tests::box(Vec3(-2.0f + 0.613f * float(i), 0, -1.5f), Vec3(-1.95f + 0.613f * float(i), 1.0f, 1.5f)), white));
  });
  Stage s(scene, 96, 72, 1);
  const auto lights = skyOf(12);
  const TermPtr full = s.samples(lights, 1), c = s.unshadowed([](size_t, size_t, size_t) { return 1.0f; });
  const TermPtr exact = s.light(Form::Ratio, full, c, 12, 1);
  const int r = 16;
  const TermPtr low = s.samples(lights, r);
  const TermPtr light = s.light(Form::Ratio, low, c, 12, r);
  const auto traced = low->plane<uint8_t>("traced");
  const auto P = s.g->floats("P");
  size_t grid = 0, own = 0, floor = 0;
  for (size_t p = 0; p < s.pixels(); ++p) {
    const int x = int(p % 96), y = int(p / 96);
    const bool on = subtractive::onGrid(s.resampling(r), s.view, x, y);
    grid += on;
    if (on) { EXPECT_TRUE(traced[p]); }
    if (P[3 * p + 1] < 0.01f) {
      floor += !on && traced[p];
      continue;
    }
    if (!traced[p] || on) continue;
    ++own;
    for (size_t i = 0; i < 3; ++i) ASSERT_EQ(light->floats("diffuse")[3 * p + i], exact->floats("diffuse")[3 * p + i]);
  }
  EXPECT_EQ(grid, 6u * 4u + 0u) << "96 / 16 columns, of 72 / 16 rows those whose middle there is";
  EXPECT_GT(own, 50u);
  EXPECT_EQ(floor, 0u);
  // What was traced is what all of them have.
  for (size_t e = 0; e < traced.size(); ++e)
    for (const char* plane : {"unshadowed", "visible"})
      for (size_t i = 0; i < 6; ++i) ASSERT_EQ(low->floats(plane)[6 * e + i], traced[e] ? full->floats(plane)[6 * e + i] : 0.0f);
}

TEST(SubtractiveNodes, TexturesDoNotGhost) {
  // Stripes without red and blue, and others, narrower than the grid: the lights' sums by albedo are those of the white one, so every pixel has its own albedo.
  const ScenePtr scene = floorScene([](SceneMaker& m, int) {
    const int black = m.material(Vec3(0.0f, 0.3f, 0.0f)), dim = m.material(Vec3(0.1f, 0.01f, 0.5f));
    for (int i = 0; i < 8; ++i)
      m.instance(m.mesh(tests::quad(Vec3(-2.0f + 0.5f * float(i), 0.001f, 2), Vec3(0.25f, 0, 0), Vec3(0, 0, -4)), i % 2 ? black : dim));
    m.instance(m.mesh(tests::quad(Vec3(0.5f, 2000, 6000), Vec3(9000, 0, 0), Vec3(0, 0, -12000)), black));
  });
  Stage s(scene, 64, 48, 1);
  const std::vector<DistantLightSample> lights{{glm::normalize(Vec3(0.9f, 1, 0)), Vec3(2.0f)}, {glm::normalize(Vec3(-0.9f, 1, 0)), Vec3(2.0f)}};
  const TermPtr c = s.ownLight(s.samples(lights, 1));
  const auto albedo = s.surface->floats("albedo");
  int onBlack = 0;
  for (size_t p = 0; p < s.pixels(); ++p) onBlack += albedo[3 * p] == 0.0f && subtractive::onGrid(s.resampling(3), s.view, int(p % 64), int(p / 64));
  ASSERT_GT(onBlack, 10);
  for (const Form form : kForms)
    for (const int r : {3, 8}) {
      const TermPtr light = s.light(form, s.samples(lights, r), c, 2, r);
      for (size_t i = 0; i < light->floats("diffuse").size(); ++i)
        ASSERT_NEAR(light->floats("diffuse")[i], albedo[i] * 2.0f / std::sqrt(1.81f) / kPi, 2e-6f) << int(form) << " at " << i;
    }
}

TEST(SubtractiveNodes, AWindowHasTheBitsOfTheWhole) {
  Stage whole(stageScene(), 45, 33);
  const auto lights = skyOf(9);
  const int r = 4, halo = whole.resampling(r).reach();
  EXPECT_EQ(halo, 8);
  const TermPtr all = whole.samples(lights, r);
  const ViewPlace place{9, 6, 45, 33};
  Stage part(whole.scene, 27, 25, 2, place);
  const TermPtr some = part.samples(lights, r);
  const auto c = [](size_t, size_t, size_t) { return 1.0f; };
  const TermPtr a = whole.light(Form::Ratio, all, whole.unshadowed(c), 9, r), b = part.light(Form::Ratio, some, part.unshadowed(c), 9, r);
  int compared = 0;
  for (int y = halo; y < 25 - halo; ++y)  // of the grid every sample is traced, others look no farther than the halo
    for (int x = halo; x < 27 - halo; ++x) {
      for (size_t i = 0; i < 3; ++i)
        ASSERT_EQ(a->floats("diffuse")[3 * (size_t(y + place.y) * 45 + size_t(x + place.x)) + i], b->floats("diffuse")[3 * (size_t(y) * 27 + size_t(x)) + i])
            << x << "," << y;
      ++compared;
    }
  EXPECT_EQ(compared, 9 * 11);
}

std::shared_ptr<Term> copyOf(const TermPtr& term) {
  auto out = std::make_shared<Term>(term->type(), term->domain(), term->extent());
  for (const Plane& p : term->planes()) out->addRaw(p.name, p.format, p.channels).bytes = p.bytes;
  return out;
}

// Samples whose footprint is no length speak for nobody, themselves included: they have the shadows that were traced at them.
TEST(SubtractiveNodes, WithoutAFootprintASampleHasItsOwnTraced) {
  Stage s(stageScene(), 33, 25);
  const auto lights = skyOf(12);
  const TermPtr c = s.unshadowed([](size_t, size_t, size_t) { return 1.0f; });
  std::vector<TermPtr> exact;
  for (const Form form : kForms) exact.push_back(s.light(form, s.samples(lights, 1), c, 12, 1));
  const TermPtr whole = s.g;
  for (const float footprint : {0.0f, -1.0f, std::numeric_limits<float>::quiet_NaN(), 1e-42f}) {
    auto broken = copyOf(whole);
    for (float& f : broken->writable<float>("footprint")) f = footprint;
    s.g = broken;
    const TermPtr samples = s.samples(lights, 4);
    const auto instance = whole->plane<uint32_t>("instance");
    const auto traced = samples->plane<uint8_t>("traced");
    for (size_t e = 0; e < traced.size(); ++e) ASSERT_EQ(traced[e] != 0, instance[e] != ~0u) << footprint << " at " << e;
    for (const Form form : kForms) {
      const TermPtr light = s.light(form, samples, c, 12, 4);
      EXPECT_EQ(droppedTotal(*light).samples, 0u);
      for (const char* lobe : {"diffuse", "specular"}) {
        const auto out = light->floats(lobe), expected = exact[size_t(form)]->floats(lobe);
        for (size_t i = 0; i < out.size(); ++i) ASSERT_EQ(out[i], expected[i]) << footprint << " form " << int(form) << " " << lobe << " at " << i;
      }
    }
  }
  // Nothing was traced either: counted.
  const TermPtr samples = s.run(subtractive::makeSamplesNode({s.view, s.resampling(4), lights}), {whole, s.surface});
  auto none = copyOf(samples);
  for (uint8_t& t : none->writable<uint8_t>("traced")) t = 0;
  const TermPtr light = s.light(Form::Ratio, none, c, 12, 4);
  for (const float v : light->floats("diffuse")) ASSERT_EQ(v, 0.0f);
  EXPECT_GT(droppedTotal(*light).samples, 1000u);
}

TEST(SubtractiveNodes, NoLightsAreNoShadows) {
  Stage s(stageScene(), 20, 15);
  const TermPtr none = s.samples({}, 2), c = s.unshadowed([](size_t, size_t, size_t) { return 1.0f; });
  for (const Form form : kForms) {
    const TermPtr light = s.light(form, none, c, 1, 2);
    const auto out = light->floats("diffuse");
    const auto instance = s.g->plane<uint32_t>("instance");
    for (size_t p = 0; p < s.pixels(); ++p)
      if (instance[p] != ~0u && instance[p + s.pixels()] != ~0u) { ASSERT_EQ(out[3 * p], 1.0f) << int(form); }
  }
}

}  // namespace
}  // namespace gobo::subtractive_test
