// SPDX-License-Identifier: Apache-2.0
// The log of a job: every change has its entry, in its own transaction; what is kept is bounded.
#include <set>
#include <sstream>

#include "unit/jobs/store_fixture.h"

namespace gobo::job_log_test {
namespace {

struct LogFixture : test::StoreFixture {
  std::vector<v1::JobLogEntry> entries(int64_t id, const JobLogFilter& filter = {}) {
    auto got = store->log(id, filter);
    EXPECT_TRUE(got.ok()) << got.status().toString();
    return got.ok() ? *got : std::vector<v1::JobLogEntry>();
  }
  /// "CLAIMED 10 w; DONE 10 w; ENDED"
  std::string said(int64_t id, const JobLogFilter& filter = {}) {
    std::string text;
    uint64_t last = 0;
    for (const v1::JobLogEntry& e : entries(id, filter)) {
      EXPECT_GT(e.sequence(), last);
      last = e.sequence();
      text += (text.empty() ? "" : "; ") + v1::JobLogEntry::Kind_Name(e.kind());
      if (e.has_frame()) text += " " + std::to_string(e.frame());
      if (!e.holder().empty()) text += " " + e.holder();
      if (e.has_error()) text += " '" + e.error().message() + "'";
    }
    return text;
  }
};
using JobLog = test::OnEachStore<LogFixture>;
INSTANTIATE_TEST_SUITE_P(Stores, JobLog, test::kBothStores, test::storeName);

TEST_P(JobLog, ALifeFromEndToEnd) {
  const int64_t id = submit(makeJob(2));
  time = 1001;
  const auto a = claim(30, "ann"), b = claim(30, "bob");
  time = 1002.5;
  ASSERT_TRUE(store->complete(*a, files(), 1.5).ok());
  ASSERT_TRUE(store->complete(*a, files(), 1.5).ok());  // repeated: it happened once
  ASSERT_TRUE(store->release(*b).ok());
  ASSERT_TRUE(store->complete(*claim(30, "cyd"), files(), 2).ok());
  EXPECT_EQ(said(id), "SUBMITTED; CLAIMED 10 ann; CLAIMED 11 bob; DONE 10 ann; RELEASED 11 bob; CLAIMED 11 cyd; DONE 11 cyd; ENDED");
  const auto all = entries(id);
  EXPECT_EQ(all[0].unix_s(), 1000);
  EXPECT_EQ(all[1].unix_s(), 1001);
  EXPECT_EQ(all[3].unix_s(), 1002.5);
  EXPECT_EQ(all[3].seconds(), 1.5);
  EXPECT_FALSE(all[0].has_frame());
  EXPECT_FALSE(all[1].has_part());
}

TEST_P(JobLog, FailuresLossesAndWhatIsSetAside) {
  options.maxLosses = 3;
  open();
  NewJob n = makeJob(1);
  n.spec.set_max_attempts(2);
  const int64_t a = submit(n);
  const auto lease = claim();
  ASSERT_TRUE(store->fail(*lease, {{Code::Internal, "no luck"}}).ok());
  ASSERT_TRUE(store->fail(*lease, {{Code::Internal, "no luck"}}).ok());  // repeated
  time += 60;
  ASSERT_TRUE(store->fail(*claim(), {{Code::Internal, "no luck again"}}).ok());
  EXPECT_EQ(said(a), "SUBMITTED; CLAIMED 10 w; FAILED 10 w 'no luck'; CLAIMED 10 w; FAILED 10 w 'no luck again'; ENDED 'frame 10: no luck again'");
  const int64_t b = submit(makeJob(1));
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(claim(30, "x"));
    time += 31;
    ASSERT_EQ(*store->expireLeases(), 1u);
  }
  EXPECT_EQ(said(b).rfind("SUBMITTED; CLAIMED 10 x; LOST 10 x; CLAIMED 10 x; LOST 10 x; CLAIMED 10 x; LOST 10 x; SET_ASIDE 10 'its worker was lost 3 times", 0),
            0u)
      << said(b);
  const int64_t c = submit(makeJob(2));
  const auto held = claim(30, "y");
  ASSERT_TRUE(store->blame(held->task, {Code::Internal, "crashed"}, true).ok());
  EXPECT_EQ(said(c), "SUBMITTED; CLAIMED 10 y; SET_ASIDE 10 y 'crashed'");
  const int64_t d = submit(makeJob(1, "", v1::JobSpec::MEDIUM, time + 10));
  time += 11;
  ASSERT_TRUE(store->expireLeases().ok());
  EXPECT_EQ(said(d), "SUBMITTED; ENDED 'the job's deadline passed'");
}

TEST_P(JobLog, WhatPeopleDo) {
  const int64_t other = submit(makeJob()), id = submit(makeJob());
  ASSERT_TRUE(store->pause(id).ok());
  ASSERT_TRUE(store->pause(id).ok());  // nothing changes: no entry
  ASSERT_TRUE(store->resume(id).ok());
  ASSERT_TRUE(store->resume(id).ok());
  ASSERT_TRUE(store->prioritize(id, v1::JobSpec::HIGH).ok());
  ASSERT_TRUE(store->depend(id, {other}).ok());
  ASSERT_TRUE(store->cancel(id).ok());
  ASSERT_TRUE(store->cancel(id).ok());
  ASSERT_TRUE(store->retry(id).ok());
  EXPECT_EQ(said(id), "SUBMITTED; PAUSED; RESUMED; PRIORITIZED; DEPENDED; CANCELLED; ENDED; RETRIED");
  EXPECT_EQ(said(other), "SUBMITTED");
  ASSERT_TRUE(store->cancel(id).ok());
  ASSERT_TRUE(store->remove(id).ok());
  EXPECT_EQ(said(id), "") << "goes with its job";
}

TEST_P(JobLog, WhatWasRefusedIsNotThere) {
  const int64_t id = submit(makeJob());
  const auto lease = claim();
  EXPECT_EQ(store->depend(id, {id}).code(), Code::InvalidArgument);
  time += 31;
  ASSERT_EQ(*store->expireLeases(), 1u);
  EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::FailedPrecondition);
  EXPECT_EQ(store->release(*lease).code(), Code::FailedPrecondition);
  EXPECT_EQ(said(id), "SUBMITTED; CLAIMED 10 w; LOST 10 w");
}

