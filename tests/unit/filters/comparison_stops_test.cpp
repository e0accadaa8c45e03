// SPDX-License-Identifier: Apache-2.0
// Comparisons over wide kernels look for a stop all along, and what a task takes of a picture changes no bit of it.
#include <gtest/gtest.h>

#include <cstring>

#include "filters/soft_shadow/soft_shadow.h"
#include "support/stopping.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Pattern = v1::PercentageCloserShadow;

struct Picture {
  int width = 0, height = 0;
  ViewPlace place;
};
/// Of the picture's plane z = 0.8 over the whole map.
TermPtr receiversOf(const Picture& p) {
  auto term = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{p.width, p.height, 1});
  const auto P = term->addPlane<float>("P", 3), N = term->addPlane<float>("N", 3), Ng = term->addPlane<float>("Ng", 3);
  const auto footprint = term->addPlane<float>("footprint");
  const auto instance = term->addPlane<uint32_t>("instance");
  const int filmWidth = p.place.whole() ? p.width : p.place.filmWidth, filmHeight = p.place.whole() ? p.height : p.place.filmHeight;
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const size_t i = size_t(y) * size_t(p.width) + size_t(x);
      P[3 * i] = (float(x + p.place.x) + 0.5f) / float(filmWidth);
      P[3 * i + 1] = (float(y + p.place.y) + 0.5f) / float(filmHeight);
      P[3 * i + 2] = 0.8f;
      N[3 * i + 2] = Ng[3 * i + 2] = -1.0f;
      footprint[i] = 0.0f;
      instance[i] = 0;
    }
  return term;
}
/// Bars of 16 texels at two depths, and a ground.
TermPtr bars(int side) {
  return depthMap(side, [](int x, int y) { return x / 16 % 3 == 0 ? 0.2f : y / 16 % 4 == 0 ? 0.5f : 0.9f; });
}

PercentageCloserSoftLookup wideLight(int side, bool dense) {
  PercentageCloserSoftLookup l;
  l.frames = oneFace(unitFrame());
  l.map = unitLookup(side).map;
  l.view = {Vec3(0, 0, -1), false};
  l.light.size = Vec2(4.0f);  // the whole map from anywhere
  l.light.half = Vec2(2.0f);
  l.dense = dense;
  return l;
}

Result<TermPtr> runUntil(const NodePtr& node, std::vector<TermPtr> inputs, const StopToken& stop) {
  const TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  ctx.stop = stop;
  return runNode(*node, ctx);
}

// Each kernel is the whole map, 2 x 4 million texels: 4096 receivers are ten seconds' work, and would be one task's.
TEST(ComparisonStops, DenseKernelsLookBetweenReceivers) {
  constexpr int side = 2048;
  const NodePtr node = makePercentageCloserSoftNode(wideLight(side, true));
  const TermPtr bounds = depthBounds(bars(side)), view = receiversOf({64, 64, {}});
  for (const int poll : {3, 20}) {
    StopSource stop;
    stop.stopAtPoll(poll);
    const auto result = runUntil(node, {view, bounds}, stop.token());
    ASSERT_FALSE(result.ok()) << "it looked at most " << poll << " times";
    EXPECT_EQ(result.status().code(), Code::Cancelled);
  }
}

// A stop in the last task of all is seen by that task alone.
TEST(ComparisonStops, AStopAtAnyPollIsNoResult) {
  const NodePtr node = makePercentageCloserSoftNode(wideLight(160, true));
  const TermPtr bounds = depthBounds(bars(160)), view = receiversOf({20, 9, {}});
  const int polls = tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(runUntil(node, {view, bounds}, s).ok()); });
  EXPECT_GT(polls, 180);
  for (const int poll : {1, polls / 3, polls / 2, polls - 1, polls})
    EXPECT_EQ(runUntil(node, {view, bounds}, tests::stopAt(poll)).status().code(), Code::Cancelled) << poll << " of " << polls;
}

// One receiver's kernels in a map of 4096 x 4096 are twice 16 million texels, 20 ms.
TEST(ComparisonStops, OneReceiverOfALargeMapLooksAllAlong) {
  constexpr int side = 4096;
  const NodePtr node = makePercentageCloserSoftNode(wideLight(side, true));
  const TermPtr bounds = depthBounds(bars(side)), view = receiversOf({1, 1, {}});
  const int polls = tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(runUntil(node, {view, bounds}, s).ok()); });
  EXPECT_GE(polls, 32);
  for (const int poll : {1, polls / 4, 3 * polls / 4, polls}) EXPECT_FALSE(runUntil(node, {view, bounds}, tests::stopAt(poll)).ok()) << poll << " of " << polls;
}

