// SPDX-License-Identifier: Apache-2.0
// Scheduler: each rule of its header by a small case. The long random runs are in scheduler_simulation_test.cpp.
#include "server/scheduler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>

namespace gobo::scheduler_test {
namespace {

using Kind = Action::Kind;

JobSpec job(std::string client, JobClass c, uint64_t bytes = 0, double deadline = kNever) { return {std::move(client), c, deadline, bytes}; }
constexpr JobClass I = JobClass::Interactive, N = JobClass::Normal, B = JobClass::Batch;

std::string show(const std::vector<Action>& actions) {
  std::string text;
  for (const Action& a : actions) {
    const char* kinds[] = {"start", "preempt", "stop", "expire"};
    text += (text.empty() ? "" : " ") + std::string(kinds[int(a.kind)]) + std::to_string(a.id);
  }
  return text;
}
SchedulerOptions slots(int n) {
  SchedulerOptions o;
  o.slots = n;
  return o;
}

TEST(Scheduler, FillsSlotsInOrderOfSubmissionAndNoMore) {
  Scheduler s(slots(2));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(s.submit(job("a", N), 0).id, JobId(i + 1));
  EXPECT_EQ(show(s.decide(0)), "start1 start2");
  EXPECT_EQ(show(s.decide(0)), "");  // every action once
  s.finished(2, 1, Outcome::Done);
  EXPECT_EQ(show(s.decide(1)), "start3");
  EXPECT_EQ(s.running(), 2u);
}

TEST(Scheduler, HigherClassFirst) {
  Scheduler s(slots(1));
  (void)s.submit(job("a", B), 0), (void)s.submit(job("a", N), 0), (void)s.submit(job("a", I), 0);
  EXPECT_EQ(show(s.decide(0)), "start3");
  s.finished(3, 1, Outcome::Done);
  EXPECT_EQ(show(s.decide(1)), "start2");
  s.finished(2, 2, Outcome::Done);
  EXPECT_EQ(show(s.decide(2)), "start1");
}

TEST(Scheduler, InteractivePreemptsLowestClassLatestStarted) {
  Scheduler s(slots(3));
  (void)s.submit(job("a", N), 0);
  (void)s.decide(0);
  (void)s.submit(job("a", B), 1);
  (void)s.decide(1);
  (void)s.submit(job("a", B), 2);
  (void)s.decide(2);
  (void)s.submit(job("b", I), 3);
  EXPECT_EQ(show(s.decide(3)), "preempt3");
  EXPECT_EQ(show(s.decide(3)), "");  // one is enough: not again while it is giving way
  EXPECT_TRUE(s.preempted(3, 3.01));
  EXPECT_EQ(show(s.decide(3.01)), "start4");  // and not the preempted one
  (void)s.submit(job("b", I), 4), (void)s.submit(job("c", I), 4), (void)s.submit(job("d", I), 4);
  EXPECT_EQ(show(s.decide(4)), "preempt2 preempt1");  // the third finds nothing of a lower class
  EXPECT_EQ(s.running(), 3u);
}

TEST(Scheduler, NormalPreemptsBatchButNeverItsOwnClassOrAHigherOne) {
  Scheduler s(slots(1));
  (void)s.submit(job("a", B), 0);
  (void)s.decide(0);
  (void)s.submit(job("b", N), 1);
  EXPECT_EQ(show(s.decide(1)), "preempt1");
  EXPECT_TRUE(s.preempted(1, 1));
  EXPECT_EQ(show(s.decide(1)), "start2");
  (void)s.submit(job("c", N), 2), (void)s.submit(job("c", B), 2);
  EXPECT_EQ(show(s.decide(2)), "");
  s.finished(2, 3, Outcome::Done);
  EXPECT_EQ(show(s.decide(3)), "start3");
  s.finished(3, 4, Outcome::Done);
  EXPECT_EQ(show(s.decide(4)), "start1");  // client a has had a second, but c came later and has no credit: order
  s.finished(1, 5, Outcome::Done);
  EXPECT_EQ(show(s.decide(5)), "start4");
  EXPECT_EQ(s.stats().classes[2].preempted, 1u);
}

TEST(Scheduler, PreemptsForBytesNoMoreThanNeeded) {
  SchedulerOptions o = slots(10);
  o.pinnedLimit = 100;
  Scheduler s(o);
  (void)s.submit(job("a", B, 60), 0);
  (void)s.decide(0);
  (void)s.submit(job("a", B, 10), 1);
  (void)s.decide(1);
  (void)s.submit(job("a", B, 10), 2);
  (void)s.decide(2);
  (void)s.submit(job("b", I, 50), 3);
  EXPECT_EQ(show(s.decide(3)), "preempt1");  // the later ones are too small to help, and are left alone
  EXPECT_TRUE(s.preempted(1, 3));
  EXPECT_EQ(show(s.decide(3)), "start4");
  (void)s.submit(job("b", I, 90), 4);  // 50 of its own class stay: nothing to gain, nobody preempted
  EXPECT_EQ(show(s.decide(4)), "");
}

TEST(Scheduler, FairShareByConsumedTimeNotByCount) {
  Scheduler s(slots(1));
  for (int i = 0; i < 30; ++i) (void)s.submit(job("long", N), 0);
  for (int i = 0; i < 300; ++i) (void)s.submit(job("short", N), 0);  // beyond its bound some are refused: enough remain
  double now = 0;
  while (now < 100) {
    const auto actions = s.decide(now);
    ASSERT_EQ(actions.size(), 1u);
    now += actions[0].id <= 30 ? 8.0 : 0.5;
    s.finished(actions[0].id, now, Outcome::Done);
  }
  const auto seconds = s.stats().clientSeconds;
  EXPECT_NEAR(seconds.at("long") / seconds.at("short"), 1.0, 0.2);
}

TEST(Scheduler, NewcomerAndReturnerGetNoCreditForIdleTime) {
  Scheduler s(slots(1));
  double now = 0;
  const auto runOne = [&] {
    const auto a = s.decide(now);
    EXPECT_EQ(a.size(), 1u);
    now += 1;
    s.finished(a[0].id, now, Outcome::Done);
    return a[0].id;
  };
  for (int i = 0; i < 200; ++i) (void)s.submit(job("old", N), now);
  for (int i = 0; i < 100; ++i) runOne();  // 100 s while nobody else was there
  const JobId firstNew = s.submit(job("new", N), now).id;
  for (int i = 0; i < 49; ++i) (void)s.submit(job("new", N), now);
  int mine = 0;
  for (int i = 0; i < 20; ++i) mine += runOne() >= firstNew;
  EXPECT_NEAR(mine, 10, 1);  // half, and not 20
}

TEST(Scheduler, SlotsAreSharedFromTheFirstDecisionOn) {
  Scheduler s(slots(4));
  for (int i = 0; i < 4; ++i) (void)s.submit(job("a", N), 0);
  for (int i = 0; i < 4; ++i) (void)s.submit(job("b", N), 0);
  EXPECT_EQ(show(s.decide(0)), "start1 start5 start2 start6");  // though nobody has consumed anything yet
}

TEST(Scheduler, EarliestDeadlineFirstInsideAClientOnly) {
  Scheduler s(slots(1));
  (void)s.submit(job("a", N), 0), (void)s.submit(job("a", N, 0, 90), 0), (void)s.submit(job("a", N, 0, 50), 0);
  (void)s.submit(job("b", N, 0, 10), 0);
  EXPECT_EQ(show(s.decide(0)), "start3");  // a was first; among its jobs the deadline decides
  s.finished(3, 1, Outcome::Done);
  EXPECT_EQ(show(s.decide(1)), "start4");  // b's turn
  s.finished(4, 3, Outcome::Done);
  EXPECT_EQ(show(s.decide(3)), "start2");
  s.finished(2, 4, Outcome::Done);
  EXPECT_EQ(show(s.decide(4)), "start1");
}

TEST(Scheduler, DeadlinesExpireQueuedJobsAndStopRunningOnes) {
  Scheduler s(slots(1));
  EXPECT_EQ(s.submit(job("a", N, 0, 5), 5).status.code(), Code::DeadlineExceeded);
  (void)s.submit(job("a", N, 0, 20), 6), (void)s.submit(job("a", N, 0, 30), 6);
  EXPECT_EQ(show(s.decide(6)), "start1");
  EXPECT_EQ(s.nextEvent(6), 20.0);
  const auto stop = s.decide(20);
  EXPECT_EQ(show(stop), "stop1");
  EXPECT_EQ(stop[0].reason, StopReason::Deadline);
  EXPECT_EQ(show(s.decide(21)), "");
  EXPECT_EQ(show(s.decide(30)), "expire2");
  s.finished(1, 30, Outcome::Failed);
  EXPECT_EQ(show(s.decide(30)), "");
  EXPECT_EQ(s.stats().classes[1].expired, 2u);
  EXPECT_EQ(s.queued() + s.running(), 0u);
}

TEST(Scheduler, PreemptedJobPastItsDeadlineIsGone) {
  Scheduler s(slots(1));
  (void)s.submit(job("a", B, 0, 5), 0);
  (void)s.decide(0);
  (void)s.submit(job("b", I), 4.9);
  EXPECT_EQ(show(s.decide(4.9)), "preempt1");
  EXPECT_FALSE(s.preempted(1, 5));
  EXPECT_EQ(show(s.decide(5)), "start2");
}

TEST(Scheduler, CancelQueuedRunningPreemptingAndUnknown) {
  Scheduler s(slots(1));
  for (int i = 0; i < 3; ++i) (void)s.submit(job("a", B), 0);
  (void)s.decide(0);
  EXPECT_EQ(s.cancel(2, 1), CancelResult::Removed);
  EXPECT_EQ(s.cancel(2, 1), CancelResult::Unknown);
  EXPECT_EQ(s.cancel(1, 1), CancelResult::Stopping);
  EXPECT_EQ(s.nextEvent(1), 1.0);  // at once
  const auto stop = s.decide(1);
  EXPECT_EQ(show(stop), "stop1");
  EXPECT_EQ(stop[0].reason, StopReason::Cancelled);
  EXPECT_EQ(s.cancel(1, 1), CancelResult::Stopping);
  EXPECT_EQ(show(s.decide(1)), "");  // told once
  EXPECT_EQ(s.running(), 1u);        // holds its slot until it says so
  s.finished(1, 2, Outcome::Failed);
  EXPECT_EQ(show(s.decide(2)), "start3");
  (void)s.submit(job("b", I), 3);
  EXPECT_EQ(show(s.decide(3)), "preempt3");
  EXPECT_EQ(s.cancel(3, 3), CancelResult::Stopping);
  EXPECT_EQ(show(s.decide(3)), "stop3");  // overrides the preemption
  EXPECT_FALSE(s.preempted(3, 3));        // and is not queued again
  EXPECT_EQ(show(s.decide(3)), "start4");
  EXPECT_EQ(s.stats().classes[2].cancelled, 3u);
}

TEST(Scheduler, QueueBoundsRefuseWithAHintFromTheMeasuredRate) {
  SchedulerOptions o = slots(1);
  o.queueLimit = {2, 5, 5};
  o.clientLimit = 3;
  Scheduler s(o);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(s.submit(job("a", N), 0).status.ok());
  const Submit own = s.submit(job("a", B), 0);  // per client, over all classes
  EXPECT_EQ(own.status.code(), Code::ResourceExhausted);
  EXPECT_GT(own.retryMs, 0);
  EXPECT_EQ(own.id, 0u);
  ASSERT_TRUE(s.submit(job("b", N), 0).status.ok());
  double now = 0;
  int names = 0;
  for (int i = 0; i < 60; ++i) {  // one job every 2.5 s, the queue never empty
    const auto a = s.decide(now);
    ASSERT_EQ(a.size(), 1u);
    now += 2.5;
    s.finished(a[0].id, now, Outcome::Done);
    while (s.queued() < 5) (void)s.submit(job("c" + std::to_string(++names), N), now);
  }
  (void)s.decide(now);
  while (s.queued() < 5) (void)s.submit(job("d" + std::to_string(++names), N), now);
  const Submit first = s.submit(job("x", N), now), second = s.submit(job("y", N), now);
  EXPECT_EQ(first.status.code(), Code::ResourceExhausted);
  EXPECT_NEAR(first.retryMs, 2500, 50);
  EXPECT_NEAR(second.retryMs, 5000, 100);                          // not at the same moment
  EXPECT_NEAR(s.submit(job("z", N), now + 20).retryMs, 60000, 1);  // nothing has started for 20 s: 3 * 20 s
  EXPECT_TRUE(s.submit(job("x", I), now).status.ok());             // another class has its own queue
}

TEST(Scheduler, PreemptedJobIsTakenBackEvenIntoAFullQueue) {
  SchedulerOptions o = slots(1);
  o.queueLimit = {1, 1, 1};
  Scheduler s(o);
  (void)s.submit(job("a", B), 0);
  (void)s.decide(0);
  ASSERT_TRUE(s.submit(job("a", B), 0).status.ok());
  (void)s.submit(job("b", I), 0);
  (void)s.decide(0);
  EXPECT_TRUE(s.preempted(1, 0));
  EXPECT_EQ(s.queued(), 3u);
}

TEST(Scheduler, JobLargerThanTheLimitIsRefusedForGood) {
  SchedulerOptions o = slots(2);
  o.pinnedLimit = 100;
  Scheduler s(o);
  const Submit refused = s.submit(job("a", N, 101), 0);
  EXPECT_EQ(refused.status.code(), Code::FailedPrecondition);
  EXPECT_EQ(refused.retryMs, 0);
  EXPECT_NE(refused.status.message().find("101"), std::string::npos);
  EXPECT_TRUE(s.submit(job("a", N, 100), 0).status.ok());
}

TEST(Scheduler, LargeJobLetsSmallerOnesPassForAWhileThenHoldsRoom) {
  SchedulerOptions o = slots(8);
  o.pinnedLimit = 100;
  Scheduler s(o);
  (void)s.submit(job("a", N, 50), 0);
  EXPECT_EQ(show(s.decide(0)), "start1");
  (void)s.submit(job("b", N, 80), 1), (void)s.submit(job("c", N, 20), 1);
  EXPECT_EQ(show(s.decide(1)), "start3");  // 80 does not fit; 20 passes
  EXPECT_EQ(s.nextEvent(1), 6.0);
  (void)s.submit(job("c", N, 20), 5.9);
  EXPECT_EQ(show(s.decide(5.9)), "start4");
  (void)s.submit(job("c", N, 5), 6), (void)s.submit(job("d", N, 0), 6);
  EXPECT_EQ(show(s.decide(6)), "start6");  // from now on bytes are kept for it; what needs none may pass
  s.finished(3, 7, Outcome::Done);
  EXPECT_EQ(show(s.decide(7)), "");  // 30 free, 5 would fit, but it waits behind
  s.finished(1, 8, Outcome::Done);
  EXPECT_EQ(show(s.decide(8)), "start2");  // 20 + 80
  s.finished(4, 9, Outcome::Done);
  EXPECT_EQ(show(s.decide(9)), "start5");
}

TEST(Scheduler, AgeingGivesBatchATurnThatIsProtectedAndThenPreemptible) {
  SchedulerOptions o = slots(1);  // ageing of batch 30 s, protected for 1 s
  Scheduler s(o);
  const JobId batch = s.submit(job("b", B), 0).id;
  double now = 0, started = -1;
  for (int i = 0; i < 100 && started < 0; ++i) {  // interactive without a gap
    (void)s.submit(job("i", I), now);
    for (const Action& a : s.decide(now)) {
      if (a.id == batch) {
        started = now;
        break;
      }
      now += 0.5;
      (void)s.submit(job("i", I), now);  // the next one is there before this one ends
      s.finished(a.id, now, Outcome::Done);
    }
  }
  EXPECT_GE(started, 30);
  EXPECT_LE(started, 30.5);
  EXPECT_EQ(show(s.decide(started + 0.5)), "");  // not preempted within its turn, though interactive waits
  EXPECT_EQ(s.nextEvent(started + 0.5), started + 1);
  EXPECT_EQ(show(s.decide(started + 1)), "preempt" + std::to_string(batch));
  EXPECT_TRUE(s.preempted(batch, started + 1));
  const auto after = s.decide(started + 1);  // its turn is over: the clock starts anew
  ASSERT_EQ(after.size(), 1u);
  EXPECT_NE(after[0].id, batch);
}

TEST(Scheduler, ShortRunsInGapsDoNotResetTheAgeingClock) {
  Scheduler s(slots(1));
  const JobId batch = s.submit(job("b", B), 0).id;
  double now = 0;
  for (int i = 0; i < 29; ++i) {  // 10 ms of run in every second: too little for a block of samples
    EXPECT_EQ(show(s.decide(now)), "start" + std::to_string(batch));
    const JobId hot = s.submit(job("i", I), now + 0.01).id;
    EXPECT_EQ(show(s.decide(now + 0.01)), "preempt" + std::to_string(batch));
    EXPECT_TRUE(s.preempted(batch, now + 0.01));
    EXPECT_EQ(show(s.decide(now + 0.01)), "start" + std::to_string(hot));
    now += 1;
    s.finished(hot, now, Outcome::Done);
  }
  const JobId hot = s.submit(job("i", I), now).id;
  EXPECT_EQ(show(s.decide(now)), "start" + std::to_string(hot));
  (void)s.submit(job("i", I), now + 2);
  s.finished(hot, now + 2, Outcome::Done);
  EXPECT_EQ(show(s.decide(now + 2)), "start" + std::to_string(batch));
  (void)s.submit(job("i", I), now + 2.1);
  EXPECT_EQ(show(s.decide(now + 2.1)), "");
}

TEST(Scheduler, ClientsWithoutDebtAreForgotten) {
  Scheduler s(slots(1));
  double now = 0;
  for (int i = 0; i < 2000; ++i) {
    (void)s.submit(job("one-off " + std::to_string(i), N), now);
    const auto a = s.decide(now);
    now += 1;
    s.finished(a[0].id, now, Outcome::Done);
  }
  EXPECT_LE(s.stats().clientSeconds.size(), 2u);
}

TEST(Scheduler, TimeThatRunsBackwardsChangesNothing) {
  Scheduler s(slots(1));
  (void)s.submit(job("a", N, 0, 10), 5);
  EXPECT_EQ(show(s.decide(3)), "start1");
  EXPECT_EQ(show(s.decide(11)), "stop1");
  s.finished(1, 4, Outcome::Done);
  EXPECT_DOUBLE_EQ(s.stats().classes[1].runSeconds, 6);
}

TEST(Scheduler, AClientsHintGrowsWithTheClientsThatWait) {
  double alone = 0;
  for (const int waiting : {1, 3}) {
    SchedulerOptions o = slots(1);
    o.clientLimit = 2;
    Scheduler s(o);
    (void)s.submit(job("runs", N), 0);
    (void)s.decide(0);
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(s.submit(job("a", N), 0).status.ok());
    for (int i = 1; i < waiting; ++i) ASSERT_TRUE(s.submit(job("other" + std::to_string(i), N), 0).status.ok());
    const double hint = s.submit(job("a", N), 0).retryMs;
    if (waiting == 1) alone = hint;
    else EXPECT_DOUBLE_EQ(hint, 3 * alone);
  }
  EXPECT_GT(alone, 0);
}

JobSpec named(std::string group, std::string client, JobClass c) {
  JobSpec spec = job(std::move(client), c);
  spec.group = std::move(group);
  return spec;
}

// Runs `rounds` jobs of one second, one at a time, while every group keeps `depth` jobs queued; the seconds each group got.
std::map<std::string, int> shares(const std::vector<std::string>& groups, const std::function<std::string(const std::string&, int)>& name, int depth,
                                  int rounds) {
  Scheduler s(slots(1));
  std::map<JobId, std::string> of;
  std::map<std::string, int> queued, got;
  double now = 0;
  for (int r = 0, n = 0; r < rounds; ++r) {
    for (const std::string& g : groups)
      while (queued[g] < depth) {
        const Submit submitted = s.submit(named(g, name(g, n++), N), now);
        EXPECT_TRUE(submitted.status.ok());
        of[submitted.id] = g;
        ++queued[g];
      }
    const auto actions = s.decide(now);
    EXPECT_EQ(actions.size(), 1u);
    const std::string g = of[actions[0].id];
    --queued[g];
    ++got[g];
    s.finished(actions[0].id, now += 1, Outcome::Done);
  }
  return got;
}

// A new name for each call is a new client of its group, and takes nothing of another group.
TEST(Scheduler, NamesDivideTheirGroupsShareOnly) {
  const auto got = shares(
      {"attacker", "victim"}, [](const std::string& g, int n) { return g == "victim" ? g : "name " + std::to_string(n); }, 16, 100);
  EXPECT_NEAR(got.at("victim"), 50, 1);
}

TEST(Scheduler, InsideAGroupNamesShareAndMoreThanAFewShareOneLine) {
  const auto of = [](int names) {  // of 81 seconds, those of a client with much to do beside `names` others
    SchedulerOptions o = slots(1);
    o.clientLimit = 4096;
    Scheduler s(o);
    std::map<JobId, bool> victims;
    for (int i = 0; i < 81; ++i) victims[s.submit(named("peer", "victim", B), 0).id] = true;
    for (int i = 0; i < 81 * names; ++i) victims[s.submit(named("peer", "name " + std::to_string(i % names), B), 0).id] = false;
    int got = 0;
    for (int r = 0; r < 81; ++r) {
      const auto actions = s.decide(r);
      EXPECT_EQ(actions.size(), 1u);
      got += victims[actions[0].id];
      s.finished(actions[0].id, r + 1, Outcome::Done);
    }
    return got;
  };
  EXPECT_NEAR(of(1), 40, 1);
  EXPECT_NEAR(of(2), 27, 1);
  EXPECT_NEAR(of(40), 9, 1);  // eight names and the rest, not forty-one
}

TEST(Scheduler, ALongJobGivesWayAfterItsSliceToAnotherGroupsShortOne) {
  SchedulerOptions o = slots(1);
  o.slice = {0.25, kNever, kNever};
  Scheduler s(o);
  (void)s.submit(named("long", "", I), 0);
  EXPECT_EQ(show(s.decide(0)), "start1");
  (void)s.submit(named("long", "", I), 0.01);  // one's own job waits
  (void)s.submit(named("short", "", I), 0.05);
  EXPECT_EQ(show(s.decide(0.05)), "");
  ASSERT_TRUE(s.nextEvent(0.05));
  EXPECT_NEAR(*s.nextEvent(0.05), 0.25, 1e-9);  // and the runner looks again then
  EXPECT_EQ(show(s.decide(0.25)), "preempt1");
  EXPECT_TRUE(s.preempted(1, 0.26));
  EXPECT_EQ(show(s.decide(0.26)), "start3");
  s.finished(3, 0.3, Outcome::Done);
  EXPECT_EQ(show(s.decide(0.3)), "start1");  // it goes on before its group's later one
  (void)s.submit(named("short", "", I), 0.31);
  EXPECT_EQ(show(s.decide(0.54)), "");
  EXPECT_EQ(show(s.decide(0.56)), "preempt1");  // no longer slice for having given way: what it did is kept, mostly
  EXPECT_TRUE(s.preempted(1, 0.56));
  EXPECT_EQ(show(s.decide(0.56)), "start4");
  s.finished(4, 0.6, Outcome::Done);
  EXPECT_EQ(show(s.decide(0.6)), "start1");
  EXPECT_EQ(show(s.decide(4.5)), "");  // alone: 4.5 s in all
  (void)s.submit(named("short", "", I), 4.5);
  EXPECT_EQ(show(s.decide(4.6)), "preempt1");
  EXPECT_TRUE(s.preempted(1, 4.6));
  EXPECT_EQ(show(s.decide(4.6)), "start5");
  s.finished(5, 4.7, Outcome::Done);
  EXPECT_EQ(show(s.decide(4.7)), "start1");
  (void)s.submit(named("short", "", I), 4.71);
  EXPECT_EQ(show(s.decide(5.2)), "");  // an eighth of that, so that a step which begins anew ends some time
  EXPECT_EQ(show(s.decide(5.3)), "preempt1");
}

/// Job 1 of group a ran for a second and gave way to job 2 of group b.
Scheduler afterOneHadASecond() {
  SchedulerOptions o = slots(1);
  o.slice = {0.25, kNever, kNever};
  Scheduler s(o);
  (void)s.submit(named("a", "", I), 0);
  (void)s.submit(named("b", "", I), 0);
  EXPECT_EQ(show(s.decide(0)), "start1");
  EXPECT_EQ(show(s.decide(1)), "preempt1");
  EXPECT_TRUE(s.preempted(1, 1));
  EXPECT_EQ(show(s.decide(1)), "start2");
  return s;
}

TEST(Scheduler, NobodyGivesWayToWhoHasHadMore) {
  Scheduler s = afterOneHadASecond();
  EXPECT_EQ(show(s.decide(1.5)), "");          // b has had half of what a had
  EXPECT_EQ(show(s.decide(2.5)), "preempt2");  // now more
}

// The runner sleeps until the next event: there must be one when the running job's group has had more than who waits, not only when its slice ends.
TEST(Scheduler, TheEndOfASliceThatCameTooEarlyIsLookedAtAgain) {
  Scheduler s = afterOneHadASecond();
  double now = 1;
  std::string did;
  for (int looks = 0; looks < 20 && did.empty(); ++looks) {  // by nextEvent() alone
    ASSERT_TRUE(s.nextEvent(now)) << now;
    ASSERT_GT(*s.nextEvent(now), now);
    did = show(s.decide(now = *s.nextEvent(now)));
  }
  EXPECT_EQ(did, "preempt2");
  EXPECT_NEAR(now, 2, 0.02);
}

// Shares hold with slices, and every job ends: two groups, jobs of many slices, each begun anew when it gave way would still end.
TEST(Scheduler, SlicesShareAndEveryJobEnds) {
  SchedulerOptions o = slots(1);
  o.slice = {0.25, 0.25, 0.25};
  Scheduler s(o);
  std::map<JobId, double> left;
  std::map<JobId, std::string> of;
  for (int i = 0; i < 20; ++i) {
    const std::string group = i % 2 ? "odd" : "even";
    const JobId id = s.submit(named(group, "", N), 0).id;
    left[id] = 1 + i % 7;
    of[id] = group;
  }
  double now = 0, odd = 0, even = 0;
  JobId running = 0;
  double begun = 0;
  for (int step = 0; step < 200000 && !left.empty(); ++step, now += 0.05) {
    if (running) (of[running] == "odd" ? odd : even) += 0.05;
    if (running && now - begun >= left[running]) {  // without a checkpoint: only an undisturbed run ends it
      s.finished(running, now, Outcome::Done);
      left.erase(running);
      running = 0;
    }
    if (now > 1 && std::min(odd, even) > 0 && left.size() > 12) { EXPECT_LT(std::abs(odd - even), 12) << now; }
    for (const Action& a : s.decide(now)) {
      if (a.kind == Kind::Start) running = a.id, begun = now;
      if (a.kind == Kind::Preempt) {
        EXPECT_TRUE(s.preempted(a.id, now));
        running = 0;
        for (const Action& b : s.decide(now))
          if (b.kind == Kind::Start) running = b.id, begun = now;
      }
    }
  }
  EXPECT_TRUE(left.empty()) << left.size() << " never end";
}

TEST(Scheduler, OneGroupNeverFillsAQueue) {
  SchedulerOptions o = slots(1);
  o.queueLimit = {8, 8, 8};
  o.clientPart = 0.75;
  Scheduler s(o);
  int taken = 0;
  for (int i = 0; i < 20; ++i) taken += s.submit(named("greedy", "n" + std::to_string(i), I), 0).status.ok();
  EXPECT_EQ(taken, 6);
  const Submit refused = s.submit(named("greedy", "x", I), 0);
  EXPECT_EQ(refused.status.code(), Code::ResourceExhausted);
  EXPECT_NE(refused.status.message().find("scheduler.queued_interactive"), std::string::npos);
  EXPECT_GT(refused.retryMs, 0);
  // The same, asked beforehand: nothing is queued by asking.
  const Submit before = s.refusal(named("greedy", "x", I), 0);
  EXPECT_EQ(before.status.message(), refused.status.message());
  EXPECT_TRUE(s.refusal(named("other", "o", I), 0).status.ok());
  EXPECT_EQ(s.queued(), 6u);
  EXPECT_EQ(s.stats().classes[int(I)].refused, 16u);
  EXPECT_TRUE(s.submit(named("other", "o", I), 0).status.ok());
}

}  // namespace
}  // namespace gobo::scheduler_test
