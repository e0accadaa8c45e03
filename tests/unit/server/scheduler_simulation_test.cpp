// SPDX-License-Identifier: Apache-2.0
// Long random runs of the Scheduler against a small model of a server (jobs that need so many seconds, give way after some
// milliseconds, fail, are cancelled), with every invariant checked after every event.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "server/scheduler.h"

namespace gobo::scheduler_simulation_test {
namespace {

struct Random {
  uint64_t state;
  uint64_t next() {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state >> 11;
  }
  double unit() { return double(next()) * 0x1p-53; }
  int below(int n) { return int(next() % uint64_t(n)); }
};

struct Truth {
  JobSpec spec;
  double need = 0;  // seconds of run left
  bool running = false, over = false, stopping = false;
  double since = 0, gives = kNever;  // gives: when it leaves the slot after Preempt or Stop
  double submitted = 0;
  bool preempting = false;
};

class Server {
 public:
  Server(const SchedulerOptions& o, uint64_t seed) : options(o), scheduler(o), random{seed} {}

  JobId submit(const JobSpec& spec, double need) {
    const Submit s = scheduler.submit(spec, now);
    if (!s.status.ok()) {
      ++refused;
      EXPECT_EQ(s.id, 0u);
      EXPECT_EQ(s.status.code() == Code::ResourceExhausted, s.retryMs > 0);
      return 0;
    }
    EXPECT_EQ(truths.count(s.id), 0u);
    Truth t;
    t.spec = spec, t.need = need, t.submitted = now;
    truths[s.id] = t;
    ++alive;
    return s.id;
  }

  void decide() {
    for (const Action& a : scheduler.decide(now)) {
      log.push_back(a);
      auto at = truths.find(a.id);
      ASSERT_NE(at, truths.end());
      Truth& t = at->second;
      ASSERT_FALSE(t.over) << "action for a job that is over";
      switch (a.kind) {
        case Action::Kind::Start:
          ASSERT_FALSE(t.running) << "started twice";
          ASSERT_LT(now, t.spec.deadline) << "started late";
          t.running = true, t.since = now, t.gives = kNever, t.preempting = false;
          break;
        case Action::Kind::Preempt: {
          ASSERT_TRUE(t.running && !t.stopping);
          bool reason = false;  // somebody of a higher class waits
          for (const auto& [id, other] : truths) reason |= !other.over && !other.running && other.spec.jobClass < t.spec.jobClass;
          ASSERT_TRUE(reason);
          t.preempting = true, t.gives = now + 0.001 + 0.009 * random.unit();
          break;
        }
        case Action::Kind::Stop:
          ASSERT_TRUE(t.running);
          t.stopping = true, t.gives = std::min(t.gives, now + 0.001 + 0.009 * random.unit());
          break;
        case Action::Kind::Expire:
          ASSERT_FALSE(t.running);
          ASSERT_GE(now, t.spec.deadline);
          end(t);
      }
    }
    uint64_t bytes = 0;
    int running = 0;
    size_t queued = 0;
    for (const auto& [id, t] : truths) {
      if (t.over) continue;
      running += t.running;
      queued += !t.running;
      if (t.running) bytes += t.spec.pinnedBytes;
      ASSERT_FALSE(!t.running && t.spec.deadline <= now) << "an expired job is still queued";
    }
    ASSERT_LE(running, options.slots);
    ASSERT_LE(bytes, options.pinnedLimit);
    ASSERT_EQ(scheduler.running(), size_t(running));
    ASSERT_EQ(scheduler.queued(), queued);  // none lost
    ASSERT_EQ(scheduler.stats().pinnedBytes, bytes);
  }

  /// The next event up to `until`: a job that ends or gives way, or the scheduler's own.
  void step(double until) {
    double next = until;
    JobId who = 0;
    for (const auto& [id, t] : truths) {
      if (t.over || !t.running) continue;
      const double end = std::min(t.since + t.need, t.gives);
      if (end < next) next = end, who = id;
    }
    if (const auto own = scheduler.nextEvent(now); own && *own < next) next = *own, who = 0;
    now = std::max(now, next);
    if (who) {
      Truth& t = truths[who];
      const double ran = now - t.since;
      consumed[t.spec.client] += ran;
      classRun[size_t(t.spec.jobClass)] += ran;
      t.need -= ran;
      t.running = false;
      if (t.need <= 1e-12) {
        scheduler.finished(who, now, Outcome::Done);
        ++done;
        ++classDone[size_t(t.spec.jobClass)];
        end(t);
      } else if (t.stopping) {
        if (random.below(2)) scheduler.finished(who, now, Outcome::Failed);
        else if (scheduler.preempted(who, now)) ADD_FAILURE() << "a stopped job was queued again";
        end(t);
      } else if (!scheduler.preempted(who, now)) {
        EXPECT_GE(now, t.spec.deadline);
        end(t);
      }
    }
    decide();
  }

