// SPDX-License-Identifier: Apache-2.0
// Subtractive samples from visibilities of the few lights: with those that rays find, they are the samples that rays make.
#include <gtest/gtest.h>

#include <cmath>

#include "subtractive_stage.h"
#include "techniques/subtractive/styled_samples.h"
#include "terms/visibility.h"

namespace gobo::subtractive_test {
namespace styled_test {

/// Of each light by the house's rays.
std::vector<TermPtr> visibilities(Stage& s, const std::vector<DistantLightSample>& lights) {
  auto scene = std::make_shared<Scene>(*s.scene);
  const int first = int(scene->lights.size());
  for (size_t i = 0; i < lights.size(); ++i) {
    Light l;
    l.name = "sky" + std::to_string(i);
    l.shape.kind = LightKind::Directional;
    l.shape.axis = -lights[i].direction;
    scene->lights.push_back(l);
  }
  EXPECT_TRUE(scene->seal().ok());
  tests::NodeRunner run(*scene, s.arena);
  VisibilitySettings v;
  v.samples = 1;
  v.extent = s.view.extent();
  std::vector<TermPtr> out;
  for (size_t i = 0; i < lights.size(); ++i) out.push_back(run(makeVisibilityNode(v), {s.g}, {first + int(i)}));
  return out;
}
TermPtr visible(const Stage& s, float v) {
  auto out = std::make_shared<Term>("visibility", Domain::ViewSample, s.view.extent());
  for (float& x : out->addPlane<float>("V", 1)) x = v;
  return out;
}
Result<TermPtr> folded(Stage& s, const std::vector<DistantLightSample>& lights, int r, const std::vector<TermPtr>& v, int threads = 2,
                       const StopToken& stop = {}) {
  const NodePtr node = subtractive::makeStyledSamplesNode({s.view, s.resampling(r), lights});
  const auto* fold = dynamic_cast<const FoldNode*>(node.get());
  std::vector<TermPtr> inputs{s.g, s.surface};
  inputs.insert(inputs.end(), v.begin(), v.end());
  std::vector<TermShape> shapes;
  for (const TermPtr& t : inputs) {
    TermShape shape{t->type(), t->domain(), t->extent(), {}};
    for (const Plane& p : t->planes()) shape.planes.push_back({p.name, p.format, p.channels});
    shapes.push_back(shape);
  }
  const Result<TermShape> shape = node->infer(shapes);
  EXPECT_TRUE(shape.ok()) << shape.status().toString();
  const TaskArena arena(threads);
  RunContext ctx;
  ctx.arena = &arena;
  ctx.stop = stop;
  auto state = fold->begin(ctx, {s.g, s.surface});
  for (size_t i = 0; i < v.size(); ++i) GOBO_TRY(fold->step(ctx, *state, int(i), {v[i]}));
  ctx.result = makeTerm(*shape);
  return fold->finish(ctx, std::move(state));
}
void expectSame(const Term& a, const Term& b) {
  for (const char* plane : {"unshadowed", "visible", "moments"})
    for (size_t i = 0; i < a.floats(plane).size(); ++i) ASSERT_EQ(a.floats(plane)[i], b.floats(plane)[i]) << plane << " at " << i;
  const auto ta = a.plane<uint8_t>("traced"), tb = b.plane<uint8_t>("traced");
  for (size_t i = 0; i < ta.size(); ++i) ASSERT_EQ(ta[i], tb[i]) << i;
}

TEST(SubtractiveStyled, WithTheVisibilityOfRaysTheyAreTheSamplesOfRaysToTheBit) {
  Stage s(stageScene(), 33, 25);
  auto lights = skyOf(21);
  lights.push_back({Vec3(0, -1, 0), Vec3(5.0f)});  // below most horizons
  const auto v = visibilities(s, lights);
  size_t traced = 0;
  for (const int r : {1, 3, 4}) {
    const TermPtr rays = s.samples(lights, r);
    for (const int threads : {1, 3}) {
      const Result<TermPtr> sums = folded(s, lights, r, v, threads);
      ASSERT_TRUE(sums.ok());
      expectSame(*rays, **sums);
    }
    for (const uint8_t t : rays->plane<uint8_t>("traced")) traced += t;
  }
  EXPECT_GT(traced, 1000u);
}

TEST(SubtractiveStyled, SharesAreSharesOfEachLight) {
  Stage s(stageScene(), 20, 15);
  const auto lights = skyOf(5);
  std::vector<TermPtr> v;
  for (const float share : {0.25f, 1.0f, 0.0f, 0.5f, 7.0f}) v.push_back(visible(s, share));  // no more than all of it
  const TermPtr sums = *folded(s, lights, 1, v);
  std::vector<TermPtr> alone;
  for (size_t i = 0; i < 5; ++i) alone.push_back(s.samples({lights[i]}, 1));
  const float share[5] = {0.25f, 1.0f, 0.0f, 0.5f, 1.0f};
  for (size_t e = 0; e < sums->plane<uint8_t>("traced").size(); ++e)
    for (size_t k = 0; k < 6; ++k) {
      double u = 0, seen = 0;
      for (size_t i = 0; i < 5; ++i)
        u += double(alone[i]->floats("unshadowed")[6 * e + k]), seen += double(share[i]) * double(alone[i]->floats("unshadowed")[6 * e + k]);
      EXPECT_NEAR(sums->floats("unshadowed")[6 * e + k], u, 1e-6 * (1 + u));
      EXPECT_NEAR(sums->floats("visible")[6 * e + k], seen, 1e-6 * (1 + u));
    }
  for (size_t e = 0; e < sums->plane<uint8_t>("traced").size(); ++e)
    for (size_t k = 0; k < 2; ++k) {
      double squares = 0, seen = 0;
      for (size_t i = 0; i < 5; ++i) {
        const double square = double(alone[i]->floats("moments")[4 * e + 2 * k]);
        squares += square, seen += double(share[i]) * square;
      }
      EXPECT_NEAR(sums->floats("moments")[4 * e + 2 * k], squares, 1e-6 * (1 + squares));
      EXPECT_NEAR(sums->floats("moments")[4 * e + 2 * k + 1], seen, 1e-6 * (1 + squares));
    }
}

// Everything is seen: C to the bit, whatever the form and the resolution.
TEST(SubtractiveStyled, WithoutShadowsLightIsTheUnshadowedToTheBit) {
  Stage s(stageScene(), 33, 25);
  const auto lights = skyOf(9);
  const TermPtr c = s.unshadowed([](size_t e, size_t k, size_t i) { return 0.1f + 0.37f * float((e * 7 + k * 3 + i) % 11); });
  const std::vector<TermPtr> all(9, visible(s, 1.0f));
  const auto instance = s.g->plane<uint32_t>("instance");
  for (const int r : {1, 4}) {
    const TermPtr sums = *folded(s, lights, r, all);
    for (const Form form : kForms) {
      const TermPtr light = s.light(form, sums, c, 9, r);
      for (size_t i = 0; i < light->floats("diffuse").size(); ++i) {
        float mean = 0;
        for (size_t layer = 0; layer < 2; ++layer)
          if (instance[layer * s.pixels() + i / 3] != ~0u) mean += c->floats("diffuse")[layer * 3 * s.pixels() + i] * 0.5f;
        ASSERT_EQ(light->floats("diffuse")[i], mean) << r << " " << int(form) << " at " << i;
      }
    }
  }
}

TEST(SubtractiveStyled, StopsAtAnyStep) {
  Stage s(stageScene(), 20, 15);
  const auto lights = skyOf(3);
  const std::vector<TermPtr> all(3, visible(s, 1.0f));
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  for (const size_t steps : {size_t(0), size_t(3)}) {
    const Result<TermPtr> sums = folded(s, {lights.begin(), lights.begin() + long(steps)}, 2, {all.begin(), all.begin() + long(steps)}, 2, stop.token());
    ASSERT_FALSE(sums.ok());
    EXPECT_EQ(sums.status().code(), Code::Cancelled);
  }
}

}  // namespace styled_test
}  // namespace gobo::subtractive_test
