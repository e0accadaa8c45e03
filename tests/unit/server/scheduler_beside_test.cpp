// SPDX-License-Identifier: Apache-2.0
// Scheduler, rule 10 (small jobs beside others) and place().
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "server/scheduler.h"

namespace gobo::scheduler_beside_test {
namespace {

constexpr JobClass I = JobClass::Interactive, N = JobClass::Normal, B = JobClass::Batch;

JobSpec job(JobClass c, bool small, const char* client = "a", double expected = 0, uint64_t bytes = 0) {
  JobSpec s;
  s.client = client;
  s.jobClass = c;
  s.small = small;
  s.expected = expected;
  s.pinnedBytes = bytes;
  return s;
}
SchedulerOptions beside(int slots = 1, int more = 1) {
  SchedulerOptions o;
  o.slots = slots;
  o.beside = more;
  return o;
}
std::string show(const std::vector<Action>& actions) {
  std::string text;
  for (const Action& a : actions) {
    const char* kinds[] = {"start", "preempt", "stop", "expire"};
    text += (text.empty() ? "" : " ") + std::string(a.beside ? "beside" : kinds[int(a.kind)]) + std::to_string(a.id);
  }
  return text;
}

TEST(SchedulerBeside, ASmallJobRunsBesideAnyThatIsNotOfAHigherClassAndPreemptsNobody) {
  for (const JobClass running : {I, N, B})
    for (const JobClass asked : {I, N, B}) {
      Scheduler s(beside());
      (void)s.submit(job(running, false), 0);
      EXPECT_EQ(show(s.decide(0)), "start1");
      (void)s.submit(job(asked, true), 1);
      EXPECT_EQ(show(s.decide(1)), running < asked ? "" : "beside2") << int(running) << " " << int(asked);
    }
}

TEST(SchedulerBeside, AFreeSlotIsTakenFirstAndPlacesBesideAreBounded) {
  Scheduler s(beside(1, 2));
  for (int i = 0; i < 4; ++i) (void)s.submit(job(N, true), 0);
  EXPECT_EQ(show(s.decide(0)), "start1 beside2 beside3");
  EXPECT_EQ(s.running(), 3u);
  s.finished(2, 0.1, Outcome::Done);
  EXPECT_EQ(show(s.decide(0.1)), "beside4");
  (void)s.submit(job(N, false), 0.2);
  s.finished(3, 0.2, Outcome::Done);
  EXPECT_EQ(show(s.decide(0.2)), "") << "what ran beside leaves no slot to who is not small";
}

TEST(SchedulerBeside, WhoIsFirstInLineGoesFirst) {
  Scheduler s(beside());
  (void)s.submit(job(B, false), 0);
  EXPECT_EQ(show(s.decide(0)), "start1");
  (void)s.submit(job(B, true, "b"), 1), (void)s.submit(job(N, true, "c"), 1), (void)s.submit(job(I, true, "d"), 1);
  EXPECT_EQ(show(s.decide(1)), "beside4 preempt1") << "the interactive one beside; the normal one finds no place beside and preempts, as ever";
}

TEST(SchedulerBeside, BytesBoundItToo) {
  SchedulerOptions o = beside();
  o.pinnedLimit = 100;
  Scheduler s(o);
  (void)s.submit(job(N, false, "a", 0, 60), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, true, "b", 0, 50), 0), (void)s.submit(job(N, true, "c", 0, 40), 0);
  EXPECT_EQ(show(s.decide(0)), "beside3");
  EXPECT_EQ(s.stats().pinnedBytes, 100u);
}

TEST(SchedulerBeside, WhoTakesLongGivesWayAndWaitsLikeAnyOther) {
  SchedulerOptions o = beside();
  o.besideSeconds = 2;
  Scheduler s(o);
  (void)s.submit(job(N, false), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, true), 1);
  EXPECT_EQ(show(s.decide(1)), "beside2");
  EXPECT_EQ(s.nextEvent(1), 3.0);
  EXPECT_EQ(show(s.decide(2.9)), "");
  EXPECT_EQ(show(s.decide(3)), "preempt2");
  EXPECT_EQ(show(s.decide(3)), "");
  EXPECT_TRUE(s.preempted(2, 3.1));
  EXPECT_EQ(show(s.decide(3.1)), "") << "once more beside it would never end";
  s.finished(1, 4, Outcome::Done);
  EXPECT_EQ(show(s.decide(4)), "start2");
}

