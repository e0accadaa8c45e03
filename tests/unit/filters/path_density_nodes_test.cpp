// SPDX-License-Identifier: Apache-2.0
// The nodes of path density: what they say of themselves, and that they pass on what the library makes.
#include "filters/path_density/nodes.h"
#include "filters/path_density/trace_samples.h"
#include "path_density_clouds.h"
#include "support/tiny_scenes.h"
#include "trace/accel.h"

namespace gobo {
namespace path_density_nodes_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::unit;

std::shared_ptr<Term> termOf(const PathSamples& samples) {
  const SampleView v = samples.view();
  auto t = std::make_shared<Term>("path_samples", Domain::List, Extent{int(v.size()), 1, 1});
  std::copy(v.film.begin(), v.film.end(), t->addPlane<float>("film", 2).begin());
  std::copy(v.direct.begin(), v.direct.end(), t->addPlane<float>("direct", 3).begin());
  std::copy(v.indirect.begin(), v.indirect.end(), t->addPlane<float>("indirect", 3).begin());
  return t;
}
Result<TermPtr> ran(const NodePtr& node, std::vector<TermPtr> inputs, int threads) {
  const TaskArena arena(threads);
  RunContext ctx;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  return runNode(*node, ctx);
}
Hash128 keyOf(const NodePtr& node) {
  Hasher h;
  node->hashParameters(h);
  return h.digest();
}

TEST(PathDensityNodes, TheFilterPassesOnWhatTheLibraryMakesForAnyNumberOfThreads) {
  const auto samples = evenSamples(23, 14, 12, 30, [](uint64_t i, const Vec2&) { return Vec3(unit(30, i, 3) < 0.02 ? 80.0f : 0.4f, 0.3f, 0.2f); });
  Settings s;
  s.judged = Judged::Together;
  s.density = true;
  const auto node = makePathDensityNode(s, 23, 14);
  EXPECT_TRUE(node->traits().facets == Facet::None);
  const TaskArena arena(2);
  const auto f = rejectOutliers(samples.view(), s, arena);
  ASSERT_TRUE(f.ok());
  for (const int threads : {1, 2, 5}) {
    const auto out = ran(node, {termOf(samples)}, threads);
    ASSERT_TRUE(out.ok()) << out.status().toString();
    const auto same = [&](const char* name, const std::vector<float>& expected) {
      const auto plane = (*out)->floats(name);
      EXPECT_TRUE(std::equal(plane.begin(), plane.end(), expected.begin(), expected.end())) << name;
    };
    same("rgb", f->rgb);
    same("rejected", f->rejected);
    same("weight", f->weight);
    same("density", f->density);
  }
  s.neighbours = 1000;
  EXPECT_EQ(ran(makePathDensityNode(s, 23, 14), {termOf(samples)}, 1).status().code(), Code::InvalidArgument);
  // Wrong wiring is found while planning.
  const TermShape wrong{"path_samples", Domain::List, {5, 1, 1}, {plane<float>("film", 2), plane<float>("direct", 1), plane<float>("indirect", 3)}};
  EXPECT_FALSE(node->infer({&wrong, 1}).ok());
}

TEST(PathDensityNodes, EverySettingReachesTheKey) {
  const auto base = keyOf(makePathDensityNode({}, 8, 8));
  const std::function<void(Settings&)> changes[] = {[](Settings& s) { s.metric.filmScale = 2; },
                                                    [](Settings& s) { s.metric.colourScale = 2; },
                                                    [](Settings& s) { s.metric.white = 2; },
                                                    [](Settings& s) { s.metric.space = ColourSpace::Rgb; },
                                                    [](Settings& s) { s.neighbours = 7; },
                                                    [](Settings& s) { s.soft = 1; },
                                                    [](Settings& s) { s.hard = 4; },
                                                    [](Settings& s) { s.judged = Judged::Apart; },
                                                    [](Settings& s) { s.border = Border::Correct; },
                                                    [](Settings& s) { s.density = true; },
                                                    [](Settings& s) { s.spread = 1; },
                                                    [](Settings& s) { s.mostSpread = 2; },
                                                    [](Settings& s) { s.treeEpsilon = 0; }};
  for (size_t i = 0; i < std::size(changes); ++i) {
    Settings s;
    changes[i](s);
    EXPECT_NE(keyOf(makePathDensityNode(s, 8, 8)), base) << i;
  }
  EXPECT_NE(keyOf(makePathDensityNode({}, 9, 8)), base);
  EXPECT_NE(keyOf(makePathDensityNode({}, 8, 9)), base);
}

TEST(PathDensityNodes, TracedSamplesHaveTheTracersMeans) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::box(Vec3(-2, 0, -2), Vec3(2, 3, 2), true), m.material(Vec3(0.7f, 0.5f, 0.3f))));
  LightShape lamp;
  lamp.kind = LightKind::Rect;
  lamp.position = Vec3(0, 2.9f, 0);
  lamp.u = Vec3(0.5f, 0, 0);
  lamp.v = Vec3(0, 0, 0.5f);
  lamp.axis = Vec3(0, -1, 0);
  m.light(lamp, Vec3(4.0f, 3.0f, 2.0f));
  m.camera(Vec3(0.1f, 1.3f, 1.8f), Vec3(0, 1.9f, 0), 1.1f);
  tests::Traced t(m.finish(), 9, 7);
  t.settings.blockSize = 16;
  const auto tracer = t.tracer();
  uint64_t rays = 0, dropped = 0;
  const auto samples = traceSamples(*tracer, t.settings, 0, 2, size_t(1) << 20, t.arena, rays, dropped);
  ASSERT_TRUE(samples.ok()) << samples.status().toString();
  ASSERT_EQ(samples->size(), 9u * 7 * 32);
  EXPECT_GT(rays, samples->size());
  const auto mean = pathdensitytest::meansOf(samples->view());
  double indirect = 0, direct = 0;
  for (const float v : samples->view().indirect) indirect += double(v);
  for (const float v : samples->view().direct) direct += double(v);
  EXPECT_GT(indirect, 0.05 * direct);
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 9; ++x) {
      double sum[3] = {};
      for (const uint32_t block : {0u, 1u}) tracer->traceBlock(x, y, block, sum, rays, dropped);
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean[size_t(3 * (y * 9 + x) + c)], sum[c] / 32, 1e-5 * (1 + sum[c] / 32)) << x << "," << y;
    }
  // The same through the node, and its limit.
  PathSamplesSettings s{t.settings, 2, size_t(1) << 20};
  const auto node = makePathSamplesNode(s);
  const auto shape = node->infer({});
  ASSERT_TRUE(shape.ok());
  EXPECT_EQ(shape->extent.elements(), 9u * 7 * 32);
  AccelCache accels;
  const SceneView view = t.view();
  RunContext ctx;
  ctx.scene = &view;
  ctx.arena = &t.arena;
  ctx.accels = &accels;
  const auto out = runNode(*node, ctx);
  ASSERT_TRUE(out.ok()) << out.status().toString();
  const auto film = (*out)->floats("film");
  EXPECT_TRUE(std::equal(film.begin(), film.end(), samples->view().film.begin(), samples->view().film.end()));
  s.bytes = 9 * 7 * 32 * PathSamples::kBytesOfSample - 1;
  EXPECT_EQ(runNode(*makePathSamplesNode(s), ctx).status().code(), Code::ResourceExhausted);
  PathSamplesSettings other = s;
  other.blocks = 3;
  EXPECT_NE(keyOf(makePathSamplesNode(other)), keyOf(makePathSamplesNode(s)));
  other = s;
  other.path.seed = 99;
  EXPECT_NE(keyOf(makePathSamplesNode(other)), keyOf(makePathSamplesNode(s)));
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  ctx.stop = stop.token();
  EXPECT_EQ(runNode(*node, ctx).status().code(), Code::Cancelled);
}

}  // namespace path_density_nodes_test
}  // namespace gobo
