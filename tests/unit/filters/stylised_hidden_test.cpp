// SPDX-License-Identifier: Apache-2.0
// Contours on hidden surfaces: what is peeled, what counts, and a shadow with something in front of it against the same without.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/hidden_contours.h"
#include "filters/stylised/sampled_distance.h"
#include "filters/stylised/style.h"
#include "support/run_node.h"
#include "support/shadow_stage.h"
#include "support/tiny_scenes.h"
#include "terms/hidden_surface.h"
#include "terms/visibility.h"

namespace gobo {
namespace stylised_hidden_test {

using namespace test;
using namespace tests;

constexpr int kWidth = 144, kHeight = 112;

/// A card under a sun straight above throws its shadow on a floor; a small box near the camera hides a corner of the shadow, and throws its own behind the
/// camera's view. `shelves`: cards between box and floor in the same place.
ScenePtr cardScene(bool blocked, int shelves = 0, const Vec3& sun = Vec3(0, -1, 0)) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(ground(20), grey));
  m.instance(m.mesh(quad(Vec3(-0.6f, 1, 0.6f), Vec3(1.2f, 0, 0), Vec3(0, 0, -1.2f)), grey));
  const Vec3 eye(0, 6, 6), at(0.6f, 0, 0.3f);
  if (blocked) {
    const Vec3 c = 0.8f * eye + 0.2f * at;
    m.instance(m.mesh(box(c - Vec3(0.06f), c + Vec3(0.06f)), grey));
  }
  for (int k = 0; k < shelves; ++k) {
    const Vec3 c = (0.78f - 0.02f * float(k)) * eye + (0.22f + 0.02f * float(k)) * at;
    m.instance(m.mesh(quad(c + Vec3(-0.05f, 0, 0.05f), Vec3(0.1f, 0, 0), Vec3(0, 0, -0.1f)), grey));
  }
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = glm::normalize(sun);
  m.light(s);
  m.camera(eye, Vec3(0.0f), 0.5f);
  return m.finish();
}

v1::ShadowStyle style(int hidden, int samples = 0) {
  v1::ShadowStyle s;
  s.set_power(8);
  s.set_angle_deg(45);
  s.set_hidden_layers(uint32_t(hidden));
  if (samples) s.set_samples(uint32_t(samples));
  return s;
}
ShadowRun styledRun(const ScenePtr& scene, const v1::ShadowStyle& s, int threads = 2) {
  const v1::ShadowTechnique t = rayTraced();
  const auto plan = [&](Graph& graph, const ShadowInput& input) -> Result<NodeId> {
    GOBO_ASSIGN(const NodeId v, findShadowTechnique(t.technique_case())->plan(graph, input, t));
    return planStyle(graph, input, v, s);
  };
  return runPlanned(scene, plan, {kWidth, kHeight, threads});
}
TermPtr distance(const ShadowRun& r) { return r.term("style_distance"); }

/// Largest relative difference of D where both see the same, and `apart` pixels or more from what differs.
double differs(const ShadowRun& a, const ShadowRun& b, int apart) {
  const auto ia = a.view().plane<uint32_t>("instance"), ib = b.view().plane<uint32_t>("instance");
  const auto da = distance(a)->floats("D"), db = distance(b)->floats("D");
  double most = 0;
  size_t compared = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      bool same = true;
      for (int v = std::max(y - apart, 0); v <= std::min(y + apart, kHeight - 1); ++v)
        for (int u = std::max(x - apart, 0); u <= std::min(x + apart, kWidth - 1); ++u) same = same && ia[size_t(v * kWidth + u)] == ib[size_t(v * kWidth + u)];
      if (!same) continue;
      const size_t e = size_t(y * kWidth + x);
      EXPECT_EQ(da[e] > 0, db[e] > 0);
      most = std::max(most, std::abs(double(da[e]) / double(db[e]) - 1));
      ++compared;
    }
  EXPECT_GT(compared, size_t(kWidth * kHeight) * 8 / 10);
  if (std::getenv("STYLE_PRINT")) std::printf("%.6f of D, %zu samples\n", most, compared);
  return most;
}