TEST(SchedulerBeside, AgeingMeansAndHintsKnowNothingOfIt) {
  SchedulerOptions o = beside();
  o.ageing = {kNever, 10, kNever};
  Scheduler s(o);
  (void)s.submit(job(I, false, "viewer"), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, false, "big"), 0);
  JobId id = 2;
  for (int second = 1; second < 10; ++second) {  // small interactive ones come and go
    (void)s.submit(job(I, true, "viewer"), second);
    EXPECT_EQ(show(s.decide(second)), "beside" + std::to_string(++id));
    s.finished(id, second + 0.01, Outcome::Done);
  }
  EXPECT_EQ(s.stats().classes[0].meanRunSeconds, 0) << "of those in slots alone";
  EXPECT_EQ(s.stats().classes[0].done, 9u);
  EXPECT_EQ(show(s.decide(10)), "") << "due, but it waits: an interactive one is not preempted";
  s.finished(1, 10.5, Outcome::Done);
  (void)s.submit(job(I, false, "viewer"), 10.5);
  EXPECT_EQ(show(s.decide(10.5)), "start2") << "the class that waited has its turn before the next interactive one";
}

TEST(SchedulerBeside, SmallJobsOfAClassAreNoTurnOfIt) {
  SchedulerOptions o = beside();
  o.ageing = {kNever, 10, kNever};
  Scheduler s(o);
  (void)s.submit(job(N, false, "big"), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, true, "small"), 0);
  EXPECT_EQ(show(s.decide(0)), "beside2");
  (void)s.submit(job(I, false, "viewer"), 0.1);
  EXPECT_EQ(show(s.decide(0.1)), "preempt1");
  EXPECT_TRUE(s.preempted(1, 0.1));
  EXPECT_EQ(show(s.decide(0.1)), "start3");
  s.finished(2, 5, Outcome::Done);  // a job of the class ends, but not one in a slot
  (void)s.submit(job(I, false, "viewer"), 5);
  s.finished(3, 10.2, Outcome::Done);
  EXPECT_EQ(show(s.decide(10.2)), "start1");
}

TEST(SchedulerBeside, ItsSecondsAreItsClients) {
  Scheduler s(beside());
  (void)s.submit(job(N, false, "a"), 0), (void)s.submit(job(N, true, "b"), 0);
  EXPECT_EQ(show(s.decide(0)), "start1 beside2");
  EXPECT_EQ(show(s.decide(0.5)), "");
  EXPECT_DOUBLE_EQ(s.stats().clientSeconds["b"], 0.5);
}

TEST(SchedulerBeside, NothingIsLeftBehindInAnyOrder) {
  std::mt19937 random(5);
  Scheduler s(beside(2, 2));
  std::vector<JobId> running;
  double now = 0;
  for (int step = 0; step < 2000; ++step) {
    now += 0.01 * double(random() % 10);
    const auto pick = [&] { return running.begin() + long(random() % running.size()); };
    switch (random() % 5) {
      case 0:
      case 1: (void)s.submit(job(JobClass(random() % 3), random() % 2 == 0, random() % 2 ? "a" : "b"), now); break;
      case 2:
        if (!running.empty()) {
          const auto at = pick();
          s.finished(*at, now, Outcome::Done);
          running.erase(at);
        }
        break;
      case 3:
        if (!running.empty()) (void)s.cancel(*pick(), now);
        break;
      default: break;
    }
    std::vector<JobId> gave;
    for (const Action& a : s.decide(now)) {
      if (a.kind == Action::Kind::Start) running.push_back(a.id);
      if (a.kind == Action::Kind::Preempt) gave.push_back(a.id);
    }
    for (const JobId id : gave) {
      running.erase(std::find(running.begin(), running.end(), id));
      (void)s.preempted(id, now);
    }
    ASSERT_LE(s.running(), 4u);
    ASSERT_EQ(s.running(), running.size());
  }
  while (s.queued() + s.running() > 0) {
    now += 1;
    for (const Action& a : s.decide(now))
      if (a.kind == Action::Kind::Start) running.push_back(a.id);
    ASSERT_FALSE(running.empty());
    for (const JobId id : running) s.finished(id, now, Outcome::Done);
    running.clear();
  }
  // All slots of both kinds are free again.
  for (int i = 0; i < 5; ++i) (void)s.submit(job(N, true), now);
  EXPECT_EQ(s.decide(now).size(), 4u);
}

