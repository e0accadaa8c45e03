// SPDX-License-Identifier: Apache-2.0
// The next frame goes to the client that has had least, whatever priorities and numbers of frames others sent first.
#include <gtest/gtest.h>

#include "server/jobs/job_shares.h"
#include "store_fixture.h"

namespace gobo::job_shares_test {
namespace {

class JobSharesTest : public test::OnEachStore<test::StoreFixture> {
 protected:
  int64_t add(const std::string& client, int frames, v1::JobSpec::Priority priority = v1::JobSpec::MEDIUM) {
    NewJob job = makeJob(frames, "", priority);
    job.client = client;
    const int64_t id = submit(job);
    owner[id] = client;
    return id;
  }
  /// Runs the next frame for `seconds`; whose it was.
  std::string next(double seconds) {
    auto lease = store->claim("w", 1000);
    EXPECT_TRUE(lease.ok() && *lease);
    if (!lease.ok() || !*lease) return "";
    time += seconds;
    EXPECT_TRUE(store->release(**lease).ok());
    return owner[(*lease)->task.job];
  }
  std::map<int64_t, std::string> owner;
};
INSTANTIATE_TEST_SUITE_P(Stores, JobSharesTest, test::kBothStores, test::storeName);

TEST_P(JobSharesTest, OneFrameDoesNotWaitForAHundred) {
  add("first", 100);
  EXPECT_EQ(next(10), "first");
  add("second", 1);
  EXPECT_EQ(next(10), "second");
}

TEST_P(JobSharesTest, NobodyPassesAnotherByCallingEverythingUrgent) {
  add("modest", 100, v1::JobSpec::LOW);
  add("urgent", 100, v1::JobSpec::HIGH);
  int modest = 0;
  for (int i = 0; i < 20; ++i) modest += next(5) == "modest";
  EXPECT_NEAR(modest, 10, 1);
}

// Nothing is saved by cancelling: what a frame took until then is its client's.
TEST_P(JobSharesTest, CancelledFramesCountWithTheirTime) {
  const int64_t cancelled = add("first", 1);
  add("first", 100);
  add("second", 100);
  auto lease = store->claim("w", 1000);
  ASSERT_TRUE(lease.ok() && *lease);
  ASSERT_EQ((*lease)->task.job, cancelled);
  time += 100;
  ASSERT_TRUE(store->cancel(cancelled).ok());
  EXPECT_FALSE(store->release(**lease).ok());  // as a worker does that notices
  for (int i = 0; i < 9; ++i) EXPECT_EQ(next(10), "second") << i;
}

// Seconds count, not frames: cheap frames are given more often.
TEST_P(JobSharesTest, SecondsAreShared) {
  add("slow", 100);
  add("quick", 100);
  double slow = 0, quick = 0;
  for (int i = 0; i < 200; ++i) {
    const double before = time;
    auto lease = store->claim("w", 1000);
    ASSERT_TRUE(lease.ok() && *lease);
    const bool isSlow = owner[(*lease)->task.job] == "slow";
    time += isSlow ? 30 : 2;
    (isSlow ? slow : quick) += time - before;
    ASSERT_TRUE(store->release(**lease).ok());
  }
  EXPECT_NEAR(slow / quick, 1, 0.15);
}

// Nor is having no job for a moment a way to have had nothing.
TEST_P(JobSharesTest, WhoSubmitsFrameByFramePaysForEach) {
  add("quick", 300);
  add("slow", 1);
  double slow = 0, quick = 0;
  bool waiting = true;
  for (int i = 0; i < 200; ++i) {
    const auto lease = store->claim("w", 1000);
    ASSERT_TRUE(lease.ok() && *lease);
    const bool isSlow = owner[(*lease)->task.job] == "slow";
    time += isSlow ? 30 : 2;
    (isSlow ? slow : quick) += isSlow ? 30 : 2;
    ASSERT_TRUE((isSlow ? store->complete(**lease, files("a"), 30) : store->release(**lease)).ok());
    if (!isSlow && !waiting) add("slow", 1);  // after a frame of the other's
    waiting = !isSlow;
  }
  EXPECT_NEAR(slow / quick, 1, 0.25);
}

TEST_P(JobSharesTest, IdleTimeIsNotSavedUp) {
  add("busy", 1000);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(next(10), "busy");
  add("late", 1000);
  int late = 0;
  for (int i = 0; i < 20; ++i) late += next(10) == "late";
  EXPECT_NEAR(late, 10, 1);
}

}  // namespace
}  // namespace gobo::job_shares_test
