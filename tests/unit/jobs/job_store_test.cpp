// SPDX-License-Identifier: Apache-2.0
// Semantics of the store under a clock of the test's own: fencing, expiry, retries, idempotent reports, order, states.
#include <set>

#include "unit/jobs/store_fixture.h"

namespace gobo {
namespace {

using Store = test::OnEachStore<test::StoreFixture>;
INSTANTIATE_TEST_SUITE_P(Stores, Store, test::kBothStores, test::storeName);

TEST_P(Store, AJobGoesFromQueuedToDone) {
  const int64_t id = submit(makeJob(2));
  EXPECT_EQ(get(id).state(), v1::Job::QUEUED);
  const auto a = claim(), b = claim();
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->frame, 10);
  EXPECT_EQ(b->frame, 11);
  EXPECT_GT(b->token, a->token);
  EXPECT_FALSE(claim());
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING);
  EXPECT_TRUE(store->complete(*b, files("bb"), 2).ok());
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING);
  time = 1234;
  EXPECT_TRUE(store->complete(*a, files("aa"), 1).ok());
  const v1::Job job = get(id);
  EXPECT_EQ(job.state(), v1::Job::DONE);
  EXPECT_EQ(job.frames_done(), 2u);
  EXPECT_EQ(job.result_bytes(), 14u);
  EXPECT_EQ(job.ended_unix_s(), 1234);
  EXPECT_EQ(job.progress(), 1);
  ASSERT_EQ(job.frames_size(), 2);
  EXPECT_EQ(job.frames(0).files(0).sha256(), "aa");
  EXPECT_EQ(job.frames(1).files(0).sha256(), "bb");
  EXPECT_EQ(job.frames(0).attempts(), 1u);
}

TEST_P(Store, ALateReportOfALostLeaseIsRefusedAndNamesBothTokens) {
  const int64_t id = submit(makeJob());
  const auto first = claim(30, "first");
  time += 31;
  EXPECT_EQ(*store->expireLeases(), 1u);
  const auto second = claim(30, "second");
  ASSERT_TRUE(second);
  EXPECT_EQ(second->task, first->task);
  Lease late = *first;
  const std::vector<Status> refusals = {store->complete(late, files(), 1),
                                        store->fail(late, {{Code::Internal, "x"}}),
                                        store->release(late),
                                        store->renew(late, 30).status(),
                                        store->check(late).status(),
                                        store->checkpoint(late, {"r", "d", 1, 1}, 0.5, 16).status()};
  for (const Status& status : refusals) {
    EXPECT_EQ(status.code(), Code::FailedPrecondition);
    EXPECT_NE(status.message().find("token " + std::to_string(first->token) + " "), std::string::npos) << status.message();
    EXPECT_NE(status.message().find("token is " + std::to_string(second->token)), std::string::npos) << status.message();
  }
  EXPECT_TRUE(store->checkpoints(second->task)->empty());
  EXPECT_EQ(get(id).frames(0).state(), v1::Frame::RUNNING);
  EXPECT_TRUE(store->complete(*second, files(), 1).ok());
  EXPECT_EQ(store->complete(late, files("other"), 1).code(), Code::FailedPrecondition);  // nor after the end
  EXPECT_EQ(get(id).frames(0).files(0).sha256(), "aa");
}

TEST_P(Store, AnExpiredLeaseIsOverOnlyOnceTheStoreSaysSo) {
  submit(makeJob());
  const auto lease = claim(30);
  time += 100;  // nobody looked: the holder was slow, not dead
  EXPECT_TRUE(store->check(*lease).ok());
  Lease renewed = *lease;
  EXPECT_TRUE(store->renew(renewed, 30).ok());
  EXPECT_EQ(*store->expireLeases(), 0u);  // the renewal counts
  time += 31;
  EXPECT_EQ(*store->expireLeases(), 1u);
  EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::FailedPrecondition);
}

TEST_P(Store, ACompletionReportMayBeRepeated) {
  const int64_t id = submit(makeJob());
  const auto lease = claim();
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
  open();
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
  EXPECT_EQ(get(id).frames_done(), 1u);
  EXPECT_EQ(get(id).result_bytes(), 7u);
  EXPECT_EQ(store->complete(*lease, files("other"), 1).code(), Code::FailedPrecondition);  // that is no repetition
}

