// SPDX-License-Identifier: Apache-2.0
// Jobs that wait for others, in both stores; random graphs against a plain model of them.
#include <algorithm>
#include <atomic>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <thread>

#include "unit/jobs/store_fixture.h"

namespace gobo::job_depend_test {
namespace {

struct DependFixture : test::StoreFixture {
  int64_t submitAfter(const std::vector<int64_t>& after, int frames = 1) {
    NewJob job = makeJob(frames);
    job.after = after;
    for (int64_t id : after) job.spec.add_after(jobIdText(id));
    return submit(job);
  }
  std::vector<std::string> waits(int64_t id) {
    const v1::Job job = get(id);
    return {job.waits_for().begin(), job.waits_for().end()};
  }
  void finish(const std::optional<Lease>& lease) {
    ASSERT_TRUE(lease);
    ASSERT_TRUE(store->complete(*lease, files(), 1).ok());
  }
};
using Names = std::vector<std::string>;
using Depend = test::OnEachStore<DependFixture>;
INSTANTIATE_TEST_SUITE_P(Stores, Depend, test::kBothStores, test::storeName);

TEST_P(Depend, AJobStartsWhenAllThatItNeedsIsDone) {
  const int64_t a = submit(makeJob(2)), b = submit(makeJob(1)), c = submitAfter({a, b}, 2);
  EXPECT_EQ(waits(c), (Names{"j-1", "j-2"}));
  const auto a1 = claim(), a2 = claim(), b1 = claim();
  EXPECT_FALSE(claim());
  finish(b1);
  EXPECT_EQ(waits(c), (Names{"j-1"}));
  finish(a1);
  EXPECT_EQ(waits(c), (Names{"j-1"})) << "one of its frames is not all of it";
  EXPECT_FALSE(claim());
  finish(a2);
  EXPECT_EQ(waits(c), Names{});
  EXPECT_EQ(get(c).spec().after_size(), 2) << "what was asked for stays";
  const auto lease = claim();
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->task.job, c);
}

TEST_P(Depend, WhatIsDoneIsNotWaitedFor) {
  const int64_t a = submit(makeJob());
  finish(claim());
  const int64_t b = submitAfter({a});
  EXPECT_EQ(waits(b), Names{});
  EXPECT_EQ(claim()->task.job, b);
}

TEST_P(Depend, AWaitingJobOfHighPriorityHoldsNobodyUp) {
  const int64_t a = submit(makeJob(1, "", v1::JobSpec::LOW));
  NewJob urgent = makeJob(1, "", v1::JobSpec::HIGH);
  urgent.after = {a};
  const int64_t b = submit(urgent);
  const auto lease = claim();
  EXPECT_EQ(lease->task.job, a);
  finish(lease);
  EXPECT_EQ(claim()->task.job, b);
}

TEST_P(Depend, WhoNeedsAJobThatFailedWaitsForItsRetry) {
  NewJob once = makeJob();
  once.spec.set_max_attempts(1);
  const int64_t a = submit(once), b = submitAfter({a});
  ASSERT_TRUE(store->fail(*claim(), {{Code::Internal, "x"}}).ok());
  EXPECT_EQ(get(a).state(), v1::Job::FAILED);
  EXPECT_EQ(waits(b), (Names{"j-1"}));
  EXPECT_FALSE(claim());
  ASSERT_TRUE(store->retry(a).ok());
  ASSERT_TRUE(store->cancel(a).ok());
  EXPECT_FALSE(claim());
  ASSERT_TRUE(store->retry(a).ok());
  finish(claim());
  EXPECT_EQ(claim()->task.job, b);
}

TEST_P(Depend, ACancelledJobWaitsAgainWhenItIsRetried) {
  const int64_t a = submit(makeJob()), b = submitAfter({a});
  ASSERT_TRUE(store->cancel(b).ok());
  ASSERT_TRUE(store->retry(b).ok());
  EXPECT_EQ(waits(b), (Names{"j-1"}));
  const auto lease = claim();
  EXPECT_EQ(lease->task.job, a);
  EXPECT_FALSE(claim());
  finish(lease);
  EXPECT_EQ(claim()->task.job, b);
}

TEST_P(Depend, ADeadlinePassesWhileAJobWaits) {
  const int64_t a = submit(makeJob());
  NewJob late = makeJob(1, "", v1::JobSpec::MEDIUM, 1100);
  late.after = {a};
  const int64_t b = submit(late);
  time = 1100;
  EXPECT_EQ(*store->expireLeases(), 1u);
  EXPECT_EQ(get(b).state(), v1::Job::FAILED);
  EXPECT_EQ(get(b).error().code(), int(Code::DeadlineExceeded));
}

TEST_P(Depend, TheListIsReplaced) {
  const int64_t a = submit(makeJob()), b = submit(makeJob()), c = submitAfter({a});
  ASSERT_TRUE(store->depend(c, {b}).ok());
  EXPECT_EQ(waits(c), (Names{"j-2"}));
  EXPECT_EQ(get(c).spec().after(0), "j-2");
  EXPECT_EQ(get(c).spec().after_size(), 1);
  ASSERT_TRUE(store->remove(a).code() == Code::FailedPrecondition);  // not over; but nobody waits for it:
  ASSERT_TRUE(store->cancel(a).ok());
  EXPECT_TRUE(store->remove(a).ok());
  ASSERT_TRUE(store->depend(c, {}).ok());
  EXPECT_EQ(waits(c), Names{});
  EXPECT_EQ(get(c).spec().after_size(), 0);
  // A frame that runs goes on when its job is told to wait; the next one is not given.
  const int64_t d = submit(makeJob(2, "", v1::JobSpec::HIGH));
  const auto lease = claim();
  ASSERT_EQ(lease->task.job, d);
  ASSERT_TRUE(store->depend(d, {b}).ok());
  EXPECT_NE(claim()->task.job, d);
  EXPECT_TRUE(store->check(*lease).ok());
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
}

TEST_P(Depend, AJobWhoseLastFrameRanIsDoneAndLetsGo) {
  const int64_t a = submit(makeJob()), b = submit(makeJob());
  const auto la = claim();
  ASSERT_TRUE(store->depend(a, {b}).ok());
  const int64_t c = submitAfter({a});
  finish(la);
  EXPECT_EQ(get(a).state(), v1::Job::DONE);
  EXPECT_EQ(waits(a), Names{}) << "it is done";
  EXPECT_EQ(waits(c), Names{});
}

TEST_P(Depend, FaultsNameTheField) {
  const int64_t a = submit(makeJob());
  NewJob job = makeJob();
  job.after = {a, 77};
  bool existed = false;
  const auto refused = store->submit(job, existed);
  EXPECT_EQ(refused.status().code(), Code::NotFound);
  EXPECT_EQ(refused.status().location(), "job.after[1]");
  EXPECT_NE(refused.status().message().find("j-77"), std::string::npos);
  EXPECT_EQ(store->list({})->size(), 1u) << "nothing of it stays";
  const Status none = store->depend(a, {77});
  EXPECT_EQ(none.code(), Code::NotFound);
  EXPECT_EQ(none.location(), "after[0]");
  EXPECT_EQ(store->depend(99, {a}).code(), Code::NotFound);
  ASSERT_TRUE(store->cancel(a).ok());
  const int64_t b = submit(makeJob());
  const Status over = store->depend(a, {b});
  EXPECT_EQ(over.code(), Code::FailedPrecondition);
  EXPECT_NE(over.message().find("j-1 is CANCELLED"), std::string::npos) << over.message();
  EXPECT_TRUE(store->depend(a, {}).ok()) << "it waits for nothing";
}

TEST_P(Depend, CirclesAreRefusedByTheirWayRound) {
  const int64_t a = submit(makeJob()), b = submitAfter({a}), c = submitAfter({b}), d = submitAfter({a, c});
  const auto refused = [&](int64_t id, std::vector<int64_t> after, const char* way) {
    const std::string before = get(id).ShortDebugString();
    const Status status = store->depend(id, after);
    EXPECT_EQ(status.code(), Code::InvalidArgument) << status.toString();
    EXPECT_EQ(status.location(), "after");
    EXPECT_NE(status.message().find(way), std::string::npos) << status.message();
    EXPECT_EQ(get(id).ShortDebugString(), before);
  };
  refused(a, {a}, ": j-1 -> j-1");
  refused(a, {b}, ": j-1 -> j-2 -> j-1");
  refused(a, {c}, ": j-1 -> j-3 -> j-2 -> j-1");
  refused(a, {d}, ": j-1 -> j-4 -> j-1");  // the shortest one
  refused(b, {d, a}, ": j-2 -> j-4 -> j-3 -> j-2");
  ASSERT_TRUE(store->cancel(b).ok());
  refused(a, {b}, ": j-1 -> j-2 -> j-1");  // its retry would wait
  EXPECT_TRUE(store->depend(d, {a, b, c}).ok()) << "many ways are no circle";
  EXPECT_TRUE(store->depend(c, {}).ok());
  EXPECT_TRUE(store->depend(a, {c}).ok());
}

TEST_P(Depend, WhatIsWaitedForIsNotDeleted) {
  const int64_t a = submit(makeJob()), b = submitAfter({a}), c = submitAfter({a});
  ASSERT_TRUE(store->cancel(a).ok());
  const Status refused = store->remove(a);
  EXPECT_EQ(refused.code(), Code::FailedPrecondition);
  EXPECT_NE(refused.message().find("j-1 is waited for by j-2, j-3"), std::string::npos) << refused.message();
  ASSERT_TRUE(store->depend(b, {}).ok());
  ASSERT_TRUE(store->cancel(c).ok());
  EXPECT_EQ(store->remove(a).code(), Code::FailedPrecondition) << "the retry of j-3 would wait";
  ASSERT_TRUE(store->depend(c, {}).ok());
  EXPECT_TRUE(store->remove(a).ok());
  for (int i = 0; i < 12; ++i) submitAfter({b});
  ASSERT_TRUE(store->cancel(b).ok());
  EXPECT_NE(store->remove(b).message().find("and 2 more"), std::string::npos);
}

TEST_P(Depend, ListsAndChangesSayWhatIsWaitedFor) {
  const int64_t a = submit(makeJob()), b = submitAfter({a}), c = submitAfter({a, b});
  const auto jobs = *store->list({});
  ASSERT_EQ(jobs.size(), 3u);
  EXPECT_EQ(jobs[0].id(), jobIdText(c));
  EXPECT_EQ(Names(jobs[0].waits_for().begin(), jobs[0].waits_for().end()), (Names{"j-1", "j-2"}));
  EXPECT_EQ(Names(jobs[1].waits_for().begin(), jobs[1].waits_for().end()), (Names{"j-1"}));
  EXPECT_EQ(jobs[2].waits_for_size(), 0);
  EXPECT_EQ(store->changes(c, 0)->job.waits_for_size(), 2);
}

// Any order of submissions, dependencies, ends and retries against a model: a frame is given only by a job all of whose needs are done, one is given when there
// is such a job, and no circle ever stands. Seeds 1 to 6.
TEST_P(Depend, RandomGraphsFollowTheirModel) {
  int circles = 0, given = 0;
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    if (seed > 1) {
      store.reset();
      std::filesystem::remove_all(folder);
      makePlace();
      open();
    }
    std::mt19937 random(seed);
    const auto below = [&](size_t n) { return size_t(random() % std::max<size_t>(1, n)); };
    struct Model {
      v1::Job::State state = v1::Job::QUEUED;
      std::set<int64_t> needs;
    };
    std::map<int64_t, Model> model;
    const auto over = [](v1::Job::State s) { return jobIsOver(s); };
    const auto blocked = [&](const Model& m) {
      return std::any_of(m.needs.begin(), m.needs.end(), [&](int64_t n) { return model[n].state != v1::Job::DONE; });
    };
    std::function<bool(int64_t, int64_t)> reaches = [&](int64_t from, int64_t to) {
      if (from == to) return true;
      if (model[from].state == v1::Job::DONE) return false;
      const auto needs = model[from].needs;
      return std::any_of(needs.begin(), needs.end(), [&](int64_t n) { return model[n].state != v1::Job::DONE && reaches(n, to); });
    };
    const auto some = [&] {
      std::vector<int64_t> ids;
      for (const auto& [id, m] : model) ids.push_back(id);
      return ids.empty() ? 0 : ids[below(ids.size())];
    };
    for (int step = 0; step < 120; ++step) {
      switch (random() % 6) {
        case 0: {
          std::set<int64_t> needs;
          for (size_t i = below(4); i > 0 && !model.empty(); --i) needs.insert(some());
          model[submitAfter({needs.begin(), needs.end()})].needs = needs;
          break;
        }
        case 1: {
          const int64_t id = some();
          if (!id) break;
          std::set<int64_t> needs;
          for (size_t i = below(3); i > 0; --i) needs.insert(some());
          const Status status = store->depend(id, {needs.begin(), needs.end()});
          if (over(model[id].state) && !needs.empty()) {
            EXPECT_EQ(status.code(), Code::FailedPrecondition);
            break;
          }
          const bool circle = std::any_of(needs.begin(), needs.end(), [&](int64_t n) { return model[n].state != v1::Job::DONE && reaches(n, id); });
          EXPECT_EQ(status.code(), circle ? Code::InvalidArgument : Code::Ok) << "seed " << seed << " step " << step << " " << status.toString();
          circles += circle;
          if (!circle) model[id].needs = needs;
          break;
        }
        case 2: {
          const int64_t id = some();
          if (!id || over(model[id].state)) break;
          ASSERT_TRUE(store->cancel(id).ok());
          model[id].state = v1::Job::CANCELLED;
          break;
        }
        case 3: {
          const int64_t id = some();
          if (!id || model[id].state != v1::Job::CANCELLED) break;
          ASSERT_TRUE(store->retry(id).ok());
          model[id].state = v1::Job::QUEUED;
          break;
        }
        default: {
          const auto lease = claim();
          const bool ready = std::any_of(model.begin(), model.end(), [&](const auto& m) { return !over(m.second.state) && !blocked(m.second); });
          ASSERT_EQ(bool(lease), ready) << "seed " << seed << " step " << step;
          if (!lease) break;
          ++given;
          ASSERT_FALSE(blocked(model[lease->task.job])) << "seed " << seed << " step " << step;
          finish(lease);
          model[lease->task.job].state = v1::Job::DONE;
          break;
        }
      }
    }
    for (auto& [id, m] : model) {
      Names expected;
      if (m.state != v1::Job::DONE)
        for (int64_t n : m.needs)
          if (model[n].state != v1::Job::DONE) expected.push_back(jobIdText(n));
      EXPECT_EQ(waits(id), expected) << "seed " << seed << " job " << id;
    }
  }
  EXPECT_GT(given, 60);
  EXPECT_GT(circles, 1);
}

