// SPDX-License-Identifier: Apache-2.0
// Wall clocks that jump by years: no result goes for it, no living holder loses its lease, no frame waits for a year that never comes.
#include <time.h>

#include <chrono>
#include <fstream>

#include "server/job_runner.h"
#include "server/jobs/job_files.h"
#include "server/jobs/sqlite.h"
#include "server/log.h"
#include "unit/jobs/store_fixture.h"

namespace gobo::job_clock_test {
namespace {

constexpr double kTenYears = 10 * 365 * 86400.0, kDay = 86400;

struct Clock : test::StoreFixture {
  double up = 5000;
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    time = 1.7e9;
    options.uptime = [this] { return up; };
    options.boot = "first";
    StoreFixture::SetUp();
  }
  void pass(double seconds) {
    time += seconds;
    up += seconds;
  }
  int64_t finish() {
    const int64_t id = submit(makeJob());
    const auto lease = claim();
    EXPECT_TRUE(lease);
    EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
    return id;
  }
  size_t expired(double keepDays) { return store->expireResults(1 << 30, keepDays * kDay)->size(); }
};
using EachClock = test::OnEachStore<Clock>;
INSTANTIATE_TEST_SUITE_P(Stores, EachClock, test::kBothStores, test::storeName);

TEST_P(EachClock, AJumpEndsNoLeaseOfALivingHolder) {
  for (const double jump : {kTenYears, -kTenYears, -kTenYears, kTenYears}) {
    for (const bool reopened : {false, true}) {
      const int64_t id = submit(makeJob());
      auto lease = claim(30);
      ASSERT_TRUE(lease) << jump;
      time += jump;
      if (reopened) open();  // another daemon, started after the jump
      for (int k = 0; k < 10; ++k) {
        pass(10);
        EXPECT_EQ(*store->expireLeases(), 0u) << jump << " " << reopened << " " << k;
        EXPECT_TRUE(store->renew(*lease, 30).ok());
      }
      EXPECT_FALSE(claim());
      EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
      EXPECT_EQ(get(id).frames(0).attempts(), 1u);
    }
  }
}

TEST_P(EachClock, AJumpKeepsNoLeaseOfADeadHolderAlive) {
  for (const double jump : {kTenYears, -kTenYears}) {
    const int64_t id = submit(makeJob());
    auto dead = claim(30);
    ASSERT_TRUE(dead);
    time += jump;
    EXPECT_TRUE(store->renew(*dead, 30).ok());  // its last
    pass(29);
    EXPECT_EQ(*store->expireLeases(), 0u);
    pass(2);
    EXPECT_EQ(*store->expireLeases(), 1u);
    const auto again = claim(30);  // runs again, exactly once
    ASSERT_TRUE(again);
    EXPECT_FALSE(claim(30));
    EXPECT_EQ(store->complete(*dead, files("late"), 1).code(), Code::FailedPrecondition);
    EXPECT_TRUE(store->complete(*again, files("aa"), 1).ok());
    EXPECT_EQ(get(id).frames(0).files_size(), 1);  // recorded once
    EXPECT_EQ(get(id).frames(0).files(0).sha256(), "aa");
    EXPECT_EQ(get(id).frames_done(), 1u);
  }
}

TEST_P(EachClock, AFailedFrameWaitsSecondsNotYears) {
  for (const double jump : {kTenYears, -2 * kTenYears}) {
    const int64_t id = submit(makeJob());
    auto lease = claim();
    ASSERT_TRUE(store->fail(*lease, {{Code::Internal, "x"}}).ok());
    EXPECT_FALSE(claim());
    time += jump;
    EXPECT_FALSE(claim()) << "its wait was skipped";
    pass(2);
    lease = claim();
    ASSERT_TRUE(lease);
    EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
    EXPECT_EQ(get(id).state(), v1::Job::DONE);
  }
}

TEST_P(EachClock, ResultsAgeByTheTimeTheMachineIsUpAndNotByJumps) {
  const int64_t first = finish();
  for (const double jump : {kTenYears, -kTenYears, -kTenYears, kTenYears}) {
    time += jump;
    EXPECT_EQ(expired(7), 0u) << jump;
    open();
    EXPECT_EQ(expired(7), 0u) << jump;
    pass(3600);  // an hour of the wrong time
    EXPECT_EQ(expired(7), 0u) << jump;
    finish();
  }
  EXPECT_EQ(get(first).ended_unix_s(), 1.7e9);  // what clients read is of the wall clock
  pass(6.5 * kDay);
  EXPECT_EQ(expired(7), 0u);
  pass(0.34 * kDay);
  EXPECT_EQ(expired(7), 1u);
  EXPECT_TRUE(get(first).results_expired());
  pass(1 * kDay);
  EXPECT_EQ(expired(7), 4u);
}

TEST_F(Clock, TheAgeOutlivesARestartOfTheMachine) {
  const int64_t id = finish();
  for (int boot = 0; boot < 4; ++boot) {
    for (int hour = 0; hour < 24; ++hour) pass(3600), (void)*store->expireLeases();
    options.boot = "boot " + std::to_string(boot);
    up = 3;  // off for ten years in between
    time += kTenYears;
    open();
    EXPECT_EQ(expired(4.5), 0u) << boot;
  }
  auto lease = (submit(makeJob()), claim());
  ASSERT_TRUE(lease);
  pass(20);
  auto second = std::move(*SqliteJobStore::open(path(), options));  // two processes have one clock
  EXPECT_EQ(*second->expireLeases(), 0u);
  pass(11);
  EXPECT_EQ(*second->expireLeases(), 1u);
  pass(0.6 * kDay);
  EXPECT_EQ(expired(4.5), 1u);
  EXPECT_TRUE(get(id).results_expired());
}

TEST_P(EachClock, TheBoundInBytesStillTakesTheEarliestEnded) {
  const int64_t a = finish();
  time -= kTenYears;
  pass(10);
  const int64_t b = finish();
  time += 2 * kTenYears;
  pass(10);
  const int64_t c = finish();
  EXPECT_EQ(*store->expireResults(14, 1e9), std::vector<int64_t>{a});
  EXPECT_EQ(*store->expireResults(7, 1e9), std::vector<int64_t>{b});
  EXPECT_FALSE(get(c).results_expired());
}

TEST_F(Clock, AFileWhoseRowIsAboutToComeIsNoLitterWhateverItsTimesSay) {
  JobFiles folderFiles;
  bool alone = false;
  ASSERT_TRUE(folderFiles.open(folder, alone).ok());
  double steady = 0;
  folderFiles.litter.now = [&] { return steady; };
  finish();
  const int64_t id = submit(makeJob());
  const auto lease = claim();
  ASSERT_TRUE(lease);
  const std::string path = folderFiles.resultPath(1, "waits"), scene = folderFiles.scenePath("abc.glb");  // of a job that is over: litter, once old
  ASSERT_TRUE(folderFiles.write(path, "x", 1).ok());
  ASSERT_TRUE(folderFiles.write(scene, "x", 1).ok());
  const auto years = std::filesystem::file_time_type::clock::now() - std::chrono::hours(24 * 3650);
  std::filesystem::last_write_time(path, years);  // as after a jump forward
  std::filesystem::last_write_time(scene, years);
  const auto sweep = [&] {
    EXPECT_TRUE(folderFiles.sweep(*store, kDay).ok());
    folderFiles.sweepScenes({}, {});
  };
  sweep();
  steady += 500;
  sweep();
  EXPECT_TRUE(std::filesystem::exists(path));
  EXPECT_TRUE(std::filesystem::exists(scene));
  ASSERT_TRUE(folderFiles.write(path, "x", 1).ok());  // somebody needs it again: young
  steady += 200;
  sweep();
  EXPECT_FALSE(std::filesystem::exists(scene));
  for (double end = steady + kDay - 1800; steady < end; steady += 3600) sweep();
  EXPECT_TRUE(std::filesystem::exists(path));
  steady += 3600;
  sweep();
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING);
}

// The tests above set the clocks; these are the ones that a daemon has. None of them is the wall clock, which is decades ahead of the others.
TEST_F(Clock, ADaemonsOwnClocksCountTheTimeTheMachineIsUp) {
  timespec t{};
  ASSERT_EQ(::clock_gettime(CLOCK_BOOTTIME, &t), 0);  // with the time asleep
  const double boot = double(t.tv_sec), steady = std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  const auto own = SqliteJobStore::open(folder + "/own.sqlite", {});
  ASSERT_TRUE(own.ok()) << own.status().toString();
  Sqlite db;
  ASSERT_TRUE(db.open(folder + "/own.sqlite", 1).ok());
  EXPECT_NEAR(-std::stod(*db.value("SELECT base FROM clock")), boot, 600);  // a new store's clock begins at 0
  EXPECT_NEAR(Litter().now(), steady, 600);
  EXPECT_NEAR(JobRunner::now(), steady, 600);
}

}  // namespace
}  // namespace gobo::job_clock_test