TEST_P(Store, AFailedFrameIsTriedAgainUntilMaxAttempts) {
  const int64_t id = submit(makeJob(2));
  for (int attempt = 1; attempt <= 3; ++attempt) {
    const auto lease = claim();
    ASSERT_TRUE(lease);
    EXPECT_EQ(lease->frame, 10);
    EXPECT_TRUE(store->fail(*lease, {{Code::Internal, "no luck"}}).ok());
    EXPECT_TRUE(store->fail(*lease, {{Code::Internal, "no luck"}}).ok());  // repeated: counted once
    EXPECT_EQ(get(id).frames(0).attempts(), uint32_t(attempt));
    EXPECT_EQ(get(id).frames(0).state(), attempt < 3 ? v1::Frame::QUEUED : v1::Frame::FAILED);
    if (attempt < 3) {
      const auto other = claim();  // the frame waits before it is tried again: the next one is given
      ASSERT_TRUE(other);
      EXPECT_EQ(other->frame, 11);
      EXPECT_TRUE(store->release(*other).ok());
    }
    time += 60;
  }
  EXPECT_EQ(get(id).state(), v1::Job::QUEUED);  // the other frame goes on
  EXPECT_TRUE(store->complete(*claim(), files(), 1).ok());
  const v1::Job job = get(id);
  EXPECT_EQ(job.state(), v1::Job::FAILED);
  EXPECT_EQ(job.error().code(), int(Code::Internal));
  EXPECT_EQ(job.error().message(), "frame 10: no luck");
  EXPECT_EQ(job.frames_failed(), 1u);
  EXPECT_EQ(job.frames_done(), 1u);
  EXPECT_EQ(job.frames(1).attempts(), 1u);  // released ones are not attempts
}

TEST_P(Store, WhatCannotBeMendedIsNotTriedAgain) {
  const int64_t one = submit(makeJob(2)), two = submit(makeJob(2));
  EXPECT_TRUE(store->fail(*claim(), {{Code::InvalidArgument, "bad"}, false}).ok());
  EXPECT_EQ(get(one).frames(0).state(), v1::Frame::FAILED);
  EXPECT_EQ(get(one).frames(1).state(), v1::Frame::QUEUED);
  EXPECT_TRUE(store->complete(*claim(), files(), 1).ok());
  EXPECT_EQ(get(one).state(), v1::Job::FAILED);
  const auto a = claim(), b = claim();
  EXPECT_TRUE(store->fail(*a, {{Code::FailedPrecondition, "scene changed"}, false, true}).ok());
  EXPECT_EQ(get(two).state(), v1::Job::FAILED);
  EXPECT_EQ(get(two).error().message(), "scene changed");
  EXPECT_EQ(store->complete(*b, files(), 1).code(), Code::FailedPrecondition);
}

TEST_P(Store, OrderIsPriorityThenDeadlineThenAge) {
  const int64_t low = submit(makeJob(1, "", v1::JobSpec::LOW));
  const int64_t old = submit(makeJob(1)), later = submit(makeJob(1, "", v1::JobSpec::MEDIUM, 9000)), sooner = submit(makeJob(1, "", v1::JobSpec::MEDIUM, 8000));
  const int64_t high = submit(makeJob(2, "", v1::JobSpec::HIGH));
  std::vector<int64_t> order;
  while (const auto lease = claim()) order.push_back(lease->task.job);
  EXPECT_EQ(order, (std::vector<int64_t>{high, high, sooner, later, old, low}));
}

TEST_P(Store, TheSameKeyIsTheSameJob) {
  const int64_t id = submit(makeJob(1, "k"));
  bool existed = false;
  EXPECT_EQ(*store->submit(makeJob(1, "k"), existed), id);
  EXPECT_TRUE(existed);
  NewJob other = makeJob(1, "k");
  other.digest = "another";
  const auto refused = store->submit(other, existed);
  EXPECT_EQ(refused.status().code(), Code::AlreadyExists);
  EXPECT_NE(refused.status().message().find(jobIdText(id)), std::string::npos);
  other.client = "somebody else";
  EXPECT_NE(*store->submit(other, existed), id);
  EXPECT_NE(submit(makeJob()), submit(makeJob()));  // no key, no identity
  EXPECT_EQ(*store->findKey("me", "k", "d"), id);
  EXPECT_EQ(*store->findKey("me", "unknown", "d"), 0);
}

