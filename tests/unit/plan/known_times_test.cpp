// SPDX-License-Identifier: Apache-2.0
// KnownTimes on runs whose ratios are chosen: no clock is read.
#include "plan/known_times.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>

namespace gobo::testing {
namespace {

using From = KnownTimes::From;
const TimedNode kLamp{"hall", "visibility:lamp", "visibility"}, kSun{"hall", "visibility:sun", "visibility"},
    kElsewhere{"yard", "visibility:lamp", "visibility"}, kFilter{"hall", "filter", "filter"};

TEST(KnownTimes, TheNearestThatIsKnownIsTaken) {
  KnownTimes times;
  EXPECT_EQ(times.of(kLamp).from, From::Nothing);
  EXPECT_EQ(times.of(kLamp).value, 1.0);
  times.add(kLamp, 10, 30);
  EXPECT_EQ(times.of(kLamp).from, From::Node);
  EXPECT_EQ(times.of(kSun).from, From::Scene);
  EXPECT_EQ(times.of(kElsewhere).from, From::Type);
  EXPECT_EQ(times.of(kFilter).from, From::Nothing);
  for (const TimedNode& n : {kLamp, kSun, kElsewhere}) EXPECT_DOUBLE_EQ(times.of(n).value, 3.0) << n.label;
  times.add({"hall", "gbuffer", "gbuffer"}, 10, 20);
  EXPECT_EQ(times.of(kFilter).from, From::Nothing) << "of two types";
  times.add({"hall", "map", "map"}, 10, 80);
  EXPECT_EQ(times.of(kFilter).from, From::Machine);
  EXPECT_DOUBLE_EQ(times.of(kFilter).value, 3.0) << "of three types the one in the middle";
  times.add(kFilter, 10, 50);
  EXPECT_DOUBLE_EQ(times.of(kFilter).value, 5.0);
  EXPECT_DOUBLE_EQ(times.of(kSun).value, 3.0) << "another type's";
}

TEST(KnownTimes, NeitherASlowRunNorManyRunsOfOneDecide) {
  KnownTimes times;
  times.add(kLamp, 10, 500);  // something else happened
  for (int i = 0; i < 2; ++i) times.add(kLamp, 10, 20);
  EXPECT_DOUBLE_EQ(times.of(kLamp).value, 2.0);
  for (int i = 0; i < 10; ++i) times.add(kLamp, 10, 20);
  times.add(kSun, 10, 80);
  EXPECT_DOUBLE_EQ(times.of(kLamp).value, 2.0);
  EXPECT_DOUBLE_EQ(times.of(kSun).value, 8.0);
  const TimedNode fill{"hall", "visibility:fill", "visibility"};
  times.add({"hall", "visibility:key", "visibility"}, 10, 90);
  EXPECT_DOUBLE_EQ(times.of(fill).value, 8.0) << "of three lights the one in the middle, not of their twelve runs";
  times.add({"yard", "visibility:lamp", "visibility"}, 10, 40);
  EXPECT_DOUBLE_EQ(times.of({"attic", "visibility:lamp", "visibility"}).value, 4.0) << "of two scenes the lesser";
}

TEST(KnownTimes, TheLastRunsAreMeant) {
  KnownTimes times;
  for (int i = 0; i < 5; ++i) times.add(kLamp, 10, 20);
  for (int i = 0; i < 3; ++i) times.add(kLamp, 10, 60);
  EXPECT_DOUBLE_EQ(times.of(kLamp).value, 6.0);
}

TEST(KnownTimes, WhatIsShortOrNoNumberTellsNothing) {
  KnownTimes times;
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const auto& [expected, took] : {std::pair{0.01, 0.1}, {0.9, 9.0}, {0.0, 100.0}, {-1.0, 100.0}, {nan, 100.0}, {10.0, nan}, {inf, 100.0}, {10.0, inf}})
    times.add(kLamp, expected, took);
  EXPECT_EQ(times.of(kLamp).from, From::Nothing);
  times.add(kLamp, 10, 0.0);
  EXPECT_GT(times.of(kLamp).value, 0.0) << "a picture of nothing is done at once, the next may have something";
  times.add(kSun, 0.001, 1e6);
  EXPECT_LT(times.of(kSun).value, 1e4);
}

TEST(KnownTimes, KeepsSoMany) {
  KnownTimes times(8);
  for (int i = 0; i < 100; ++i) times.add({"hall", "visibility:" + std::to_string(i), "visibility"}, 10, 20);
  EXPECT_EQ(times.of({"hall", "visibility:0", "visibility"}).from, From::Scene);
  EXPECT_EQ(times.of({"hall", "visibility:99", "visibility"}).from, From::Node);
}

TEST(KnownTimes, RunsSayWhetherOthersWereThere) {
  KnownTimes times;
  const KnownTimes::Run first(times);
  EXPECT_TRUE(first.alone());
  {
    const KnownTimes::Run second(times);
    EXPECT_FALSE(first.alone());
    EXPECT_FALSE(second.alone());
  }
  EXPECT_FALSE(first.alone()) << "it was there for a part of it";
}

TEST(KnownTimes, ARunAfterTheOthersIsAlone) {
  KnownTimes times;
  { const KnownTimes::Run first(times), second(times); }
  EXPECT_TRUE(KnownTimes::Run(times).alone());
  auto before = std::make_unique<KnownTimes::Run>(times);
  const KnownTimes::Run begunBeside(times);
  before.reset();
  EXPECT_FALSE(begunBeside.alone());
}

TEST(KnownTimes, WordsSayTheShares) {
  EXPECT_EQ(timesFromText({}), "");
  EXPECT_EQ(timesFromText({5, 0, 0, 0, 0}), "");
  EXPECT_EQ(timesFromText({1, 1, 2, 0, 96}), "this scene 96 %, other scenes 2 %, this machine 1 %, the documented machine 1 %");
}

}  // namespace
}  // namespace gobo::testing