TEST(ComparisonStops, WideBlursLookRowByRow) {
  constexpr int side = 100, blur = 24;  // four strips of rows, which read others above and below
  const NodePtr node = makeShadowEncodeNode(makeExponentialBasis(20.0f, false), blur, side, 1, false);
  const TermPtr z = bars(side);
  const int polls = tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(runUntil(node, {z}, s).ok()); });
  EXPECT_GE(polls, 2 * side);
  for (const int poll : {1, 30, polls / 2, polls}) EXPECT_FALSE(runUntil(node, {z}, tests::stopAt(poll)).ok()) << poll << " of " << polls;
}

PercentageCloserLookup wide(int side, Pattern::Pattern pattern, int size) {
  PercentageCloserLookup l = unitComparison(side, pattern, size);
  l.skip = false;
  return l;
}

TEST(ComparisonStops, WiderKernelsAreSmallerTasks) {
  const TermPtr z = bars(128), bounds = depthBounds(z), view = receiversOf({64, 32, {}});  // 2048
  const auto polls = [&](const NodePtr& node, const TermPtr& map) {
    return tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(runUntil(node, {view, map}, s).ok()); });
  };
  const int least = polls(makePercentageCloserNode(wide(128, Pattern::REGULAR, 2)), z);
  EXPECT_GE(polls(makePercentageCloserNode(wide(128, Pattern::GAUSSIAN, 64)), z), least + 12);
  EXPECT_GT(polls(makePercentageCloserNode(wide(128, Pattern::POISSON, 16)), bounds), least);
  PercentageCloserSoftLookup taps = wideLight(128, false);
  taps.searchTaps = taps.filterTaps = 1024;
  EXPECT_GT(polls(makePercentageCloserSoftNode(taps), bounds), least);
}

// Parts of the picture begin and end their blocks and tasks elsewhere.
TEST(ComparisonStops, TasksAndBlocksChangeNoBit) {
  constexpr int side = 96, width = 90, height = 70;
  const TermPtr z = bars(side), bounds = depthBounds(z);
  using Make = std::function<NodePtr(const ViewPlace&)>;
  const auto soft = [&](bool dense) -> Make {
    return [&, dense](const ViewPlace& place) {
      PercentageCloserSoftLookup l = wideLight(side, dense);
      l.light.size = Vec2(0.3f);
      l.light.half = Vec2(0.15f);
      l.place = place;
      return makePercentageCloserSoftNode(l);
    };
  };
  const auto hard = [&](Pattern::Pattern pattern, int size) -> Make {
    return [=](const ViewPlace& place) {
      PercentageCloserLookup l = wide(side, pattern, size);
      l.place = place;
      return makePercentageCloserNode(l);
    };
  };
  struct Case {
    const char* name;
    Make make;
    TermPtr map;
  };
  const std::vector<Case> cases{{"dense", soft(true), bounds},
                                {"taps", soft(false), bounds},
                                {"gaussian", hard(Pattern::GAUSSIAN, 20), z},
                                {"poisson", hard(Pattern::POISSON, 8), bounds},
                                {"regular", hard(Pattern::REGULAR, 5), z}};
  for (const Case& c : cases) {
    const std::vector<float> whole = values(runNode(c.make({}), {receiversOf({width, height, {}}), c.map}), "V");
    size_t between = 0;
    for (const float v : whole) between += v > 0 && v < 1;
    EXPECT_GT(between, whole.size() / 10) << c.name << ": there is something to compare";
    for (const Picture& part : {Picture{width, 1, {0, 17, width, height}}, {37, 41, {11, 20, width, height}}, {width, 69, {0, 1, width, height}}}) {
      const std::vector<float> V = values(runNode(c.make(part.place), {receiversOf(part), c.map}), "V");
      for (int y = 0; y < part.height; ++y)
        EXPECT_EQ(std::memcmp(&V[size_t(y) * size_t(part.width)], &whole[size_t(y + part.place.y) * width + size_t(part.place.x)],
                              sizeof(float) * size_t(part.width)),
                  0)
            << c.name << ", row " << y << " of " << part.height;
    }
  }
}

}  // namespace