TEST(StyleHidden, AShadowReachesOutFromBehindWhatStandsInFrontOfIt) {
  const ShadowRun open = styledRun(cardScene(false), style(1)), behind = styledRun(cardScene(true), style(1)), without = styledRun(cardScene(true), style(0));
  size_t covered = 0;
  for (size_t e = 0; e < open.size(); ++e) covered += open.view().plane<uint32_t>("instance")[e] != behind.view().plane<uint32_t>("instance")[e];
  EXPECT_GT(covered, 200u);
  EXPECT_LT(differs(behind, open, 2), 0.01);
  EXPECT_LT(differs(behind, open, 0), 0.01) << "up to the silhouette: squares across it count";
  EXPECT_GT(differs(without, open, 2), 0.2);
  EXPECT_GT(differs(styledRun(cardScene(true), style(0)), styledRun(cardScene(false), style(0)), 2), 0.2) << "and not for the card's own";
}

double lengthOf(const ShadowRun& r, int layers) {
  const ContourInput seen = contourInput(*r.term("visibility"), r.view(), 0);
  const TaskArena arena(2);
  RunContext ctx;
  ctx.arena = &arena;
  for (const char* type : {"visibility", "gbuffer"}) ctx.inputs.push_back(r.term(type));
  NodeId before = 0;
  for (NodeId id = 0; id < r.graph.size() && int(ctx.inputs.size()) < 2 + 2 * layers; ++id)
    if (r.graph.at(id).node->type() == "hidden_surface") before = id;
    else if (r.graph.at(id).node->type() == "visibility" && before > 0)
      ctx.inputs.push_back(r.terms[size_t(id)]), ctx.inputs.push_back(r.terms[size_t(before)]);
  auto contour = *extractContour(seen, 0.7f, arena, {});
  EXPECT_TRUE(appendHiddenContours(ctx, seen, 0, layers, 0.7f, contour).ok());
  double sum = 0;
  for (const ContourSegment& s : contour) sum += double(glm::length(s.b - s.a));
  return sum;
}

TEST(StyleHidden, ContoursJoinBehindASilhouetteAndCountOnce) {
  const ShadowRun open = styledRun(cardScene(false), style(1)), behind = styledRun(cardScene(true), style(1));
  const double whole = lengthOf(open, 1);
  EXPECT_NEAR(whole, 4 * 1.2, 0.15) << "the card's shadow, part of it under the card";
  EXPECT_NEAR(lengthOf(behind, 1), whole, 1e-4 * whole);
  EXPECT_LT(lengthOf(behind, 0), 0.8 * whole);
}

TEST(StyleHidden, MoreLayersThanTheSceneIsDeepChangeNoBit) {
  const auto of = [](int n) { return distance(styledRun(cardScene(true), style(n)))->content(); };
  const Hash128 one = of(1);
  EXPECT_EQ(of(2), one);
  EXPECT_EQ(of(8), one);
  EXPECT_NE(of(0), one);
}

TEST(StyleHidden, EachLayerIsOneSurfaceMore) {  // shelves behind the box: as many layers more until the floor counts
  const ShadowRun open = styledRun(cardScene(false), style(1));
  for (const int shelves : {1, 2}) {
    EXPECT_LT(differs(styledRun(cardScene(true, shelves), style(1 + shelves)), open, 2), 0.01);
    EXPECT_GT(differs(styledRun(cardScene(true, shelves), style(shelves)), open, 2), 0.05);
  }
}

TEST(StyleHidden, PointsOfTheContourAreDrawnFromHiddenOnesToo) {
  const ShadowRun exactly = styledRun(cardScene(true), style(1)), drawn = styledRun(cardScene(true), style(1, 4096)),
                  without = styledRun(cardScene(true), style(0, 4096));
  const auto a = distance(exactly)->floats("D"), b = drawn.term("style_sampled_distance")->floats("D"), c = without.term("style_sampled_distance")->floats("D");
  double with = 0, less = 0;
  for (size_t e = 0; e < a.size(); ++e) {
    if (std::abs(a[e]) < 0.3f) continue;
    with += std::abs(double(b[e]) / double(a[e]) - 1);
    less += std::abs(double(c[e]) / double(a[e]) - 1);
  }
  EXPECT_LT(with, 0.5 * less);
}

TEST(StyleHidden, BitsDoNotDependOnThreads) {
  EXPECT_EQ(distance(styledRun(cardScene(true, 1), style(3), 1))->content(), distance(styledRun(cardScene(true, 1), style(3), 5))->content());
}

