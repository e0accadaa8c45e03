// SPDX-License-Identifier: Apache-2.0
// Who wakes for which news.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "server/jobs/job_hub.h"

namespace gobo {
namespace {

constexpr double kLong = 30, kNow = 0.01;  // seconds

TEST(JobHub, NewsOfOneJobIsForThoseWhoWatchIt) {
  JobHub hub;
  JobHub::Watch one(hub, 1), other(hub, 2), second(hub, 1);
  hub.changed(1);
  EXPECT_TRUE(one.wait(kLong));
  EXPECT_TRUE(second.wait(kLong));
  EXPECT_FALSE(other.wait(kNow));
  EXPECT_FALSE(one.wait(kNow)) << "told once";
  hub.changed();
  EXPECT_TRUE(one.wait(kLong));
  EXPECT_TRUE(other.wait(kLong));
  hub.steered();
  EXPECT_TRUE(other.wait(kLong));
  hub.queued();
  EXPECT_TRUE(other.wait(kLong));
  hub.changed(3);  // of which nobody wants to know
  EXPECT_FALSE(other.wait(kNow));
}

TEST(JobHub, NewsBetweenTwoWaitsAreNotLost) {
  JobHub hub;
  std::atomic<int> told{0};
  JobHub::Watch watch(hub, 7);
  std::thread teller([&] {
    for (int i = 0; i < 1000; ++i) {
      hub.changed(7);
      ++told;
    }
  });
  while (told < 1000) watch.wait(kNow);
  teller.join();
  watch.wait(kNow);
  EXPECT_FALSE(watch.wait(kNow));
  hub.changed(7);
  EXPECT_TRUE(watch.wait(kLong));
}

TEST(JobHub, LiveProgressIsForWatchersAlone) {
  JobHub hub;
  JobHub::Watch one(hub, 1), other(hub, 2);
  const uint64_t before = hub.version();
  hub.setLive({1, 0}, {0, 0.5, 0, 3});
  EXPECT_TRUE(one.wait(kLong));
  EXPECT_FALSE(other.wait(kNow));
  EXPECT_EQ(hub.version(), before) << "nothing in the store has changed, and there is nothing to claim";
  uint64_t seen = before;
  hub.wait(seen, kNow);
  EXPECT_EQ(seen, before);
  hub.changed(1);
  hub.wait(seen, kLong);
  EXPECT_NE(seen, before);
}

TEST(JobHub, ProgressGoesWithItsLease) {
  JobHub hub;
  JobHub::Watch watch(hub, 1);
  hub.setLive({1, 0}, {0, 0.5, 0, 3, 8});
  EXPECT_TRUE(watch.wait(kLong));
  hub.clearLive({1, 0}, 7);  // an older one's
  hub.clearLive({1, 1}, 8);
  EXPECT_EQ(hub.live().size(), 1u);
  EXPECT_FALSE(watch.wait(kNow));
  hub.clearLive({1, 0}, 8);
  EXPECT_TRUE(hub.live().empty());
  EXPECT_TRUE(watch.wait(kLong));
}

TEST(JobHub, AWatchBeginsWithWhatComesAfter) {
  JobHub hub;
  hub.changed(1);
  {
    JobHub::Watch early(hub, 1);
    hub.changed(1);
    JobHub::Watch late(hub, 1);
    EXPECT_FALSE(late.wait(kNow));
    EXPECT_TRUE(early.wait(kLong));
  }
  JobHub::Watch again(hub, 1);
  EXPECT_FALSE(again.wait(kNow));
  hub.changed(1);
  EXPECT_TRUE(again.wait(kLong));
}

}  // namespace
}  // namespace gobo