TEST(SchedulerPlace, CountsWhoGoesFirstInTheOrderInWhichTheyAreAsked) {
  Scheduler s(beside(1, 0));
  (void)s.submit(job(N, false, "a"), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, false, "a"), 0);  // 2
  (void)s.submit(job(N, false, "a"), 0);  // 3
  (void)s.submit(job(N, false, "b"), 0);  // 4: another caller, who has had less
  (void)s.submit(job(I, false, "c"), 0);  // 5: another class
  EXPECT_FALSE(s.place(1, 0)->queued);
  EXPECT_EQ(s.place(4, 0.5)->ahead, 0u);
  EXPECT_EQ(s.place(2, 0.5)->ahead, 1u);
  EXPECT_EQ(s.place(3, 0.5)->ahead, 2u);
  EXPECT_EQ(s.place(5, 0.5)->ahead, 0u);
  EXPECT_TRUE(s.place(3, 0.5)->queued);
  EXPECT_FALSE(s.place(99, 0.5));
}

TEST(SchedulerPlace, StartsComeInTheOrderOfPlaces) {
  std::mt19937 random(11);
  for (int round = 0; round < 50; ++round) {
    Scheduler s(beside(1, 0));
    (void)s.submit(job(N, false, "z"), 0);
    (void)s.decide(0);
    std::vector<JobId> queued;
    for (int i = 0; i < 6; ++i) queued.push_back(s.submit(job(N, false, random() % 2 ? "a" : "b"), 0).id);
    s.finished(1, 1, Outcome::Done);  // the mean run is one second from here on, and so is each run below
    std::map<size_t, JobId> order;
    for (const JobId id : queued) order[s.place(id, 1)->ahead] = id;
    ASSERT_EQ(order.size(), queued.size()) << "each has a place of its own";
    double now = 1;
    for (const auto& [place, id] : order) {
      ASSERT_EQ(show(s.decide(now)), "start" + std::to_string(id)) << "round " << round << " place " << place;
      s.finished(id, now += 1, Outcome::Done);
    }
  }
}

TEST(SchedulerPlace, ExpectsWhatJobsSaidOfThemselves) {
  Scheduler s(beside(2, 0));
  (void)s.submit(job(N, false, "a", 10), 0), (void)s.submit(job(N, false, "a", 4), 0);
  (void)s.decide(0);
  (void)s.submit(job(N, false, "a", 6), 0), (void)s.submit(job(N, false, "a", 2), 0);
  EXPECT_DOUBLE_EQ(s.place(1, 1)->expected, 9);  // has run a second
  EXPECT_DOUBLE_EQ(s.place(3, 1)->expected, (9 + 3) / 2.0 + 6);
  EXPECT_DOUBLE_EQ(s.place(4, 1)->expected, (9 + 3 + 6) / 2.0 + 2);
  EXPECT_DOUBLE_EQ(s.place(4, 6)->expected, (4 + 0 + 6) / 2.0 + 2) << "who takes longer than he said has no rest, not a negative one";
  (void)s.submit(job(N, false, "a"), 6);
  EXPECT_EQ(s.place(5, 6)->expected, 0) << "nothing is known of itself";
  (void)s.submit(job(N, false, "a", 3), 6);
  EXPECT_EQ(s.place(6, 6)->expected, 0) << "nor of one before it";
  (void)s.submit(job(I, false, "a", 3), 6);
  EXPECT_DOUBLE_EQ(s.place(7, 6)->expected, 3) << "lower classes give way";
}

}  // namespace
}  // namespace gobo::scheduler_beside_test