// ---- What is peeled ---------------------------------------------------------------------------------------------------------
TEST(HiddenSurface, IsTheNextThatFacesTheCamera) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  for (const float y : {3.0f, 1.0f, 0.0f}) m.instance(m.mesh(quad(Vec3(-1, y, 1), Vec3(2, 0, 0), Vec3(0, 0, -2)), grey));
  m.instance(m.mesh(box(Vec3(-1, 1.5f, -1), Vec3(1, 2, 1)), grey));
  m.instance(m.mesh(quad(Vec3(-1, 0.5f, -1), Vec3(2, 0, 0), Vec3(0, 0, 2)), grey));  // turned away
  m.camera(Vec3(0, 8, 0), Vec3(0.0f), 0.4f);
  const ScenePtr scene = m.finish();
  const ScenePtr& s = scene;
  const TaskArena arena(2);
  NodeRunner run(*s, arena);
  const GBufferSettings view{s->cameras[0], 37, 29, 3};
  TermPtr layer = run(makeGBufferNode(view), {});
  const TermPtr front = layer;
  const std::vector<std::pair<float, uint32_t>> heights{{2.0f, 3}, {1.0f, 1}, {0.0f, 2}};
  for (size_t k = 0; k <= heights.size(); ++k) {
    const TermPtr next = run(makeHiddenSurfaceNode(view), {layer});
    size_t hits = 0;
    for (size_t e = 0; e < next->extent().elements(); ++e) {
      const uint32_t instance = next->plane<uint32_t>("instance")[e];
      const Vec3 p(next->floats("P")[3 * e], next->floats("P")[3 * e + 1], next->floats("P")[3 * e + 2]);
      if (instance == ~0u) {
        EXPECT_TRUE(std::isinf(next->floats("depth")[e]));
        EXPECT_EQ(p, Vec3(0.0f));
        EXPECT_EQ(next->floats("footprint")[e], 0.0f);
        continue;
      }
      ASSERT_LT(k, heights.size());
      ++hits;
      if (front->plane<uint32_t>("instance")[e] != 0) continue;
      // Straight down the same ray: past the border of the one above it another may be met.
      if (instance == heights[k].second) {
        EXPECT_NEAR(p.y, heights[k].first, 1e-5f);
        EXPECT_EQ(next->floats("N")[3 * e + 1], 1.0f);
        const Vec3 q(front->floats("P")[3 * e], front->floats("P")[3 * e + 1], front->floats("P")[3 * e + 2]), eye(0, 8, 0);
        EXPECT_LT(glm::length(glm::cross(glm::normalize(p - eye), glm::normalize(q - eye))), 1e-5f);
        EXPECT_NEAR(next->floats("depth")[e], glm::length(p - eye), 1e-4f);
      } else EXPECT_TRUE(std::abs(p.x) > 0.7f || std::abs(p.z) > 0.7f) << k;
      EXPECT_NE(instance, 4u) << "turned away from the camera";
    }
    EXPECT_EQ(hits > 0, k < heights.size());
    layer = next;
  }
}

TEST(HiddenSurface, HardVisibilityIsThatOfTheLightsCentre) {
  const auto scene = [](bool area) {
    SceneMaker m;
    const int grey = m.material(Vec3(0.5f));
    m.instance(m.mesh(ground(4), grey));
    m.instance(m.mesh(quad(Vec3(-0.5f, 1, 0.5f), Vec3(1, 0, 0), Vec3(0, 0, -1)), grey));
    LightShape s;
    s.kind = area ? LightKind::Rect : LightKind::Point;
    s.position = Vec3(0.7f, 3, 0);
    m.light(s);
    m.camera(Vec3(0, 6, 6), Vec3(0.0f), 0.6f);
    return m.finish();
  };
  const ScenePtr rect = scene(true), point = scene(false);
  const TaskArena arena(2);
  NodeRunner a(*rect, arena), b(*point, arena);
  VisibilitySettings s;
  s.extent = {48, 40, 2};
  s.samples = 1;
  s.hard = true;
  const GBufferSettings view{rect->cameras[0], 48, 40, 2};
  const auto ga = a(makeGBufferNode(view), {}), gb = b(makeGBufferNode(view), {});
  const auto va = a(makeVisibilityNode(s), {ga}, {0});
  s.seed = 99;
  EXPECT_EQ(a(makeVisibilityNode(s), {ga}, {0})->content(), va->content()) << "nothing is drawn";
  s.hard = false;
  const auto vb = b(makeVisibilityNode(s), {gb}, {0});
  size_t dark = 0, unlike = 0;
  for (size_t e = 0; e < s.extent.elements(); ++e) dark += vb->floats("V")[e] < 0.5f, unlike += va->floats("V")[e] != vb->floats("V")[e];
  EXPECT_GT(dark, 100u);
  EXPECT_LE(unlike, 4u);
}

}  // namespace stylised_hidden_test
}  // namespace gobo
