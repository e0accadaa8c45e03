// SPDX-License-Identifier: Apache-2.0
// JobRunner with fake work that waits for gates, never for time: who runs, who gives way, who is told what.
#include "server/job_runner.h"

#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <stdexcept>

namespace gobo::job_runner_test {
namespace {

/// A door that opens once.
class Gate {
 public:
  void open() {
    std::lock_guard hold(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  void wait() {
    std::unique_lock hold(mutex_);
    changed_.wait(hold, [&] { return open_; });
  }
  /// True when it opened, false when the token said stop first. Polls as real work does.
  bool waitOrStop(const StopToken& stop) {
    std::unique_lock hold(mutex_);
    while (!open_ && !stop.stopRequested()) changed_.wait_for(hold, std::chrono::milliseconds(1));
    return open_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = false;
};

SchedulerOptions slots(int n) {
  SchedulerOptions o;
  o.slots = n;
  return o;
}
JobSpec spec(JobClass c, const char* client = "a") { return {client, c, kNever, 0}; }
constexpr JobClass I = JobClass::Interactive, N = JobClass::Normal, B = JobClass::Batch;

/// run() in a thread of its own, as an RPC is.
struct Call {
  RunReport report;
  std::atomic<JobId> id{0};
  Gate admitted;
  std::thread thread;
  Call(JobRunner& runner, const JobSpec& s, Work work, std::function<bool()> gone = {}) {
    thread = std::thread([this, &runner, s, work = std::move(work), gone = std::move(gone)] {
      RunControl control;
      control.gone = gone;
      control.pollSeconds = 0.001;
      control.admitted = [this](JobId i) {
        id = i;
        admitted.open();
      };
      report = runner.run(s, work, control);
      admitted.open();
    });
  }
  const RunReport& join() {
    if (thread.joinable()) thread.join();
    return report;
  }
  ~Call() { join(); }
};

TEST(JobRunner, RunsAndReturnsWhatTheWorkReturned) {
  JobRunner runner(slots(1));
  const RunReport good = runner.run(spec(N), [](StopToken) { return Status(); });
  EXPECT_TRUE(good.status.ok());
  EXPECT_EQ(good.runs, 1);
  EXPECT_GE(good.queuedSeconds, 0);
  EXPECT_EQ(runner.run(spec(N), [](StopToken) { return notFound("scene"); }).status.code(), Code::NotFound);
  EXPECT_EQ(runner.run(spec(N), [](StopToken) { return Status(Code::Aborted, "by itself"); }).status.code(), Code::Aborted);
  EXPECT_EQ(runner.run(spec(N), [](StopToken) -> Status { throw std::runtime_error("boom"); }).status.code(), Code::Internal);
  EXPECT_EQ(runner.run(spec(N), [](StopToken) -> Status { throw 7; }).status.code(), Code::Internal);
  const auto stats = runner.stats();
  EXPECT_EQ(stats.classes[1].done, 1u);
  EXPECT_EQ(stats.classes[1].failed, 4u);
  EXPECT_EQ(stats.running + stats.queued, 0u);
}

TEST(JobRunner, PreemptedWorkIsCalledAgainAfterTheOther) {
  JobRunner runner(slots(1));
  Gate batchRuns;
  std::vector<std::string> order;  // only the one slot writes
  int calls = 0;
  Call batch(runner, spec(B), [&](StopToken stop) {
    if (++calls == 1) {
      batchRuns.open();
      Gate never;
      EXPECT_FALSE(never.waitOrStop(stop));
      EXPECT_EQ(stop.reason(), StopReason::Preempted);
      order.push_back("gave way");
      return Status(Code::Aborted, "parked");
    }
    EXPECT_FALSE(stop.stopRequested());  // a fresh token
    order.push_back("went on");
    return Status();
  });
  batchRuns.wait();
  EXPECT_TRUE(runner
                  .run(spec(I),
                       [&](StopToken) {
                         order.push_back("interactive");
                         return Status();
                       })
                  .status.ok());
  EXPECT_TRUE(batch.join().status.ok());
  EXPECT_EQ(batch.report.runs, 2);
  EXPECT_EQ(order, (std::vector<std::string>{"gave way", "interactive", "went on"}));
}

TEST(JobRunner, SmallWorkRunsBesideAndGivesWayWhenItIsNotSmall) {
  SchedulerOptions options = slots(1);
  options.beside = 1;
  options.besideSeconds = 0.05;
  JobRunner runner(options);
  Gate bigRuns, bigEnds;
  Call big(runner, spec(N), [&](StopToken) {
    bigRuns.open();
    bigEnds.wait();
    return Status();
  });
  bigRuns.wait();
  JobSpec small = spec(N);
  small.small = true;
  EXPECT_TRUE(runner
                  .run(small,
                       [&](StopToken) {
                         EXPECT_EQ(runner.workers().size(), 1u);
                         EXPECT_TRUE(runner.workers()[0].busy) << "by the big one";
                         EXPECT_EQ(runner.stats().running, 2u);
                         return Status();
                       })
                  .status.ok());
  int calls = 0;
  Gate gaveWay;
  Call liar(runner, small, [&](StopToken stop) {
    if (++calls > 1) return Status();
    Gate never;
    EXPECT_FALSE(never.waitOrStop(stop));
    EXPECT_EQ(stop.reason(), StopReason::Preempted);
    gaveWay.open();
    return Status(Code::Aborted, "parked");
  });
  gaveWay.wait();
  liar.admitted.wait();
  while (!runner.place(liar.id)->queued) std::this_thread::yield();
  EXPECT_EQ(runner.place(liar.id)->ahead, 0u);
  EXPECT_FALSE(runner.place(big.id)->queued);
  bigEnds.open();
  EXPECT_TRUE(liar.join().status.ok());
  EXPECT_EQ(liar.join().runs, 2);
  EXPECT_FALSE(runner.place(liar.id));
}

TEST(JobRunner, WorkThatFinishesAlthoughToldToGiveWayIsDone) {
  JobRunner runner(slots(1));
  Gate batchRuns;
  Call batch(runner, spec(B), [&](StopToken stop) {
    batchRuns.open();
    Gate never;
    (void)never.waitOrStop(stop);
    return Status();
  });
  batchRuns.wait();
  EXPECT_TRUE(runner.run(spec(I), [](StopToken) { return Status(); }).status.ok());
  EXPECT_TRUE(batch.join().status.ok());
  EXPECT_EQ(batch.report.runs, 1);
}

TEST(JobRunner, CancelReachesRunningWorkBeforeItReturns) {
  JobRunner runner(slots(1));
  Gate runs;
  StopToken seen;
  Gate leave;
  Call call(runner, spec(N), [&](StopToken stop) {
    seen = stop;
    runs.open();
    leave.wait();
    return Status(Code::Aborted, "stopped");
  });
  runs.wait();
  call.admitted.wait();
  EXPECT_FALSE(seen.stopRequested());
  EXPECT_TRUE(runner.cancel(call.id));
  EXPECT_EQ(seen.reason(), StopReason::Cancelled);  // no thread had to wake for it
  leave.open();
  EXPECT_EQ(call.join().status.code(), Code::Cancelled);
  EXPECT_FALSE(runner.cancel(call.id));
}

TEST(JobRunner, CancelOfAQueuedJobNeverRunsIt) {
  JobRunner runner(slots(1));
  Gate runs, leave;
  Call first(runner, spec(N), [&](StopToken) {
    runs.open();
    leave.wait();
    return Status();
  });
  runs.wait();
  bool ran = false;
  Call second(runner, spec(N), [&](StopToken) {
    ran = true;
    return Status();
  });
  second.admitted.wait();
  EXPECT_TRUE(runner.cancel(second.id));
  EXPECT_EQ(second.join().status.code(), Code::Cancelled);  // while the first still holds the slot
  EXPECT_EQ(second.report.runs, 0);
  leave.open();
  EXPECT_TRUE(first.join().status.ok());
  EXPECT_FALSE(ran);
}

TEST(JobRunner, CallerThatLeavesCancelsItsJob) {
  JobRunner runner(slots(1));
  std::atomic<bool> left{false};
  Gate runs;
  Call call(
      runner, spec(N),
      [&](StopToken stop) {
        runs.open();
        Gate never;
        (void)never.waitOrStop(stop);
        return Status(stop.reason() == StopReason::Cancelled ? Code::Cancelled : Code::Internal, "left");
      },
      [&] { return left.load(); });
  runs.wait();
  left = true;
  EXPECT_EQ(call.join().status.code(), Code::Cancelled);
}

TEST(JobRunner, CancelBetweenPreemptionAndRestartIsFinal) {
  JobRunner runner(slots(1));
  Gate batchRuns, hotRuns, hotLeaves;
  std::atomic<int> calls{0};
  Call batch(runner, spec(B), [&](StopToken stop) {
    ++calls;
    batchRuns.open();
    Gate never;
    (void)never.waitOrStop(stop);
    return Status(Code::Aborted, "parked");
  });
  batchRuns.wait();
  Call hot(runner, spec(I), [&](StopToken) {
    hotRuns.open();
    hotLeaves.wait();
    return Status();
  });
  hotRuns.wait();  // so batch has been parked
  batch.admitted.wait();
  EXPECT_TRUE(runner.cancel(batch.id));
  EXPECT_EQ(batch.join().status.code(), Code::Cancelled);
  hotLeaves.open();
  EXPECT_TRUE(hot.join().status.ok());
  EXPECT_EQ(calls, 1);
}

TEST(JobRunner, DeadlinesOfQueuedAndRunningJobsComeByThemselves) {
  JobRunner runner(slots(1));
  JobSpec running = spec(I), queued = spec(N);  // the class and not the earlier deadline says who is first
  running.deadline = JobRunner::now() + 1;
  Call first(runner, running, [&](StopToken stop) {
    Gate never;
    (void)never.waitOrStop(stop);  // only the timer can end this
    return Status(Code::Aborted, "stopped");
  });
  first.admitted.wait();
  queued.deadline = JobRunner::now() + 0.02;
  bool ran = false;
  Call second(runner, queued, [&](StopToken) {
    ran = true;
    return Status();
  });
  EXPECT_EQ(second.join().status.code(), Code::DeadlineExceeded);
  EXPECT_EQ(first.join().status.code(), Code::DeadlineExceeded);
  EXPECT_FALSE(ran);
}

TEST(JobRunner, RefusalsCarryTheSchedulersReason) {
  SchedulerOptions o = slots(1);
  o.queueLimit = {1, 1, 1};
  o.pinnedLimit = 10;
  JobRunner runner(o);
  Gate runs, leave;
  Call first(runner, spec(N), [&](StopToken) {
    runs.open();
    leave.wait();
    return Status();
  });
  runs.wait();
  Call second(runner, spec(N), [&](StopToken) { return Status(); });
  second.admitted.wait();
  const RunReport full = runner.run(spec(N), [](StopToken) { return Status(); });
  EXPECT_EQ(full.status.code(), Code::ResourceExhausted);
  EXPECT_GT(full.retryMs, 0);
  JobSpec large = spec(N);
  large.pinnedBytes = 11;
  EXPECT_EQ(runner.run(large, [](StopToken) { return Status(); }).status.code(), Code::FailedPrecondition);
  leave.open();
  EXPECT_TRUE(second.join().status.ok());
}

TEST(JobRunner, DrainRefusesNewWaitsAndThenCancels) {
  JobRunner runner(slots(1));
  Gate runs;
  Call stubborn(runner, spec(N), [&](StopToken stop) {
    runs.open();
    Gate never;
    (void)never.waitOrStop(stop);
    return Status(Code::Aborted, "stopped");
  });
  runs.wait();
  Call waiting(runner, spec(N), [](StopToken) { return Status(); });
  waiting.admitted.wait();
  runner.drain(0.05);
  EXPECT_EQ(stubborn.join().status.code(), Code::Cancelled);
  EXPECT_EQ(waiting.join().status.code(), Code::Cancelled);
  EXPECT_EQ(runner.run(spec(N), [](StopToken) { return Status(); }).status.code(), Code::Unavailable);
}

TEST(JobRunner, DrainLetsRunningWorkEnd) {
  JobRunner runner(slots(2));
  Gate runs, leave;
  Call call(runner, spec(N), [&](StopToken) {
    runs.open();
    leave.wait();
    return Status();
  });
  runs.wait();
  std::thread drainer([&] { runner.drain(60); });
  while (runner.run(spec(N), [](StopToken) { return Status(); }).status.code() != Code::Unavailable) std::this_thread::yield();
  leave.open();
  drainer.join();
  EXPECT_TRUE(call.join().status.ok());
}

TEST(JobRunner, ManyCallersNeverExceedSlotsAndEachJobEndsOnce) {
  SchedulerOptions o = slots(3);
  o.pinnedLimit = 100;
  o.protectedSeconds = 0.005;
  o.ageing = {kNever, 0.02, 0.05};
  JobRunner runner(o);
  std::atomic<int> inside{0}, worst{0}, ended{0}, wrong{0};
  std::atomic<int> bytesInside{0}, worstBytes{0};
  const auto most = [](std::atomic<int>& m, int v) {
    int old = m;
    while (old < v && !m.compare_exchange_weak(old, v)) {}
  };
  std::vector<std::thread> callers;
  for (int t = 0; t < 12; ++t)
    callers.emplace_back([&, t] {
      uint64_t state = uint64_t(t) * 7919 + 1;
      for (int n = 0; n < 40; ++n) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        JobSpec s;
        s.client = std::string(1, char('a' + t % 3));
        s.jobClass = JobClass((state >> 33) % 3);
        s.pinnedBytes = (state >> 40) % 60;
        int left = 50 + int((state >> 50) % 200);  // "blocks": kept across preemptions
        std::atomic<bool> here{false};
        const bool leave = (state >> 20) % 7 == 0;
        RunControl control;
        if (leave) control.admitted = [&](JobId id) { runner.cancel(id); };
        const RunReport r = runner.run(
            s,
            [&](StopToken stop) {
              if (here.exchange(true)) ++wrong;  // the same job twice at once
              most(worst, ++inside);
              most(worstBytes, bytesInside += int(s.pinnedBytes));
              Status status;
              for (; left > 0; --left) {
                if (stop.stopRequested()) {
                  status = Status(Code::Aborted, "stopped");
                  break;
                }
                std::this_thread::yield();
              }
              bytesInside -= int(s.pinnedBytes);
              --inside;
              here = false;
              return status;
            },
            control);
        ++ended;
        const bool complete = left == 0;
        if (r.status.ok() != complete) ++wrong;
        if (!r.status.ok() && r.status.code() != Code::Cancelled) ++wrong;
        if (!r.status.ok() && !leave) ++wrong;
      }
    });
  for (auto& c : callers) c.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(ended, 12 * 40);
  EXPECT_LE(worst, 3);
  EXPECT_LE(worstBytes, 100);
  const auto stats = runner.stats();
  uint64_t sum = 0;
  for (const auto& c : stats.classes) sum += c.done + c.failed + c.expired + c.cancelled;
  EXPECT_EQ(sum, 480u);
  EXPECT_EQ(stats.running + stats.queued, 0u);
}

}  // namespace
}  // namespace gobo::job_runner_test