  void cancelSomebody() {
    std::vector<JobId> candidates;
    for (const auto& [id, t] : truths)
      if (!t.over && !t.stopping) candidates.push_back(id);
    if (candidates.empty()) return;
    const JobId id = candidates[size_t(random.below(int(candidates.size())))];
    const CancelResult r = scheduler.cancel(id, now);
    EXPECT_EQ(r, truths[id].running ? CancelResult::Stopping : CancelResult::Removed);
    if (r == CancelResult::Removed) end(truths[id]);
    decide();
    EXPECT_TRUE(!truths[id].running || truths[id].stopping) << "the stop must come with the next decision";
  }

  void end(Truth& t) {
    t.over = true;
    --alive;
  }

  SchedulerOptions options;
  Scheduler scheduler;
  Random random;
  std::map<JobId, Truth> truths;
  std::map<std::string, double> consumed;
  std::array<double, kJobClasses> classRun{};
  std::array<int, kJobClasses> classDone{};
  std::vector<Action> log;
  double now = 0;
  int alive = 0, refused = 0, done = 0;
};

std::vector<Action> randomRun(uint64_t seed) {
  SchedulerOptions o;
  Random pick{seed * 2654435761u + 1};
  o.slots = 1 + pick.below(4);
  o.pinnedLimit = 1000;
  o.queueLimit = {20, 20, 20};
  o.clientLimit = 15;
  o.ageing = {kNever, 3, 8};
  o.protectedSeconds = 0.5;
  o.reserveAfter = 2;
  Server server(o, seed + 1);
  Random& r = server.random;
  int submitted = 0;
  double arrival = 0;
  while (submitted < 400) {
    while (server.now < arrival && !::testing::Test::HasFatalFailure()) server.step(arrival);
    JobSpec spec;
    spec.client = std::string(1, char('a' + r.below(5)));
    spec.jobClass = JobClass(r.below(3));
    if (r.below(4) == 0) spec.deadline = server.now + 5 * r.unit();
    spec.pinnedBytes = uint64_t(r.below(8) == 0 ? r.below(1100) : r.below(300));
    const bool fits = spec.pinnedBytes <= o.pinnedLimit;
    const JobId id = server.submit(spec, 0.01 + r.unit() * r.unit() * 3);
    EXPECT_TRUE(fits || id == 0);
    server.decide();
    ++submitted;
    if (r.below(10) == 0) server.cancelSomebody();
    arrival = server.now + (r.below(3) ? 0.4 * r.unit() : 0);
    if (::testing::Test::HasFatalFailure()) return {};
  }
  const double drained = server.now + 3000;
  while (server.alive > 0 && server.now < drained && !::testing::Test::HasFatalFailure()) server.step(drained);
  EXPECT_EQ(server.alive, 0) << "jobs that never ran, seed " << seed;
  EXPECT_EQ(server.scheduler.queued() + server.scheduler.running(), 0u);
  uint64_t sum = 0;
  const SchedulerStats stats = server.scheduler.stats();
  for (const auto& c : stats.classes) sum += c.done + c.failed + c.expired + c.cancelled;
  EXPECT_EQ(sum, server.truths.size());  // each job ended exactly once
  EXPECT_GT(server.done, 50);
  return server.log;
}

TEST(SchedulerSimulation, InvariantsHoldOverRandomRuns) {
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    randomRun(seed);
    ASSERT_FALSE(::testing::Test::HasFailure()) << "seed " << seed;
  }
}

TEST(SchedulerSimulation, SameCallsSameAnswers) {
  const auto a = randomRun(77), b = randomRun(77);
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(a[i].kind == b[i].kind && a[i].id == b[i].id && a[i].reason == b[i].reason);
}

TEST(SchedulerSimulation, EqualClientsGetEqualSharesWhateverTheSizeOfTheirJobs) {
  for (const int slots : {1, 2, 3}) {
    SchedulerOptions o;
    o.slots = slots;
    Server server(o, 9);
    const double sizes[] = {0.05, 0.3, 1, 4};
    const double end = 2000;
    while (server.now < end && !::testing::Test::HasFatalFailure()) {
      for (int c = 0; c < 4; ++c) {  // everybody always has a few jobs waiting
        int mine = 0;
        const std::string name(1, char('a' + c));
        for (const auto& [id, t] : server.truths) mine += !t.over && t.spec.client == name;
        for (; mine < 4; ++mine) server.submit({name, JobClass::Normal, kNever, 0}, sizes[c] * (0.5 + server.random.unit()));
      }
      server.step(end);
      std::erase_if(server.truths, [](const auto& t) { return t.second.over; });
    }
    const double fair = end * slots / 4;
    for (const auto& [name, seconds] : server.consumed) EXPECT_NEAR(seconds / fair, 1, 0.2) << name << " with " << slots << " slots";
  }
}

TEST(SchedulerSimulation, LateComersGetTheirShareAndNoMore) {
  SchedulerOptions o;
  Server server(o, 5);
  std::map<std::string, double> before;
  for (double end : {500.0, 1000.0}) {
    while (server.now < end && !::testing::Test::HasFatalFailure()) {
      for (const char* name : {"early", "late"}) {
        if (std::string(name) == "late" && end < 600) continue;
        int mine = 0;
        for (const auto& [id, t] : server.truths) mine += !t.over && t.spec.client == name;
        for (; mine < 3; ++mine) server.submit({name, JobClass::Normal, kNever, 0}, 0.2 + server.random.unit());
      }
      server.step(end);
      std::erase_if(server.truths, [](const auto& t) { return t.second.over; });
    }
    if (end < 600) before = server.consumed;
  }
  EXPECT_NEAR(server.consumed["late"] / 250, 1, 0.2);
  EXPECT_NEAR((server.consumed["early"] - before["early"]) / 250, 1, 0.2);
}

TEST(SchedulerSimulation, BatchAndNormalMakeTheProgressThatIsPromised) {
  // Interactive and normal jobs without end, with bytes in the way too. Every window of the stated bound holds a turn of each.
  SchedulerOptions o;
  o.slots = 2;
  o.pinnedLimit = 100;
  o.ageing = {kNever, 5, 15};
  o.reserveAfter = 2;
  Server server(o, 3);
  const double longest = 2;  // seconds of one job: R, the time until room comes free, is at most this
  std::array<double, kJobClasses> last{}, gap{};
  std::array<double, kJobClasses> ranAt{};
  const double end = 1500;
  while (server.now < end && !::testing::Test::HasFatalFailure()) {
    for (int c = 0; c < 3; ++c) {
      int mine = 0;
      for (const auto& [id, t] : server.truths) mine += !t.over && int(t.spec.jobClass) == c;
      for (; mine < 3; ++mine)
        server.submit({std::string(1, char('a' + server.random.below(3))), JobClass(c), kNever, uint64_t(c == 2 ? 90 : 20 + server.random.below(40))},
                      0.5 + (longest - 0.5) * server.random.unit());
    }
    server.step(end);
    for (size_t c = 0; c < 3; ++c) {
      // A turn: a finished job, or protectedSeconds of run since the last turn.
      double ran = server.classRun[c];
      for (const auto& [id, t] : server.truths) ran += t.running && size_t(t.spec.jobClass) == c ? server.now - t.since : 0;
      if (server.classDone[c] > 0 || ran - ranAt[c] >= o.protectedSeconds - 1e-9) {
        gap[c] = std::max(gap[c], server.now - last[c]);
        last[c] = server.now;
        ranAt[c] = ran;
        server.classDone[c] = 0;
      }
    }
    std::erase_if(server.truths, [](const auto& t) { return t.second.over; });
  }
  for (size_t c = 1; c < 3; ++c) {
    EXPECT_GT(last[c], 0.9 * end);
    EXPECT_LE(gap[c], o.ageing[c] + 2 * longest + 3 * o.protectedSeconds + 0.1) << "class " << c;
    EXPECT_GT(gap[c], 0.5 * o.ageing[c]) << "the load is too light to test anything, class " << c;
  }
  EXPECT_GT(server.classRun[0], 0.25 * end * o.slots);  // and interactive keeps the bulk
}

}  // namespace
}  // namespace gobo::scheduler_simulation_test