TEST_P(Store, PauseCancelAndResume) {
  const int64_t id = submit(makeJob(2));
  const auto lease = claim();
  EXPECT_TRUE(store->pause(id).ok());
  EXPECT_EQ(*store->check(*lease), v1::Job::PAUSED);
  EXPECT_FALSE(claim());
  EXPECT_TRUE(store->checkpoint(*lease, {"r", "d", 4, 100}, 0.5, 64).ok());  // its last one
  EXPECT_TRUE(store->release(*lease).ok());
  EXPECT_EQ(get(id).frames(0).checkpoint(), "d");
  EXPECT_EQ(get(id).progress(), 0.25);
  EXPECT_TRUE(store->resume(id).ok());
  EXPECT_EQ(get(id).state(), v1::Job::QUEUED);
  const auto again = claim();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->progress, 0.5);
  EXPECT_EQ(store->checkpoints(again->task)->at(0).digest, "d");
  EXPECT_EQ(store->remove(id).code(), Code::FailedPrecondition);
  EXPECT_TRUE(store->cancel(id).ok());
  EXPECT_EQ(store->complete(*again, files(), 1).code(), Code::FailedPrecondition);
  EXPECT_EQ(get(id).state(), v1::Job::CANCELLED);
  EXPECT_EQ(get(id).frames(1).state(), v1::Frame::CANCELLED);
  EXPECT_TRUE(store->neededCheckpoints()->empty());
  EXPECT_TRUE(store->resume(id).ok());
  EXPECT_EQ(get(id).state(), v1::Job::CANCELLED);
  EXPECT_TRUE(store->remove(id).ok());
  EXPECT_EQ(store->get(id, false).status().code(), Code::NotFound);
  EXPECT_GT(submit(makeJob()), id);  // an id is never used again
}

TEST_P(Store, FailedAndCancelledFramesWaitAgainAndFinishedOnesStay) {
  NewJob n = makeJob(3);
  n.spec.set_max_attempts(1);
  const int64_t id = submit(n);
  const auto a = claim(), b = claim();
  ASSERT_TRUE(store->complete(*a, files("aa"), 1).ok());
  ASSERT_TRUE(store->checkpoint(*b, {"r", "d", 1, 1}, 0.5, 16).ok());
  ASSERT_TRUE(store->fail(*b, {{Code::Internal, "the lamp fell over"}}).ok());
  ASSERT_TRUE(store->cancel(id).ok());
  const v1::Job ended = get(id);
  EXPECT_EQ(ended.state(), v1::Job::CANCELLED);
  EXPECT_EQ(ended.frames_failed(), 1u);
  const uint64_t before = store->get(id, false)->revision;
  ASSERT_TRUE(store->retry(id).ok());
  const v1::Job again = get(id);
  EXPECT_EQ(again.state(), v1::Job::QUEUED);
  EXPECT_EQ(again.frames_failed(), 0u);
  EXPECT_EQ(again.frames_done(), 1u);
  EXPECT_EQ(again.error().code(), 0);
  EXPECT_EQ(again.ended_unix_s(), 0);
  EXPECT_EQ(again.frames(0).state(), v1::Frame::DONE);
  for (int i = 1; i < 3; ++i) {
    EXPECT_EQ(again.frames(i).state(), v1::Frame::QUEUED);
    EXPECT_EQ(again.frames(i).attempts(), 0u);
    EXPECT_EQ(again.frames(i).progress(), 0);
    EXPECT_EQ(again.frames(i).error().code(), 0);
  }
  EXPECT_EQ(store->changes(id, before)->job.frames_size(), 2) << "who watches sees them";
  // Reports of the first life are refused; the frames get their attempts again and are rendered.
  EXPECT_EQ(store->complete(*b, files(), 1).code(), Code::FailedPrecondition);
  for (int i = 0; i < 2; ++i) {
    const auto l = claim();
    ASSERT_TRUE(l);
    EXPECT_GT(l->token, b->token);
    EXPECT_TRUE(store->checkpoints(l->task)->empty());
    ASSERT_TRUE(store->complete(*l, files("x" + std::to_string(i)), 1).ok());
  }
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_TRUE(store->retry(id).ok()) << "nothing is left to do";
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(store->retry(99).code(), Code::NotFound);
}