// Three connections submit, change what waits for what, and finish frames, all at once. A circle, or a job that waits for one whose end it missed, would
// be left over when everything that can be rendered is.
TEST_P(Depend, HandsThatMeetLeaveNoCircleAndNobodyBehind) {
  constexpr int kHands = 3, kSteps = 80;
  for (int i = 0; i < 4; ++i) submit(makeJob());
  std::vector<std::unique_ptr<SqlJobStore>> stores;
  for (int i = 0; i < kHands; ++i) stores.push_back(std::move(*another()));
  std::atomic<int> circles{0}, changed{0}, finished{0}, odd{0};
  std::vector<std::thread> hands;
  for (int n = 0; n < kHands; ++n)
    hands.emplace_back([&, n] {
      std::mt19937 random(uint32_t(n + 1));
      SqlJobStore& s = *stores[size_t(n)];
      for (int i = 0; i < kSteps; ++i) {
        std::vector<int64_t> open;
        const auto jobs = s.list({{v1::Job::QUEUED, v1::Job::RUNNING}, "", 0, 1000});
        if (!jobs.ok()) ++odd;
        else
          for (const v1::Job& job : *jobs) open.push_back(jobIdOf(job.id()));
        const auto some = [&] { return open[random() % open.size()]; };
        switch (open.size() < 3 ? 0 : random() % 4) {
          case 0: {
            NewJob job = makeJob();
            if (!open.empty()) job.after = {some()};
            bool existed = false;
            odd += !s.submit(job, existed).ok();
            break;
          }
          case 1: {
            const auto lease = s.claim("h" + std::to_string(n), 1000);
            if (!lease.ok()) ++odd;
            else if (*lease) odd += !s.complete(**lease, files(), 0).ok(), ++finished;
            break;
          }
          default: {
            const Status status = s.depend(some(), {some()});
            changed += status.ok();
            circles += status.code() == Code::InvalidArgument;
            odd += !status.ok() && status.code() != Code::InvalidArgument && status.code() != Code::FailedPrecondition;
            break;
          }
        }
      }
    });
  for (auto& h : hands) h.join();
  EXPECT_EQ(odd, 0);
  EXPECT_GT(circles, 0);
  EXPECT_GT(changed, 10);
  EXPECT_GT(finished, 10);
  while (const auto lease = claim()) finish(lease);
  const auto left = *store->list({{}, "", 0, 1000});
  for (const v1::Job& job : left) EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
  EXPECT_EQ(*store->integrity(), "ok");
}

}  // namespace
}  // namespace gobo::job_depend_test