TEST_P(JobLog, FramesAfterAndMost) {
  const int64_t id = submit(makeJob(3));
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(store->complete(*claim(30, "w" + std::to_string(i)), files(), 1).ok());
  EXPECT_EQ(said(id, {.frames = {11}}), "CLAIMED 11 w1; DONE 11 w1");
  EXPECT_EQ(said(id, {.frames = {10, 12}}), "CLAIMED 10 w0; DONE 10 w0; CLAIMED 12 w2; DONE 12 w2");
  EXPECT_EQ(said(id, {.frames = {12, 12, -3, 10, 12}}), "CLAIMED 10 w0; DONE 10 w0; CLAIMED 12 w2; DONE 12 w2");
  EXPECT_EQ(said(id, {.frames = {}, .after = 0, .most = 2}), "DONE 12 w2; ENDED");
  const uint64_t middle = entries(id)[5].sequence();
  EXPECT_EQ(said(id, {.frames = {}, .after = middle}), "DONE 12 w2; ENDED");
  EXPECT_EQ(said(id, {.frames = {}, .after = UINT64_MAX}), "");
  EXPECT_EQ(said(id, {.frames = {}, .after = 0, .most = 1000, .bytes = 1}), "ENDED") << "one at least";
}

TEST_P(JobLog, TheHolderOfARunningFrameAndOfADoneOne) {
  const int64_t id = submit(makeJob(2));
  const auto a = claim(30, "ann"), b = claim(30, "bob");
  EXPECT_EQ(get(id).frames(0).holder(), "ann");
  ASSERT_TRUE(store->complete(*a, files(), 1).ok());
  EXPECT_EQ(get(id).frames(0).holder(), "ann");
  EXPECT_EQ(get(id).frames(1).holder(), "bob");
  ASSERT_TRUE(store->release(*b).ok());
  EXPECT_EQ(get(id).frames(1).holder(), "");
}

// A statement is kept for each text that there was: what callers send is a value.
TEST_P(JobLog, OtherFramesAndStatesAreNoOtherStatements) {
  const int64_t id = submit(makeJob(3));
  std::set<std::string> texts;
  options.step = [&](const char* sql) {
    texts.insert(sql);
    return Status();
  };
  open();
  for (int64_t n = 1; n < 100; ++n) {
    JobLogFilter few;
    for (int64_t k = 0; k < n; ++k) few.frames.push_back(10 + k * k % n);
    ASSERT_TRUE(store->log(id, few).ok());
    JobFilter jobs;
    for (int64_t k = 0; k < n; ++k) jobs.states.push_back(k % 2 ? v1::Job::QUEUED : v1::Job::RUNNING);
    ASSERT_TRUE(store->list(jobs).ok());
  }
  EXPECT_LT(texts.size(), 20u);
}

// Two jobs whose changes take turns, each many times what is kept: both stay near the bound, and neither takes from the other.
TEST_P(JobLog, TheNewestAreKept) {
  options.logEntries = 50;
  open();
  const int64_t a = submit(makeJob()), b = submit(makeJob()), quiet = submit(makeJob());
  const int turns = postgres() ? 700 : 1400;
  for (int i = 0; i < turns; ++i) {
    ASSERT_TRUE((i % 2 ? store->resume(a) : store->pause(a)).ok());
    ASSERT_TRUE((i % 2 ? store->resume(b) : store->pause(b)).ok());
  }
  options.logEntries = 1u << 20;  // as nobody is shown: what lies there
  open();
  for (const int64_t id : {a, b}) {
    const auto all = entries(id, {.frames = {}, .after = 0, .most = 1u << 20});
    EXPECT_GE(all.size(), 50u);
    EXPECT_LT(all.size(), size_t(turns));
    EXPECT_EQ(all.back().kind(), v1::JobLogEntry::RESUMED);
    for (size_t i = 1; i < all.size(); ++i) EXPECT_EQ(all[i].sequence(), all[i - 1].sequence() + 2) << "without gaps";
  }
  EXPECT_EQ(said(quiet), "SUBMITTED");
  options.logEntries = 50;
  open();
  EXPECT_EQ(entries(a, {.frames = {}, .after = 0, .most = 10000}).size(), 50u);
}

}  // namespace
}  // namespace gobo::job_log_test
