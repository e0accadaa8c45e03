// SPDX-License-Identifier: Apache-2.0
// Sample count and variance nodes on states written by hand.
#include "filters/sample_statistics.h"

#include <gtest/gtest.h>

#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

constexpr int kStreams = 4, kBlock = 16;

/// One pixel, one slot: `sums` by stream, `blocks` dealt out in turn.
TermPtr state(const std::vector<float>& sums, uint32_t blocks, int slots = 1) {
  auto t = std::make_shared<Term>("path_trace", Domain::Pixel, Extent{1, 1, 1});
  t->addPlane<double>("sum", slots * 3);
  t->addPlane<uint32_t>("samples", 1)[0] = blocks * kBlock;
  auto parts = t->addPlane<float>("streams", kStreams * slots * 3);
  for (size_t k = 0; k < sums.size(); ++k)
    for (int c = 0; c < 3; ++c) parts[(k * slots + size_t(slots - 1)) * 3 + c] = sums[k] * float(c + 1);
  return t;
}

float variance(std::vector<VarianceWeight> weights, const std::vector<TermPtr>& states, int channel = 0) {
  return runFilter(makeVarianceNode(std::move(weights), int(states.size()), 1, 1, kStreams), states)->floats("variance")[channel];
}

TEST(SampleStatistics, VarianceOfTheMeanOfEqualStreams) {
  // Means 1, 2, 3, 6: sample variance 14 / 3, of their mean 14 / 12.
  const auto s = state({16, 32, 48, 96}, 4);
  EXPECT_FLOAT_EQ(variance({{0, 0}}, {s}), 14.0f / 12);
  EXPECT_FLOAT_EQ(variance({{0, 0}}, {s}, 2), 9 * 14.0f / 12) << "channels on their own";
  EXPECT_FLOAT_EQ(variance({{0, 0, Vec3(3.0f, 1, 1)}}, {s}), 9 * 14.0f / 12) << "gains squared";
  EXPECT_FLOAT_EQ(variance({{0, 1}}, {state({16, 32, 48, 96}, 4, 2)}), 14.0f / 12) << "the slot that was asked for";
}

TEST(SampleStatistics, UnequalAndMissingStreams) {
  // 5 blocks: stream 0 has two. Means 2, 2, 3, 6; N = 5 blocks, mean 3; sum n d^2 = 2 + 1 + 0 + 9 = 12 blocks; / (3 * 5).
  EXPECT_FLOAT_EQ(variance({{0, 0}}, {state({64, 32, 48, 96}, 5)}), 12.0f / 15);
  EXPECT_FLOAT_EQ(variance({{0, 0}}, {state({16, 48, 0, 0}, 2)}), 1.0f) << "means 1 and 3";
  EXPECT_EQ(variance({{0, 0}}, {state({16, 0, 0, 0}, 1)}), -1.0f) << "one stream says nothing";
  EXPECT_EQ(variance({{0, 0}}, {state({0, 0, 0, 0}, 0)}), -1.0f);
  EXPECT_EQ(variance({}, {}), 0.0f) << "nothing scatters";
}

TEST(SampleStatistics, APartOfTheFirstBlockIsOneStream) {
  auto s = state({8, 0, 0, 0}, 0);
  const_cast<Term&>(*s).writable<uint32_t>("samples")[0] = 8;
  EXPECT_EQ(variance({{0, 0}}, {s}), -1.0f);
}

// Streams of two states share their random numbers: what they err together must not count as independent.
TEST(SampleStatistics, StatesAreAddedBeforeTheyAreCompared) {
  const auto a = state({16, 32, 48, 96}, 4), b = state({96, 80, 64, 16}, 4);  // a + b is 7 in every stream
  EXPECT_FLOAT_EQ(variance({{0, 0}, {1, 0}}, {a, b}), 0.0f);
  EXPECT_FLOAT_EQ(variance({{0, 0}, {1, 0}}, {a, a}), 4 * 14.0f / 12);
}

TEST(SampleStatistics, SampleCountIsTheSmallest) {
  const auto node = makeSampleCountNode(1, 1);
  EXPECT_EQ(runFilter(node, {state({}, 5), state({}, 3), state({}, 4)})->floats("count")[0], 48.0f);
  EXPECT_EQ(runFilter(node, {})->floats("count")[0], 0.0f);
}

}  // namespace
}  // namespace gobo
