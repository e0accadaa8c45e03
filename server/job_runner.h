// SPDX-License-Identifier: Apache-2.0
// JobRunner: threads around the Scheduler. A caller hands in work and waits; slot threads execute it. Preempted work (it returned
// Aborted after its token said Preempted) is queued again and called again; it is to go on where it stopped.
// Thread-safe. Work must poll its token (at least every 10 ms) and may not call run() itself.
#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "server/scheduler.h"

namespace gobo {
inline namespace server {

/// Called once per run. An exception that leaves it becomes Internal.
using Work = std::function<Status(StopToken)>;

struct RunControl {
  std::function<bool()> gone;  ///< "has the caller left?" (ServerContext::IsCancelled); asked every pollSeconds
  double pollSeconds = 0.01;
  std::function<void(JobId)> admitted;  ///< called once, with the id that cancel() takes; the job may run already
};

struct RunReport {
  Status status;             ///< of the work, or why it did not run: Cancelled, DeadlineExceeded, ResourceExhausted, Unavailable
  double retryMs = 0;        ///< with ResourceExhausted
  double queuedSeconds = 0;  ///< in the queue, all waits
  double ranSeconds = 0;     ///< in a slot, all runs
  int runs = 0;              ///< calls of the work
};

/// What one slot does.
struct WorkerState {
  bool busy = false;
  JobId job = 0;
  std::string client;
  JobClass jobClass = JobClass::Normal;
  double seconds = 0;  ///< in this state
};

class JobRunner {
 public:
  explicit JobRunner(const SchedulerOptions& options);
  ~JobRunner();  ///< drain(0); every run() must have returned, or be about to, before its memory goes
  /// Blocks until the job is over. spec.deadline is on the clock of now().
  RunReport run(const JobSpec& spec, Work work, const RunControl& control = {});
  Submit refusal(const JobSpec& spec) {  ///< Scheduler::refusal, now
    const std::lock_guard hold(mutex_);
    return scheduler_.refusal(spec, now());
  }
  /// From any thread. The job's token says Cancelled before this returns. False: no such job (any more).
  bool cancel(JobId id);
  /// Refuses new jobs (Unavailable), waits up to `seconds` for the others, cancels what is left and waits for that.
  void drain(double seconds);
  SchedulerStats stats() const;
  /// Of stats() the number that waits, without making the rest of it.
  size_t queued() const {
    const std::lock_guard hold(mutex_);
    return scheduler_.queued();
  }
  /// Where a job is; nothing once it is over.
  std::optional<Place> place(JobId id);
  /// One per slot; those beside (rule 10) are not among them.
  std::vector<WorkerState> workers() const;
  static double now();  ///< seconds, steady clock

 private:
  struct Job {
    Work work;
    JobSpec spec;
    StopSource stop;  // a new one for every run: a late stop of the last run must not reach the next
    RunReport report;
    double since = 0;  // entered its present state
    bool over = false;
    std::condition_variable done;
  };
  void slotLoop(size_t slot);  // from options.slots on: beside
  void timerLoop();
  void pump();  // under mutex_: asks the scheduler and carries out
  void finish(Job& job, Status status);

  mutable std::mutex mutex_;
  std::condition_variable ready_, readyBeside_, timer_, empty_;
  Scheduler scheduler_;
  std::map<JobId, std::shared_ptr<Job>> jobs_;    // not over
  std::vector<JobId> starting_, startingBeside_;  // told to start, not taken by a thread yet
  bool draining_ = false, closing_ = false;
  std::vector<WorkerState> workers_;  // seconds: when the state began
  std::vector<std::thread> threads_;
};

}  // namespace server
}  // namespace gobo
