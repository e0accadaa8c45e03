// SPDX-License-Identifier: Apache-2.0
// What the forms are worth: their variances where the share of the light that is seen, v, and the coefficient of variation of a light's contribution, c, are
// known, against the laws of control variates and ratios (per sample, by the squared mean):
//   additive v (1 - v) + v c^2,   difference v (1 - v) + (1 - v) c^2,   ratio and the best weight v (1 - v) (1 + c^2)
#include <gtest/gtest.h>

#include <random>

#include "lamp_stage.h"

namespace gobo::subtractive_test {
namespace {

/// Mean over the trials of (n variance) by the squared mean, of estimates from `n` lights each: X gamma of mean 1 and variance c^2, V 1 with chance v.
struct Variances {
  double additive = 0, form[3] = {0, 0, 0};
};
Variances variancesOf(double v, double c, int n, int trials, uint32_t seed) {
  std::mt19937 engine(seed);
  std::gamma_distribution<double> gamma(c > 0 ? 1.0 / (c * c) : 1.0, c * c);
  std::bernoulli_distribution seen(v);
  double sum[4] = {0, 0, 0, 0}, squares[4] = {0, 0, 0, 0};
  for (int t = 0; t < trials; ++t) {
    double u = 0, s = 0, u2 = 0, s2 = 0;
    for (int i = 0; i < n; ++i) {
      const double x = (c > 0 ? gamma(engine) : 1.0) / n;
      u += x, u2 += x * x;
      if (seen(engine)) s += x, s2 += x * x;
    }
    subtractive::FewLights few;
    // By an albedo of 1/2, as samples hold them.
    few.unshadowed = Vec3(float(2.0 * u));
    few.visible = Vec3(float(2.0 * s));
    few.squares = float(4.0 * u2);
    few.seen = float(4.0 * s2);
    double value[4] = {s};
    for (int k = 0; k < 3; ++k) value[k + 1] = double(subtractive::subtract(kForms[k], Vec3(1.0f), Vec3(0.5f), few, {}, n).y);
    for (int k = 0; k < 4; ++k) sum[k] += value[k], squares[k] += value[k] * value[k];
  }
  const auto variance = [&](int k) {
    const double mean = sum[k] / trials;
    EXPECT_NEAR(mean, v, 0.02) << "form " << k;
    return n * (squares[k] / trials - mean * mean);
  };
  Variances out;
  out.additive = variance(0);
  for (int k = 0; k < 3; ++k) out.form[k] = variance(k + 1);
  return out;
}

TEST(SubtractiveForms, VariancesAreThoseOfTheirLaws) {
  uint32_t seed = 1;
  for (const double v : {0.1, 0.3, 0.5, 0.7, 0.9})
    for (const double c : {0.0, 0.5, 1.0, 1.5}) {
      const Variances got = variancesOf(v, c, 256, 4000, seed++);
      const double base = v * (1 - v), best = base * (1 + c * c), additive = base + v * c * c, difference = base + (1 - v) * c * c;
      const double bound = 0.15;
      EXPECT_NEAR(got.additive, additive, bound * additive) << v << " " << c;
      EXPECT_NEAR(got.form[0], best, bound * best) << "ratio " << v << " " << c;
      EXPECT_NEAR(got.form[1], best, bound * best) << "beta " << v << " " << c;
      EXPECT_NEAR(got.form[2], difference, bound * difference) << "difference " << v << " " << c;
      // No worse than both: beta and the ratio, but for what these estimates of variances are off.
      for (const int k : {0, 1}) EXPECT_LT(got.form[k], 1.05 * std::min(got.additive, got.form[2])) << k << " " << v << " " << c;
      if (c > 0 && v > 0.6) { EXPECT_LT(got.form[2], got.additive); }
      if (c > 0 && v < 0.4) { EXPECT_GT(got.form[2], got.additive); }
    }
}

// Nothing seen, everything seen: no variance but the difference's own.
TEST(SubtractiveForms, TheEndsHaveNone) {
  const Variances none = variancesOf(0.0, 1.0, 64, 500, 5), all = variancesOf(1.0, 1.0, 64, 500, 6);
  EXPECT_EQ(none.form[0], 0.0);
  EXPECT_NEAR(none.form[1], 0.0, 1e-9);
  EXPECT_NEAR(none.form[2], 1.0, 0.2);
  for (const double x : all.form) EXPECT_NEAR(x, 0.0, 1e-9);
  EXPECT_NEAR(all.additive, 1.0, 0.2);
}

/// Shadow rays of the samples' node.
uint64_t raysOf(const LampStage& s, int r, int most) {
  const NodePtr node = subtractive::makeLightSamplesNode({s.from, s.resampling(r), most});
  const SceneView view(*s.scene, node->traits().facets, s.subset);
  AccelCache accels;
  RunCounters counters;
  RunContext c;
  c.scene = &view;
  c.inputs = {s.g, s.surface};
  c.arena = &s.own;
  c.accels = &accels;
  c.counters = &counters;
  EXPECT_TRUE(runNode(*node, c).ok());
  return counters.rays;
}

// Rays are as many as lights and as traced samples: on one plane every r-th of every r-th row, elsewhere also what none of these speaks for.
TEST(SubtractiveForms, RaysFallWithTheResolutionAndGrowWithTheLights) {
  std::vector<Light> lamps;
  for (int i = 0; i < 30; ++i) lamps.push_back(lamp(LightKind::Point, Vec3(0.1f * float(i) - 1.5f, 2.0f + 0.05f * float(i), 0.3f), Vec3(1.0f)));
  const LampStage plane(floorScene([](SceneMaker&, int) {}), lamps, 64, 48, 1), stage(stageScene(), lamps, 96, 72, 1);
  EXPECT_EQ(raysOf(plane, 1, 10), 64u * 48u * 10u);
  EXPECT_EQ(raysOf(plane, 4, 10), 16u * 12u * 10u);
  EXPECT_EQ(raysOf(plane, 8, 10), 8u * 6u * 10u);
  EXPECT_EQ(raysOf(plane, 4, 30), 3u * raysOf(plane, 4, 10));
  EXPECT_EQ(raysOf(plane, 4, 99), raysOf(plane, 4, 30));
  const double share = double(raysOf(stage, 4, 10)) / double(raysOf(stage, 1, 10));
  EXPECT_LT(share, 0.25);
  EXPECT_GT(share, 1.0 / 16.0);
}

// Everything that is known to break such a method: finite, within 0 and the unshadowed light, in every form.
TEST(SubtractiveForms, WhateverTheInputLightIsFiniteAndNoMoreThanUnshadowed) {
  const auto scaled = [](float scale) {
    SceneMaker m;
    const int grey = m.material(Vec3(0.6f)), gloss = m.material(Vec3(0.5f, 0.3f, 0.2f), [](Material&x) {
      x.bsdf.specular = 1.0f;
      x.bsdf.roughness = 0.4f;
    });
    m.instance(m.mesh(tests::ground(4.0f * scale), grey));
    m.instance(m.mesh(tests::sphere(Vec3(0.5f, 0.6f, 0.3f) * scale, 0.6f * scale, 16, true), gloss));
    m.camera(Vec3(2.5f, 1.0f, 4.0f) * scale, Vec3(0, 0.9f, 0) * scale, 1.0f);  // with some sky
    return m.finish();
  };
  const auto lit = [](float scale, int n) {
    std::vector<Light> lamps = manyLamps(n);
    for (const Light& l : lampsOfSize()) lamps.push_back(l);
    for (Light& l : lamps) {
      l.shape.position *= scale;
      l.shape.radius *= scale;
      l.shape.u *= scale;
      l.shape.v *= scale;
      if (l.shape.kind == LightKind::Point || l.shape.kind == LightKind::Spot) l.power *= scale * scale;
    }
    return lamps;
  };
  const ScenePtr walled = floorScene([](SceneMaker& m, int white) { m.instance(m.mesh(tests::box(Vec3(-40, -0.5f, -40), Vec3(40, 9, 40)), white)); });
  const Light above = lamp(LightKind::Point, Vec3(0, 1.5f, 0), Vec3(2, 3, 4)), below = lamp(LightKind::Point, Vec3(0, -2, 0), Vec3(9.0f)),
              off = lamp(LightKind::Point, Vec3(0, 2, 0), Vec3(0.0f));
  enum class Expected { Dark, Unshadowed, Hidden, Some };
  const struct {
    const char* name;
    ScenePtr scene;
    std::vector<Light> lamps;
    int width, height;
    Expected expected;
  } cases[] = {{"lights that are off", floorScene([](SceneMaker&, int) {}), {off, off}, 17, 13, Expected::Dark},
               {"below the horizon", floorScene([](SceneMaker&, int) {}), {below}, 17, 13, Expected::Dark},
               {"one light, nothing in its way", floorScene([](SceneMaker&, int) {}), {above}, 17, 13, Expected::Unshadowed},
               {"two in one place", floorScene([](SceneMaker&, int) {}), {above, above}, 17, 13, Expected::Unshadowed},
               {"one above and one below", floorScene([](SceneMaker&, int) {}), {above, below}, 17, 13, Expected::Unshadowed},
               {"all in shadow",
                walled,
                {lamp(LightKind::Point, Vec3(3, 12, 1), Vec3(200.0f)), lamp(LightKind::Directional, Vec3(0), Vec3(3.0f))},
                16,
                12,
                Expected::Hidden},
               {"one pixel", scaled(1), lit(1, 9), 1, 1, Expected::Some},
               {"one row", scaled(1), lit(1, 9), 31, 1, Expected::Some},
               {"odd sizes, holes of sky", scaled(1), lit(1, 9), 37, 23, Expected::Some},
               {"a world of 1e6", scaled(1e6f), lit(1e6f, 9), 24, 18, Expected::Some},
               {"a world of 1e-4", scaled(1e-4f), lit(1e-4f, 9), 24, 18, Expected::Some}};
  for (const auto& k : cases) {
    LampStage s(k.scene, k.lamps, k.width, k.height);
    const TermPtr c = s.full();
    double light = 0;
    for (const double x : s.meanOfSamples(c)) light += x;
    ASSERT_TRUE(std::isfinite(light)) << k.name;
    ASSERT_EQ(light > 0, k.expected != Expected::Dark) << k.name;
    size_t holes = 0;
    for (const uint32_t i : s.g->plane<uint32_t>("instance")) holes += i == ~0u;
    if (std::string(k.name) == "odd sizes, holes of sky") { ASSERT_GT(holes, 10u); }
    for (const int r : {1, 3, 4, 32})
      for (const int most : {1, 40}) {
        const TermPtr samples = s.traced(r, most);
        for (const Form form : kForms) {
          const TermPtr out = s.light(form, samples, c, std::min(most, int(k.lamps.size())), r);
          for (const float x : out->floats("negative")) ASSERT_TRUE(std::isfinite(x) && x >= 0.0f) << k.name;
          for (const char* lobe : {"diffuse", "specular"})
            for (size_t i = 0; i < out->floats(lobe).size(); ++i) {
              float mean = 0;
              for (size_t layer = 0; layer < 2; ++layer) mean += 0.5f * c->floats(lobe)[layer * 3 * s.pixels() + i];
              const float x = out->floats(lobe)[i];
              ASSERT_TRUE(std::isfinite(x) && x >= 0.0f) << k.name;
              // Beta and the difference add what resampled samples have: no more than C where these are its own (r = 1), always for the ratio.
              if (form == Form::Ratio || r == 1) { ASSERT_LE(x, mean * 1.00001f + 1e-30f) << k.name << " form " << int(form) << " r " << r; }
              if (k.expected == Expected::Hidden && form == Form::Ratio) { ASSERT_EQ(x, 0.0f) << k.name; }
              if (k.expected == Expected::Unshadowed) { ASSERT_NEAR(x, mean, 1e-6f * mean) << k.name; }
            }
        }
      }
  }
}

}  // namespace
}  // namespace gobo::subtractive_test
