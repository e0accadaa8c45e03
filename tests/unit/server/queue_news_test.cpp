// SPDX-License-Identifier: Apache-2.0
// What a caller who watches is told: of his place in the queue, and of the rest of a render that runs. Times are arguments: no clock.
#include "server/queue_news.h"

#include <gtest/gtest.h>

#include "server/rest_estimate.h"

namespace gobo::queue_news_test {
namespace {

std::optional<Place> queued(size_t ahead, double seconds = 0) { return Place{true, ahead, seconds}; }
const std::optional<Place> kRuns = Place{false, 0, 7};

TEST(QueueNews, OnceASecondAndOnChangeAndWhenItIsOver) {
  QueueNews news;
  EXPECT_FALSE(news.at(queued(3), 100));
  EXPECT_FALSE(news.at(queued(3), 149)) << "a short wait is no news";
  const auto first = news.at(queued(3, 2.5), 150);
  ASSERT_TRUE(first);
  EXPECT_TRUE(first->queued());
  EXPECT_EQ(first->position(), 3u);
  EXPECT_EQ(first->eta_ms(), 2500);
  EXPECT_EQ(first->elapsed_ms(), 150);
  EXPECT_FALSE(news.at(queued(3), 1149));
  EXPECT_TRUE(news.at(queued(3), 1150)) << "a second later";
  EXPECT_EQ(news.at(queued(2), 1160)->position(), 2u) << "on change";
  EXPECT_FALSE(news.at(queued(2), 1170));
  const auto over = news.at(kRuns, 1180);
  ASSERT_TRUE(over);
  EXPECT_FALSE(over->queued());
  EXPECT_EQ(over->eta_ms(), 7000);
  EXPECT_FALSE(news.at(kRuns, 5000)) << "once";
  EXPECT_FALSE(news.at(queued(0), 6000)) << "preempted: a new wait";
  EXPECT_TRUE(news.at(queued(0), 6050));
  EXPECT_FALSE(news.at(std::nullopt, 6060)) << "the reply says it";
}

TEST(QueueNews, WhoNeverWaitedLongIsToldNothing) {
  QueueNews news;
  EXPECT_FALSE(news.at(queued(1), 0));
  EXPECT_FALSE(news.at(kRuns, 40));
  EXPECT_FALSE(news.at(std::nullopt, 80));
}

v1::Halt spp(uint32_t n) {
  v1::Halt halt;
  halt.set_spp(n);
  return halt;
}

TEST(RestEstimate, ByThePlanThenByTheRateOfTheLastPass) {
  RestEstimate rest(spp(64), 6000);
  EXPECT_EQ(rest.rest(0), 6000);
  EXPECT_EQ(rest.rest(500), 5500);
  EXPECT_EQ(rest.rest(9000), 0) << "longer than planned: nobody knows";
  rest.passDone(1, 600);  // the ladder's
  EXPECT_EQ(rest.rest(1000), 5000);
  rest.passDone(16, 1600);  // 100 ms a sample
  EXPECT_EQ(rest.rest(1600), 4800);
  EXPECT_EQ(rest.rest(2000), 4400);
  rest.passDone(32, 2400);  // 50
  EXPECT_EQ(rest.rest(2400), 1600);
  rest.passDone(64, 4000);
  EXPECT_EQ(rest.rest(9999), 0);
}

TEST(RestEstimate, PassesThatAStoppedRunHadMadeSayNothing) {
  RestEstimate rest(spp(64), 0);
  EXPECT_EQ(rest.rest(0), 0);
  rest.passDone(16, 1600);
  rest.passDone(16, 5);  // the next run: out of the store
  EXPECT_EQ(rest.rest(5), 4800);
  rest.passDone(32, 1605);
  EXPECT_EQ(rest.rest(1605), 3200);
}

TEST(RestEstimate, TimeIsKnownAndErrorIsNot) {
  v1::Halt time, error;
  time.set_time_s(2);
  error.set_error(0.1);
  RestEstimate byTime(time, 0), byError(error, 500);
  EXPECT_EQ(byTime.rest(500), 1500);
  EXPECT_EQ(byTime.rest(2500), 0);
  byTime.passDone(16, 100);
  EXPECT_EQ(byTime.rest(500), 1500);
  EXPECT_EQ(byError.rest(0), 0);
}

}  // namespace
}  // namespace gobo::queue_news_test
