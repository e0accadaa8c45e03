// SPDX-License-Identifier: Apache-2.0
// Hints of what an extendable node can go on from: whoever is at it keeps his, however many others there were.
#include <gtest/gtest.h>

#include <algorithm>

#include "plan/extension_index.h"

namespace gobo::testing {
namespace {

Hash128 recipe(int i) { return Hasher("recipe").add(i).digest(); }

TermPtr state(int width) { return std::make_shared<Term>("state", Domain::List, Extent{width, 1, 1}); }

TEST(ExtensionIndex, SaysLargestFirst) {
  ExtensionIndex index;
  for (const uint32_t blocks : {4u, 1u, 16u, 4u}) index.add(recipe(0), blocks);
  EXPECT_EQ(index.below(recipe(0), 16), (std::vector<uint32_t>{4, 1}));
  EXPECT_EQ(index.below(recipe(0), 17), (std::vector<uint32_t>{16, 4, 1}));
  EXPECT_TRUE(index.below(recipe(0), 1).empty());
  EXPECT_TRUE(index.below(recipe(1), 100).empty());
}

TEST(ExtensionIndex, ManyOthersTakeNothingFromWhoeverGoesOn) {
  ExtensionIndex index;
  index.add(recipe(-1), 1);
  for (int i = 0; i < 20000; ++i) {
    index.add(recipe(i), 1);
    if (i % 1000 == 0) index.add(recipe(-1), uint32_t(i / 1000 + 2));
  }
  EXPECT_EQ(index.below(recipe(-1), 1000).size(), 21u);
  EXPECT_TRUE(index.below(recipe(0), 1000).empty()) << "bounded";
  EXPECT_FALSE(index.below(recipe(19999), 1000).empty());
  for (uint32_t blocks = 1; blocks < 10000; ++blocks) index.add(recipe(-1), blocks);
  const auto some = index.below(recipe(-1), 10000);
  EXPECT_LT(some.size(), 1000u) << "bounded";
  EXPECT_EQ(some.front(), 9999u);
}

TEST(ExtensionIndex, TheLatestParkedStatesStay) {
  ExtensionIndex index;
  for (int i = 1; i <= 100; ++i) index.park(recipe(i), 4, state(i));
  const TermPtr last = index.takeParked(recipe(100), 4);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->extent().width, 100);
  EXPECT_FALSE(index.takeParked(recipe(100), 4)) << "once";
  EXPECT_TRUE(index.takeParked(recipe(99), 4) && index.takeParked(recipe(90), 4));
  EXPECT_FALSE(index.takeParked(recipe(1), 4)) << "bounded";
  index.park(recipe(7), 4, state(7));
  index.add(recipe(7), 1);
  index.clear();
  EXPECT_FALSE(index.takeParked(recipe(7), 4));
  EXPECT_TRUE(index.below(recipe(7), 9).empty());
}

// A viewer that asks for a few samples of a picture that somebody else has traced for minutes: what the other has stays his.
TEST(ExtensionIndex, WhoAsksForLessTakesNothingFromWhoAskedForMore) {
  ExtensionIndex index;
  index.park(recipe(0), 256, state(256));
  EXPECT_FALSE(index.takeParked(recipe(0), 1));
  index.park(recipe(0), 2, state(2));  // stopped as well
  EXPECT_EQ(index.takeParked(recipe(0), 4)->extent().width, 2);
  EXPECT_EQ(index.takeParked(recipe(0), 256)->extent().width, 256);
  EXPECT_FALSE(index.takeParked(recipe(0), 256));
  for (uint32_t blocks = 1; blocks < 100; ++blocks) index.park(recipe(0), blocks, state(int(blocks)));
  EXPECT_EQ(index.takeParked(recipe(0), 1000)->extent().width, 99);
  EXPECT_FALSE(index.takeParked(recipe(0), 50)) << "bounded";
}

TermPtr stateOf(int width) {
  const auto term = std::make_shared<Term>("state", Domain::List, Extent{width, 1, 1});
  (void)term->addPlane<float>("sum");
  return term;
}

// Stopped states of large pictures are gigabytes each.
TEST(ExtensionIndex, ParkedStatesStayWithinTheirBytes) {
  const uint64_t one = stateOf(1000)->bytes();
  ASSERT_GE(one, 4000u);
  ExtensionIndex index(3 * one);
  for (int i = 1; i <= 5; ++i) {
    index.park(recipe(i), 4, stateOf(1000));
    EXPECT_EQ(index.parkedBytes(), uint64_t(std::min(i, 3)) * one) << i;
  }
  EXPECT_FALSE(index.takeParked(recipe(2), 4));
  EXPECT_TRUE(index.takeParked(recipe(4), 4));
  EXPECT_EQ(index.parkedBytes(), 2 * one);
  index.park(recipe(3), 4, stateOf(1000));  // in its own place
  EXPECT_EQ(index.parkedBytes(), 2 * one);
  index.park(recipe(6), 4, stateOf(10000));
  EXPECT_EQ(index.parkedBytes(), stateOf(10000)->bytes()) << "one stays whatever it takes, or a large render would never end";
  index.shrinkParked(one);
  EXPECT_EQ(index.parkedBytes(), 0u);
  EXPECT_FALSE(index.takeParked(recipe(6), 4));
  for (int i = 1; i <= 3; ++i) index.park(recipe(i), 4, stateOf(1000));
  index.shrinkParked(2 * one);
  EXPECT_FALSE(index.takeParked(recipe(1), 4)) << "the oldest goes";
  EXPECT_TRUE(index.takeParked(recipe(2), 4));
  index.clear();
  EXPECT_EQ(index.parkedBytes(), 0u);
}

}  // namespace
}  // namespace gobo::testing
