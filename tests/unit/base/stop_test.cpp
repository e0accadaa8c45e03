// SPDX-License-Identifier: Apache-2.0
#include "base/stop.h"

#include <gtest/gtest.h>

namespace gobo {
namespace {

using Clock = StopToken::Clock;
const Clock::time_point kPast = Clock::now() - std::chrono::hours(1), kLater = Clock::now() + std::chrono::hours(1);

TEST(StopToken, TimeIsALimitOfItsCopyAlone) {
  StopSource source;
  const StopToken token = source.token(), never;
  EXPECT_TRUE(token.until(kPast).stopRequested());
  EXPECT_EQ(token.until(kPast).reason(), StopReason::TimeUp);
  EXPECT_TRUE(never.until(kPast).stopRequested());
  EXPECT_FALSE(token.stopRequested());
  EXPECT_FALSE(token.until(kLater).stopRequested());
  EXPECT_EQ(token.until(kLater).reason(), StopReason::None);
  EXPECT_TRUE(token.until(kLater).until(kPast).stopRequested()) << "the earlier one counts";
  EXPECT_TRUE(token.until(kPast).until(kLater).stopRequested());
}

TEST(StopToken, WhoeverStopsItGoesBeforeTheClock) {
  StopSource source;
  const StopToken token = source.token().until(kPast), later = source.token().until(kLater);
  source.stop(StopReason::Preempted);
  EXPECT_TRUE(later.stopRequested());
  EXPECT_EQ(token.reason(), StopReason::Preempted);
}

}  // namespace
}  // namespace gobo
