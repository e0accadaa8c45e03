// SPDX-License-Identifier: Apache-2.0
#include "server/refusal_pause.h"

#include <gtest/gtest.h>

namespace gobo::refusal_pause_test {
namespace {

TEST(RefusalPause, WhoComesWhenHeWasToldToIsAnsweredAtOnce) {
  RefusalPause pause(8);
  EXPECT_EQ(pause.begin("a", 0, 0.1), 0);
  EXPECT_EQ(pause.begin("a", 0.1, 0.1), 0);
  EXPECT_EQ(pause.begin("b", 0.1, 0.1), 0);  // another's impatience is not his
}

TEST(RefusalPause, WhoComesEarlierWaitsAtMostHisHint) {
  RefusalPause pause(8);
  EXPECT_EQ(pause.begin("a", 0, 0.1), 0);
  EXPECT_EQ(pause.begin("a", 0.01, 0.1), 0.1);
  EXPECT_EQ(pause.begin("a", 0.02, 60), RefusalPause::kLongest);
  EXPECT_EQ(pause.held(), 2u);
  pause.end("a");
  pause.end("a");
  EXPECT_EQ(pause.held(), 0u);
  EXPECT_EQ(pause.begin("a", 60.02, 1), 0);  // after the longest that he was told
}

TEST(RefusalPause, ACrowdTakesHalfOfThePlacesAndNamesCostNothing) {
  RefusalPause pause(8);
  int held = 0;
  for (int i = 0; i < 20; ++i) held += pause.begin("crowd", i * 1e-3, 1) > 0;
  EXPECT_EQ(held, 4);
  for (int i = 0; i < 10000; ++i) EXPECT_EQ(pause.begin("name " + std::to_string(i), 1, 1), 0);
  EXPECT_EQ(pause.begin("crowd", 1.5, 1), 0);  // still four of it
  for (int i = 0; i < 4; ++i) pause.end("crowd");
  EXPECT_GT(pause.begin("crowd", 1.6, 1), 0);
}

}  // namespace
}  // namespace gobo::refusal_pause_test
