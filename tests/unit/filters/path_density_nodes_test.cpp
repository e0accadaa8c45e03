// SPDX-License-Identifier: Apache-2.0
// The nodes of path density: what they say of themselves, and that they pass on what the library makes.
#include <set>
#include <tuple>

#include "filters/outliers/nodes.h"
#include "filters/outliers/white.h"
#include "filters/path_density/nodes.h"
#include "filters/path_density/trace_samples.h"
#include "path_density_clouds.h"
#include "support/tiny_scenes.h"
#include "terms/dropped_samples.h"
#include "trace/accel.h"
#include "trace/sample_passes.h"

namespace gobo {
namespace path_density_nodes_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::unit;

/// Pixels of `n` samples each, in order.
std::shared_ptr<Term> termOf(const PathSamples& samples) {
  const SampleView v = samples.view();
  const int n = int(v.size()) / (v.width * v.height);
  const SampleBins bins = binSamples(v);
  auto t = std::make_shared<Term>("path_samples", Domain::Pixel, Extent{v.width, v.height, 1});
  const auto film = t->addPlane<float>("film", 2 * n), light = t->addPlane<float>("light", 3 * n);
  size_t to = 0;
  for (int y = 0; y < v.height; ++y)
    for (int x = 0; x < v.width; ++x)
      for (size_t k = bins.pixelBegin(x, y); k < bins.pixelEnd(x, y); ++k, ++to) {
        const size_t i = bins.order[k];
        for (size_t c = 0; c < 2; ++c) film[2 * to + c] = v.film[2 * i + c];
        for (size_t c = 0; c < 3; ++c) light[3 * to + c] = v.direct[3 * i + c] + v.indirect[3 * i + c];
      }
  EXPECT_EQ(to * 2, film.size());
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
  for (const auto& [extent, film, light] : std::vector<std::tuple<Extent, int, int>>{{{23, 14, 1}, 8, 11}, {{23, 14, 1}, 3, 3}, {{14, 23, 1}, 2, 3}}) {
    const TermShape wrong{"path_samples", Domain::Pixel, extent, {plane<float>("film", film), plane<float>("light", light)}};
    EXPECT_FALSE(node->infer({&wrong, 1}).ok()) << film << " " << light;
  }
}

// White by the median pixel of the samples and the rest of the picture, whatever single samples are.
TEST(PathDensityNodes, WhiteIsThatOfTheWholePicture) {
  const auto samples = evenSamples(15, 11, 8, 31, [](uint64_t i, const Vec2&) { return Vec3(unit(31, i, 3) < 0.01 ? 5000.0f : 0.25f); });
  auto rest = std::make_shared<Term>("composite", Domain::Pixel, Extent{15, 11, 1});
  for (float& v : rest->addPlane<float>("rgb", 3)) v = 0.75f;
  const auto term = termOf(samples);
  const auto white = outliers::whiteOfSamples(pathSamplesOf(*term), rest->floats("rgb"), TaskArena(2), {});
  ASSERT_TRUE(white.ok());
  EXPECT_NEAR(*white, 1.0f / 0.18f, 1e-3f);
  Settings s;
  s.metric.white = 0;
  const auto chosen = ran(makePathDensityNode(s, 15, 11), {term, rest}, 2);
  s.metric.white = *white;
  const auto given = ran(makePathDensityNode(s, 15, 11), {term}, 1);
  ASSERT_TRUE(chosen.ok() && given.ok()) << chosen.status().toString() << given.status().toString();
  EXPECT_EQ((*chosen)->content(), (*given)->content());
  const auto same = ran(outliers::makeReweightedMeanNode({0.0f, 8.0f, 4.0f}, 15, 11), {term, rest}, 2);
  const auto by = ran(outliers::makeReweightedMeanNode({*white, 8.0f, 4.0f}, 15, 11), {term}, 2);
  ASSERT_TRUE(same.ok() && by.ok());
  EXPECT_EQ((*same)->content(), (*by)->content());
  // Nothing to see by: 1. A sky of no light is no pixel of the picture.
  const std::vector<float> black(3 * 6 * 4, 0.0f);
  EXPECT_EQ(*outliers::whiteOf(black, 6, 4, TaskArena(1)), 1.0f);
  std::vector<float> half(3 * 6 * 9, 0.0f);
  std::fill(half.begin() + 3 * 6 * 6, half.end(), 0.36f);
  EXPECT_NEAR(*outliers::whiteOf(half, 6, 9, TaskArena(1)), 2.0f, 1e-5f);
  // Bright pixels in every window, but in none more than half.
  std::vector<float> spotted(3 * 12 * 12, 0.18f);
  for (int y = 1; y < 12; y += 2)
    for (int x = 1; x < 12; x += 2) std::fill_n(spotted.begin() + 3 * (y * 12 + x), 3, 90.0f);
  EXPECT_NEAR(*outliers::whiteOf(spotted, 12, 12, TaskArena(1)), 1.0f, 1e-5f);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(outliers::whiteOf(half, 6, 9, TaskArena(1), stop.token()).status().code(), Code::Cancelled);
}

TEST(PathDensityNodes, TheEstimatorsNodesMakeWhatTheLibraryMakes) {
  const auto samples =
      evenSamples(13, 9, 7, 32, [](uint64_t i, const Vec2&) { return Vec3(unit(32, i, 3) < 0.1 ? 90.0f : 0.4f, 0.3f, float(unit(32, i, 4))); });
  const auto term = termOf(samples);
  const SampleView v = pathSamplesOf(*term);
  const SampleBins bins = binSamples(v);
  const std::vector<std::pair<NodePtr, std::vector<float>>> nodes = {
      {outliers::makeTrimmedMeanNode(0.2, 13, 9), outliers::trimmedMean(v, bins, 0.2)},
      {outliers::makeMedianOfMeansNode(5, 13, 9), outliers::adaptiveMedianOfMeans(v, bins, 5)},
      {outliers::makeReweightedMeanNode({2.0f, 3.0f, 5.0f}, 13, 9), outliers::reweightedMean(v, bins, {2.0f, 3.0f, 5.0f})},
  };
  std::set<std::string> keys;
  for (const auto& [node, expected] : nodes) {
    for (const int threads : {1, 3}) {
      const auto out = ran(node, {term}, threads);
      ASSERT_TRUE(out.ok()) << out.status().toString();
      const auto plane = (*out)->floats("rgb");
      EXPECT_TRUE(std::equal(plane.begin(), plane.end(), expected.begin(), expected.end())) << node->type();
    }
    EXPECT_NE(expected, outliers::meanPicture(v, bins)) << node->type();
    keys.insert(keyOf(node).hex());
    // A stopped one says so.
    RunContext ctx;
    const TaskArena arena(2);
    StopSource stop;
    stop.stop(StopReason::Cancelled);
    ctx.inputs = {term};
    ctx.arena = &arena;
    ctx.stop = stop.token();
    EXPECT_EQ(runNode(*node, ctx).status().code(), Code::Cancelled) << node->type();
  }
  for (const NodePtr& other :
       {outliers::makeTrimmedMeanNode(0.2, 13, 9, 2), outliers::makeTrimmedMeanNode(0.3, 13, 9), outliers::makeTrimmedMeanNode(0.2, 14, 9),
        outliers::makeTrimmedMeanNode(0.2, 13, 8), outliers::makeMedianOfMeansNode(6, 13, 9), outliers::makeReweightedMeanNode({2.5f, 3.0f, 5.0f}, 13, 9),
        outliers::makeReweightedMeanNode({2.0f, 3.5f, 5.0f}, 13, 9), outliers::makeReweightedMeanNode({2.0f, 3.0f, 5.5f}, 13, 9)})
    EXPECT_TRUE(keys.insert(keyOf(other).hex()).second) << other->type();
}

// The picture of the first samples is theirs by the weights that they have among all; where nothing is rejected their mean.
TEST(PathDensityNodes, TheFirstSamplesAreWeighedAmongAll) {
  const int n = 8, first = 3;
  const auto samples =
      evenSamples(14, 10, n, 34, [](uint64_t i, const Vec2&) { return Vec3(unit(34, i, 3) < 0.03 ? 200.0f : 0.4f, 0.3f, float(unit(34, i, 4))); });
  const auto term = termOf(samples);
  const SampleView v = pathSamplesOf(*term);
  const size_t pixels = 14 * 10;
  const auto meanOfFirst = [&](size_t p, size_t c) {
    double sum = 0;
    for (size_t i = 0; i < size_t(first); ++i) sum += double(v.indirect[3 * (p * size_t(n) + i) + c]);
    return sum / first;
  };
  Settings open;
  open.soft = open.hard = 1e6f;
  open.first = first;
  const std::vector<NodePtr> keepAll = {makePathDensityNode(open, 14, 10), outliers::makeTrimmedMeanNode(0, 14, 10, first),
                                        outliers::makeMedianOfMeansNode(1, 14, 10, first), outliers::makeReweightedMeanNode({1e9f, 8, 4}, 14, 10, first)};
  for (const NodePtr& node : keepAll) {
    const auto out = ran(node, {term}, 2);
    ASSERT_TRUE(out.ok()) << out.status().toString();
    for (size_t p = 0; p < pixels; ++p)
      for (size_t c = 0; c < 3; ++c) ASSERT_NEAR((*out)->floats("first")[3 * p + c], meanOfFirst(p, c), 1e-5 * (1 + meanOfFirst(p, c))) << node->type();
  }
  // Without what comes back: sum w L / sum w over the first, w of all.
  Settings s;
  s.first = first;
  s.spread = 0;
  s.soft = 1;  // some weights between
  s.hard = 4;
  s.neighbours = 5;
  const TaskArena arena(2);
  const auto f = rejectOutliers(v, s, arena);
  const auto sigma = sigmasOf(v, s, LightTerm::Indirect, arena);
  ASSERT_TRUE(f.ok() && sigma.ok()) << f.status().toString();
  size_t partial = 0;
  for (size_t p = 0; p < pixels; ++p) {
    double weights = 0, sum[3] = {};
    for (size_t i = p * size_t(n); i < p * size_t(n) + size_t(first); ++i) {
      const double w = double(weightOf((*sigma)[i], s));
      partial += w > 0 && w < 1;
      weights += w;
      for (size_t c = 0; c < 3; ++c) sum[c] += w * double(v.indirect[3 * i + c]);
    }
    for (size_t c = 0; c < 3; ++c) {
      const double expected = weights > 0 ? sum[c] / weights : double(f->rgb[3 * p + c]);
      ASSERT_NEAR(f->first[3 * p + c], expected, 1e-5 * (1 + expected)) << p;
    }
  }
  EXPECT_GT(partial, 10u);
  // What comes back makes both brighter by as much.
  s.spread = 4;
  const auto back = rejectOutliers(v, s, arena);
  ASSERT_TRUE(back.ok());
  size_t more = 0;
  for (size_t i = 0; i < f->rgb.size(); ++i) {
    more += back->rgb[i] > 1.01f * f->rgb[i];
    ASSERT_NEAR(back->first[i] * f->rgb[i], back->rgb[i] * f->first[i], 1e-4 * (1 + std::abs(double(back->rgb[i]) * f->first[i]))) << i;
  }
  EXPECT_GT(more, 20u);
  // No weight in the first ones: what all keep stands for them.
  PathSamples dark(1, 1);
  for (int i = 0; i < 40; ++i) ASSERT_TRUE(dark.add(0, 0, Vec2(0.5f), Vec3(0.0f), Vec3(i < 1 ? 500.0f : 0.5f)).ok());
  s.first = 1;
  s.spread = 0;
  const auto alone = rejectOutliers(dark.view(), s, arena);
  ASSERT_TRUE(alone.ok());
  EXPECT_FLOAT_EQ(alone->first[0], 0.5f);
  // Re-weighting: the cascades' weights are those of all samples.
  const auto bins = binSamples(v);
  SampleBins part = bins;
  const auto same = outliers::reweightedPart(v, bins, part, {0.2f, 4, 4}), all = outliers::reweightedMean(v, bins, {0.2f, 4, 4});
  EXPECT_EQ(same, all);
}

// More neighbours than even light has: as many as it has, where that is asked for.
TEST(PathDensityNodes, FewerNeighboursWhereThereAreTooFew) {
  const auto samples = evenSamples(12, 10, 2, 33, [](uint64_t i, const Vec2&) { return Vec3(unit(33, i, 3) < 0.05 ? 80.0f : 0.4f); });
  const TaskArena arena(1);
  Settings s;
  s.judged = Judged::Together;
  s.neighbours = mostNeighbours(2, 12, 10, s);
  const auto most = rejectOutliers(samples.view(), s, arena);
  s.neighbours = 500;
  EXPECT_EQ(rejectOutliers(samples.view(), s, arena).status().code(), Code::InvalidArgument);
  s.fewer = true;
  const auto fewer = rejectOutliers(samples.view(), s, arena);
  ASSERT_TRUE(most.ok() && fewer.ok());
  EXPECT_EQ(most->rgb, fewer->rgb);
  s.neighbours = 3;
  const auto three = rejectOutliers(samples.view(), s, arena);
  ASSERT_TRUE(three.ok());
  EXPECT_NE(three->rgb, fewer->rgb);
  s.soft = 0.0f;  // by which none is too many
  EXPECT_TRUE(rejectOutliers(samples.view(), s, arena).ok());
}

TEST(PathDensityNodes, EverySettingReachesTheKey) {
  const auto base = keyOf(makePathDensityNode({}, 8, 8));
  const std::function<void(Settings&)> changes[] = {[](Settings& s) { s.metric.filmScale = 2; },
                                                    [](Settings& s) { s.metric.colourScale = 2; },
                                                    [](Settings& s) { s.metric.white = 2; },
                                                    [](Settings& s) { s.metric.space = ColourSpace::Rgb; },
                                                    [](Settings& s) { s.neighbours = 7; },
                                                    [](Settings& s) { s.fewer = true; },
                                                    [](Settings& s) { s.soft = 1; },
                                                    [](Settings& s) { s.hard = 4; },
                                                    [](Settings& s) { s.judged = Judged::Apart; },
                                                    [](Settings& s) { s.border = Border::Correct; },
                                                    [](Settings& s) { s.density = true; },
                                                    [](Settings& s) { s.first = 3; },
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
  // The same through the node: blocks of 16 whether at once or after some.
  const PathSamplesSettings s{t.settings, {Vec3(1.0f)}, 1, {}};
  const auto node = makePathSamplesNode(s);
  AccelCache accels;
  const SceneView view = t.view();
  const auto run = [&](const NodePtr& of, uint32_t passes, TermPtr previous = nullptr, const StopToken& stop = {}) {
    RunContext ctx;
    RunCounters counters;
    ctx.scene = &view;
    ctx.arena = &t.arena;
    ctx.accels = &accels;
    ctx.counters = &counters;
    ctx.targetBlocks = passes;
    ctx.previous = std::move(previous);
    ctx.stop = stop;
    return runNode(*of, ctx);
  };
  const auto out = run(node, passesFor(32));
  ASSERT_TRUE(out.ok()) << out.status().toString();
  const auto film = (*out)->floats("film"), light = (*out)->floats("light");
  ASSERT_EQ(film.size(), samples->view().film.size());
  EXPECT_TRUE(std::equal(film.begin(), film.end(), samples->view().film.begin()));
  for (size_t i = 0; i < light.size(); ++i) {
    const float sum = samples->view().direct[i] + samples->view().indirect[i];
    ASSERT_NEAR(light[i], sum, 1e-5f * (1 + sum)) << i;
  }
  for (const uint32_t first : {1u, 3u, 5u, 6u, 7u}) {  // of 1, 4, 16, 32, 48 samples, the last of which is no beginning
    const auto some = run(node, first);
    ASSERT_TRUE(some.ok());
    const auto rest = run(node, 6, *some);
    ASSERT_TRUE(rest.ok());
    EXPECT_EQ((*rest)->content(), (*out)->content()) << first;
    EXPECT_EQ((*some)->channels("film"), 2 * int(gobo::samplesOf(first)));
  }
  // Weights of slots; a part of the picture.
  PathSamplesSettings split = s;
  split.path.split = SplitMode::DirectIndirect;
  split.weights = {Vec3(0.0f), Vec3(0.0f), Vec3(2.0f, 1.0f, 0.5f)};
  const auto bounced = run(makePathSamplesNode(split), passesFor(32));
  ASSERT_TRUE(bounced.ok());
  for (size_t i = 0; i < light.size(); ++i)
    ASSERT_NEAR((*bounced)->floats("light")[i], samples->view().indirect[i] * Vec3(2.0f, 1.0f, 0.5f)[int(i % 3)], 1e-5f * (1 + light[i])) << i;
  PathSamplesSettings part = s;
  part.view.place = {2, 1, 9, 7};
  part.view.width = 4;
  part.view.height = 3;
  const auto window = run(makePathSamplesNode(part), passesFor(32));
  ASSERT_TRUE(window.ok());
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 4; ++x)
      for (int i = 0; i < 32; ++i) {
        const size_t here = size_t((y * 4 + x) * 32 + i), there = size_t(((y + 1) * 9 + x + 2) * 32 + i);
        for (size_t c = 0; c < 3; ++c) ASSERT_EQ((*window)->floats("light")[3 * here + c], light[3 * there + c]);
        ASSERT_EQ((*window)->floats("film")[2 * here], film[2 * there] - 2);
        ASSERT_EQ((*window)->floats("film")[2 * here + 1], film[2 * there + 1] - 1);
      }
  const std::function<void(PathSamplesSettings&)> changes[] = {
      [](PathSamplesSettings& o) { o.path.seed = 99; }, [](PathSamplesSettings& o) { o.weights[0].y = 2; }, [](PathSamplesSettings& o) { o.streams = 8; },
      [](PathSamplesSettings& o) { o.view.width = 4, o.view.height = 3; }, [&](PathSamplesSettings& o) { o.view = part.view; }};
  std::set<std::string> keys{keyOf(node).hex()};
  for (const auto& change : changes) {
    PathSamplesSettings other = s;
    change(other);
    EXPECT_TRUE(keys.insert(keyOf(makePathSamplesNode(other)).hex()).second);
  }
  PathSamplesSettings wrong = s;
  wrong.weights.push_back(Vec3(1.0f));
  EXPECT_FALSE(makePathSamplesNode(wrong)->infer({}).ok());
  // What no float holds is black and counted, and goes on counting.
  PathSamplesSettings burning = s;
  burning.weights = {Vec3(3e38f)};
  const auto lost = run(makePathSamplesNode(burning), 5);
  ASSERT_TRUE(lost.ok()) << lost.status().toString();
  size_t black = 0;
  for (size_t i = 0; i < 9u * 7 * 16; ++i) black += (*lost)->floats("light")[3 * i] == 0.0f;
  EXPECT_GT(droppedTotal(**lost).samples, 0u);
  EXPECT_LE(droppedTotal(**lost).samples, black);
  const auto more = run(makePathSamplesNode(burning), 6, *lost), whole = run(makePathSamplesNode(burning), 6);
  ASSERT_TRUE(more.ok() && whole.ok());
  EXPECT_EQ((*more)->content(), (*whole)->content());
  EXPECT_GT(droppedTotal(**more).samples, droppedTotal(**lost).samples);
  const auto trimmed = ran(outliers::makeTrimmedMeanNode(0.1, 9, 7), {*lost}, 1), density = ran(makePathDensityNode({}, 9, 7), {*lost}, 1);
  ASSERT_TRUE(trimmed.ok() && density.ok());
  EXPECT_EQ(droppedTotal(**trimmed).samples, droppedTotal(**lost).samples);
  EXPECT_EQ(droppedTotal(**density).samples, droppedTotal(**lost).samples);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(run(node, 5, nullptr, stop.token()).status().code(), Code::Cancelled);
}

}  // namespace path_density_nodes_test
}  // namespace gobo
