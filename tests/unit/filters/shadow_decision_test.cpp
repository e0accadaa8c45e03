// SPDX-License-Identifier: Apache-2.0
// What shadows.auto chooses from errors that are known to within something, and when it looks again.
#include "filters/automatic/decision.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gobo::test {
namespace {

/// RMSE `error`, its square known to within `within` of itself.
ProbeEvidence known(double ms, double error, double within = 1e-6) { return {ms, error * error, within * within * error * error * error * error, 100}; }
ProbeEvidence unknown(double ms) { return {ms, 0, 0, 0}; }

TEST(ShadowDecision, BoundsAreAStandardErrorOfTheMeanSquareAway) {
  const ProbeEvidence e = known(1, 0.1, 0.44);
  EXPECT_NEAR(e.high(), 0.12, 1e-12);
  EXPECT_NEAR(e.low(), 0.1 * std::sqrt(0.56), 1e-12);
  EXPECT_EQ(known(1, 0.1, 3).low(), 0.0);
  EXPECT_EQ((ProbeEvidence{1, -1e-3, 1e-8, 10}).high(), 0.0) << "an unbiased estimate may be negative";
}

TEST(ShadowDecision, NoErrorSeenIsNoErrorlessness) {
  const ProbeEvidence none{1, 0, 0, 100};
  EXPECT_NEAR(none.high(), std::sqrt(1.0 / 1200), 1e-12);
  EXPECT_EQ(none.low(), 0.0);
  // Beside one that keeps the budget by what was seen of it.
  EXPECT_EQ(chooseByEvidence(std::vector{known(2, 0.015, 0.1), none}, {0.02}), 0u);
  EXPECT_EQ(chooseByEvidence(std::vector{known(2, 0.015, 0.1), none}, {0.03}), 1u);
}

TEST(ShadowDecision, LooksAddUpByTheirPixels) {
  ProbeEvidence e;
  EXPECT_FALSE(e.judged());
  e.add(0.04, 1e-4, 100);
  EXPECT_EQ(e.mse, 0.04);
  EXPECT_EQ(e.variance, 1e-4);
  e.add(0.08, 1e-4 / 3, 300);
  EXPECT_NEAR(e.mse, 0.07, 1e-15);
  EXPECT_NEAR(e.variance, 1e-4 / 16 + 1e-4 / 3 * 9 / 16, 1e-15);
  EXPECT_EQ(e.pixels, 400);
}

TEST(ShadowDecision, CheapestWithinTheErrorAndNearestMissBeyond) {
  const std::vector<ProbeEvidence> c{known(5, 0.02), known(2, 0.06), known(3, 0.04), known(1, 0.3), unknown(0.5)};
  EXPECT_EQ(chooseByEvidence(c, {0.05}), 2u);
  EXPECT_EQ(chooseByEvidence(c, {0.07}), 1u);
  EXPECT_EQ(chooseByEvidence(c, {0.5}), 3u);
  EXPECT_EQ(chooseByEvidence(c, {0.01}), 0u);
  EXPECT_EQ(chooseByEvidence(std::vector{known(5, 0.02), known(2, 0.024), known(1, 0.026)}, {0.01}), 1u) << "as good, but for a quarter";
  EXPECT_EQ(chooseByEvidence(std::vector{known(5, 0.02), known(2, 0.048, 0.5)}, {0.05}), 0u) << "0.048 is not surely within 0.05";
}

TEST(ShadowDecision, LeastErrorWithinATime) {
  const std::vector<ProbeEvidence> c{known(5, 0.02), known(2, 0.06), known(3, 0.04), unknown(1)};
  EXPECT_EQ(chooseByEvidence(c, {0.01, 3.5}), 2u);
  EXPECT_EQ(chooseByEvidence(c, {0.01, 10}), 0u);
  EXPECT_EQ(chooseByEvidence(c, {0.01, 0.5}), 1u) << "none fits: the cheapest that was judged";
}

TEST(ShadowDecision, RivalsAreCheaperAndMayKeepTheError) {
  const std::vector<ProbeEvidence> c{known(5, 0.02), known(2, 0.06, 0.5), known(3, 0.06, 0.1), known(6, 0.01), unknown(1)};
  EXPECT_EQ(rivalsOf(c, {0.05}, 0), std::vector<size_t>{1});
  // Nobody keeps it: whoever may miss it by little.
  EXPECT_EQ(rivalsOf(std::vector{known(5, 0.04), known(2, 0.06, 0.4), known(1, 0.2)}, {0.01}, 0), std::vector<size_t>{1});
  EXPECT_EQ(rivalsOf(std::vector{known(5, 0.04, 0.3), known(2, 0.05, 0.4), known(9, 0.02)}, {0.01, 6}, 0), std::vector<size_t>{1});
}

TEST(ShadowDecision, ALookMustPayForItself) {
  const std::vector<ProbeEvidence> c{known(5, 0.02), known(2, 0.06, 0.5), known(4, 0.05, 0.5)};
  const std::vector<size_t> rivals{1, 2}, none;
  // The first saves 3 ms; a normal distribution of mean square 0.0036 and standard deviation 0.0018 is half of that below 0.0025 by a chance of 0.133. The
  // second saves 1 ms by one of 0.309.
  EXPECT_TRUE(worthAnotherLook(c, {0.05}, 0, rivals, 0.39));
  EXPECT_FALSE(worthAnotherLook(c, {0.05}, 0, rivals, 0.41));
  EXPECT_FALSE(worthAnotherLook(c, {0.05}, 0, {&rivals[1], 1}, 0.32));
  EXPECT_TRUE(worthAnotherLook(c, {0.05}, 0, {&rivals[1], 1}, 0.30));
  EXPECT_FALSE(worthAnotherLook(c, {0.05}, 0, none, 0.0));
  EXPECT_TRUE(worthAnotherLook(c, {0.05, 20}, 0, rivals, 0.9));
  EXPECT_FALSE(worthAnotherLook(c, {0.05, 20}, 0, rivals, 1.1));
}

// How few pixels hold an error is not known either: a rival may be better than it was seen to be by two standard errors, and a look that costs next to nothing
// beside what is at stake needs no chance.
TEST(ShadowDecision, CheapLooksAreInsurance) {
  EXPECT_EQ(rivalsOf(std::vector{known(100, 0.02), known(2, 0.06, 0.2)}, {0.05}, 0), std::vector<size_t>{1}) << "0.0036 is within 1.6 of 0.0007 above 0.0025";
  EXPECT_TRUE(rivalsOf(std::vector{known(100, 0.02), known(2, 0.06, 0.14)}, {0.05}, 0).empty());
  const std::vector<ProbeEvidence> c{known(100, 0.02), known(2, 0.06, 0.01)};
  const std::vector<size_t> rival{1};
  EXPECT_TRUE(worthAnotherLook(c, {0.05}, 0, rival, 0.03 * 98 - 0.01));
  EXPECT_FALSE(worthAnotherLook(c, {0.05}, 0, rival, 0.03 * 98 + 0.01));
}

// A cheapest candidate of which no error was seen has no rival; it is looked at again for its own sake where it is cheap to.
TEST(ShadowDecision, BlindChoicesAreLookedAtAgain) {
  const std::vector<ProbeEvidence> c{{20, 0, 0, 96}, {40, 0, 0, 96}};  // an unseen pixel: 0.0295
  EXPECT_TRUE(blindChoice(c, {0.03}, 0));
  EXPECT_TRUE(worthAnotherLook(c, {0.03}, 0, {}, 4.9));
  EXPECT_FALSE(worthAnotherLook(c, {0.03}, 0, {}, 5.1));
  EXPECT_FALSE(worthAnotherLook(c, {0.1}, 0, {}, 4.9)) << "it could not matter";
  EXPECT_FALSE(blindChoice(c, {0.03, 5}, 0));
  EXPECT_FALSE(blindChoice(std::vector{known(20, 0.029, 0.1)}, {0.03}, 0));
}

TEST(ShadowDecision, MoreRaysAreNoWorse) {
  const auto falls = fallingErrors(std::vector{ProbeEvidence{1, 0.09, 4e-4, 10}, {2, 0.01, 1e-4, 10}, {3, 0.03, 3e-4, 10}, {4, 0.005, 1e-5, 10}});
  ASSERT_EQ(falls.size(), 4u);
  EXPECT_EQ(falls[0].mse, 0.09);
  for (const size_t k : {1u, 2u}) {
    EXPECT_NEAR(falls[k].mse, 0.02, 1e-15);
    EXPECT_NEAR(falls[k].variance, 2e-4, 1e-15);
  }
  EXPECT_EQ(falls[3].mse, 0.005);
  EXPECT_EQ(falls[2].ms, 3);
  // One that rises above all before it takes all of them with it.
  for (const ProbeEvidence& e : fallingErrors(std::vector{ProbeEvidence{1, 0.02, 0, 10}, {2, 0.01, 0, 10}, {3, 0.06, 0, 10}})) EXPECT_NEAR(e.mse, 0.03, 1e-15);
  EXPECT_TRUE(fallingErrors({}).empty());
  // What more pixels say counts for more.
  for (const ProbeEvidence& e : fallingErrors(std::vector{ProbeEvidence{1, 0.02, 1e-4, 10}, {2, 0.06, 5e-4, 30}})) {
    EXPECT_NEAR(e.mse, 0.05, 1e-15);
    EXPECT_NEAR(e.variance, 4e-4, 1e-15);
  }
}

}  // namespace
}  // namespace gobo::test