TEST_P(Store, RetryKeepsAPausedJobPausedAndARunningOneRunning) {
  NewJob n = makeJob(2);
  n.spec.set_max_attempts(1);
  const int64_t id = submit(n);
  const auto a = claim(), b = claim();
  ASSERT_TRUE(store->fail(*a, {{Code::Internal, "x"}}).ok());
  ASSERT_TRUE(store->retry(id).ok());
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING) << "its other frame is";
  const auto again = claim();
  ASSERT_TRUE(again);
  ASSERT_TRUE(store->fail(*again, {{Code::Internal, "x"}}).ok());
  ASSERT_TRUE(store->pause(id).ok());
  ASSERT_TRUE(store->retry(id).ok());
  EXPECT_EQ(get(id).state(), v1::Job::PAUSED);
  EXPECT_FALSE(claim());
  ASSERT_TRUE(store->complete(*b, files(), 1).ok());
}

TEST_P(Store, WhatCannotBeRetriedSaysWhy) {
  NewJob n = makeJob(2);
  n.spec.set_deadline_unix_s(2000);
  const int64_t late = submit(n);
  ASSERT_TRUE(store->cancel(late).ok());
  time = 2001;
  const Status passed = store->retry(late);
  EXPECT_EQ(passed.code(), Code::FailedPrecondition);
  EXPECT_NE(passed.message().find("deadline (2000.000) has passed"), std::string::npos) << passed.message();
  const int64_t gone = submit(makeJob(2));
  const auto a = claim();
  ASSERT_TRUE(store->complete(*a, files("aa"), 1).ok());
  ASSERT_TRUE(store->cancel(gone).ok());
  ASSERT_EQ(store->expireResults(0, 1e9)->size(), 1u);
  const Status expired = store->retry(gone);
  EXPECT_EQ(expired.code(), Code::FailedPrecondition);
  EXPECT_NE(expired.message().find("results of its other frames were removed"), std::string::npos) << expired.message();
  EXPECT_EQ(get(gone).state(), v1::Job::CANCELLED);
}

TEST_P(Store, APriorityThatIsChangedCountsFromTheNextClaim) {
  const int64_t first = submit(makeJob(2)), second = submit(makeJob(2));
  EXPECT_EQ(claim()->task.job, first);
  ASSERT_TRUE(store->prioritize(second, v1::JobSpec::HIGH).ok());
  EXPECT_EQ(get(second).spec().priority(), v1::JobSpec::HIGH);
  EXPECT_EQ(claim()->task.job, second);
  ASSERT_TRUE(store->prioritize(second, v1::JobSpec::LOW).ok());
  EXPECT_EQ(claim()->task.job, first);
  EXPECT_EQ(store->prioritize(99, v1::JobSpec::LOW).code(), Code::NotFound);
}

TEST_P(Store, DeadlinesFailTheJob) {
  const int64_t id = submit(makeJob(1, "", v1::JobSpec::MEDIUM, 1100));
  const auto lease = claim(1000);
  time = 1099;
  EXPECT_EQ(*store->expireLeases(), 0u);
  time = 1100;
  EXPECT_EQ(*store->expireLeases(), 1u);
  EXPECT_EQ(get(id).state(), v1::Job::FAILED);
  EXPECT_EQ(get(id).error().code(), int(Code::DeadlineExceeded));
  EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::FailedPrecondition);
}

TEST_P(Store, AFrameThatKillsItsWorkerEachTimeIsGivenUp) {
  options.maxLosses = 4;
  open();
  const int64_t id = submit(makeJob());
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(claim());
    EXPECT_EQ(*store->endAllLeases(), 1u);
  }
  const auto lease = claim();
  EXPECT_TRUE(store->checkpoint(*lease, {"r", "d", 4, 100}, 0.5, 64).ok());  // it gets on: the count starts anew
  EXPECT_EQ(*store->endAllLeases(), 1u);
  EXPECT_EQ(get(id).state(), v1::Job::QUEUED);
  EXPECT_EQ(get(id).frames(0).attempts(), 0u);  // losses are not failures
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(claim());
    EXPECT_EQ(*store->endAllLeases(), 1u);
  }
  EXPECT_EQ(get(id).state(), v1::Job::FAILED);
}

TEST_P(Store, CheckpointsReplaceEachOther) {
  submit(makeJob());
  const auto lease = claim();
  EXPECT_TRUE(store->checkpoint(*lease, {"r", "d1", 4, 100}, 0.25, 64)->empty());
  EXPECT_TRUE(store->checkpoint(*lease, {"s", "e1", 4, 100}, 0.25, 64)->empty());
  const auto old = *store->checkpoint(*lease, {"r", "d2", 4, 100}, 0.5, 64);
  ASSERT_EQ(old.size(), 1u);
  EXPECT_EQ(old[0].digest, "d1");
  EXPECT_TRUE(store->checkpoint(*lease, {"r", "d2", 4, 100}, 0.5, 64)->empty());  // repeated
  EXPECT_EQ(*store->neededCheckpoints(), (std::vector<std::string>{"1-0-d2", "1-0-e1"}));
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
  EXPECT_TRUE(store->neededCheckpoints()->empty());
}

TEST_P(Store, ListsByStateAndClientInPages) {
  std::vector<int64_t> ids;
  for (int i = 0; i < 5; ++i) ids.push_back(submit(makeJob()));
  NewJob other = makeJob();
  other.client = "you";
  const int64_t yours = submit(other);
  ASSERT_TRUE(store->cancel(ids[1]).ok());
  const auto idsOf = [](const std::vector<v1::Job>& jobs) {
    std::vector<int64_t> out;
    for (const auto& j : jobs) out.push_back(jobIdOf(j.id()));
    return out;
  };
  EXPECT_EQ(idsOf(*store->list({})), (std::vector<int64_t>{yours, ids[4], ids[3], ids[2], ids[1], ids[0]}));
  EXPECT_EQ(idsOf(*store->list({{v1::Job::CANCELLED, v1::Job::DONE}, "", 0, 50})), (std::vector<int64_t>{ids[1]}));
  EXPECT_EQ(idsOf(*store->list({{}, "you", 0, 50})), (std::vector<int64_t>{yours}));
  EXPECT_EQ(idsOf(*store->list({{}, "me", ids[3], 2})), (std::vector<int64_t>{ids[2], ids[1]}));
}

TEST_P(Store, ChangesAreWhatChangedSince) {
  const int64_t id = submit(makeJob(3));
  const uint64_t before = store->get(id, false)->revision;
  EXPECT_EQ(store->changes(id, before)->job.frames_size(), 0);
  const auto lease = claim();
  const auto claimed = *store->changes(id, before);
  ASSERT_EQ(claimed.job.frames_size(), 1);
  EXPECT_EQ(claimed.job.frames(0).frame(), 10);
  ASSERT_TRUE(store->complete(*lease, files(), 1).ok());
  const auto done = *store->changes(id, claimed.revision);
  ASSERT_EQ(done.job.frames_size(), 1);
  EXPECT_EQ(done.job.frames(0).files_size(), 1);
  EXPECT_EQ(store->changes(id, done.revision)->job.frames_size(), 0);
}

TEST_P(Store, ResultsGoByAgeAndByBytesButNotThoseOfJobsThatGoOn) {
  std::vector<int64_t> ids;
  for (int i = 0; i < 4; ++i) {
    ids.push_back(submit(makeJob(i == 3 ? 2 : 1)));
    time += 10;
    ASSERT_TRUE(store->complete(*claim(), files(), 1).ok());
  }
  EXPECT_EQ(*store->expireResults(100, 1000), (std::vector<int64_t>{}));
  EXPECT_EQ(*store->expireResults(14, 1000), (std::vector<int64_t>{ids[0]}));  // 7 bytes each; the earliest ended goes
  EXPECT_TRUE(get(ids[0]).results_expired());
  EXPECT_EQ(get(ids[0]).frames(0).files_size(), 0);
  EXPECT_EQ(get(ids[0]).state(), v1::Job::DONE);
  time += 985;
  EXPECT_EQ(*store->expireResults(100, 1000), (std::vector<int64_t>{ids[1]}));
  EXPECT_EQ(*store->expireResults(0, 0), (std::vector<int64_t>{ids[2]}));
  EXPECT_EQ(store->neededResults(ids[3])->size(), 1u);  // not over yet
}

TEST_P(Store, ManyFramesAreBounded) {
  options.maxActiveTasks = 10;
  open();
  const int64_t id = submit(makeJob(8));
  bool existed;
  EXPECT_EQ(store->submit(makeJob(3), existed).status().code(), Code::ResourceExhausted);
  EXPECT_TRUE(store->submit(makeJob(2), existed).ok());
  ASSERT_TRUE(store->cancel(id).ok());
  EXPECT_TRUE(store->submit(makeJob(8), existed).ok());
}

TEST(JobIds, AreReadBack) {
  EXPECT_EQ(jobIdOf(jobIdText(17)), 17);
  for (const char* bad : {"", "j-", "j-x", "17", "j-1x", "j--1", "j-99999999999999999999"}) EXPECT_EQ(jobIdOf(bad), 0) << bad;
}

}  // namespace
}  // namespace gobo
