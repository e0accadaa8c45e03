// SPDX-License-Identifier: Apache-2.0
// Scheduler: which job runs next, as a pure object: no threads, clock or I/O. The caller (server/job_runner.h) tells it what
// happened and when, and carries out the actions of decide(). Same calls, same answers. Not thread-safe.
//
// Rules
//  1. Class: interactive before normal before batch.
//  2. Client: inside a class the group with the least virtual time goes first (consumed run seconds; running jobs count with at
//     least the class's mean run time), inside a group the client by the same rule. A group is who the caller is (token, peer), a
//     client a name that the caller chose: so names divide their group's share and take nothing of the others'. One that comes back
//     from idle starts at the present virtual time: no credit saved. A group has kNames names at once; more share one line.
//  3. Job: inside class and client the earliest deadline first, then the order of submission (a preempted job keeps its place).
//  4. Deadline: a queued job at or past it gets Expire and is gone; it never starts. A running one gets Stop(Deadline).
//  5. Preemption: a job that cannot start for want of slots or bytes preempts running jobs of lower classes: the lowest
//     class, the latest started first, no more than it needs, and only if that is enough.
//  6. Ageing: a class whose jobs waited for ageing[class] seconds, none of it running, is due: its first job goes before all
//     classes, holds what comes free, and is not preempted for `protectedSeconds`. The clock starts anew when the class has
//     finished a job or run for protectedSeconds (a turn). Bound: with R the longest time until enough slots and bytes come
//     free of jobs it may not preempt, a class with waiting jobs completes a turn at least every
//     ageing + 2 R + 3 protectedSeconds: the wait, short preempted runs meanwhile (below one protectedSeconds in all), the
//     other ageing class's turn when that was due first (R and one), its own (R and one).
//  7. Bytes: the pinned bytes of running jobs stay within the limit. A job larger than the limit is refused for good. One that
//     does not fit now lets others pass for reserveAfter seconds; from then on it is first in its class and holds whatever
//     comes free, so it starts within reserveAfter + ageing[class] + R + the turns that rule 6 gives others.
//  8. Queues are bounded per class and per client; beyond, ResourceExhausted with a retry hint: the measured interval between
//     starts of the class, times the refused callers before this one since the last start (so that they do not all come back
//     at once), times the active clients where the client's own bound was met.
//  9. Slices: where the first waiting job of a class cannot start, a running one of the same class gives way to it if it is another
//     group's that has had more, and it has run for its slice: slice[class] seconds, or an eighth of what it ran before if that is
//     more, so that what has to begin its step anew comes to its end. So a short job waits for one slice of each longer one, not for its end.
//  10. Beside: a small job (its caller's word, from its plan) that would have to wait for a slot starts in one of `beside` slots beside them,
//     unless a higher class runs. It counts in no rule on slots, means, hints and ageing; its seconds are its client's all the same.
//     One that takes longer than besideSeconds gives way and waits like any other: it was not small.
// Cost: decide() is O(queued log queued) when something may start, O(running) else.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"

namespace gobo {
inline namespace server {

enum class JobClass { Interactive = 0, Normal = 1, Batch = 2 };
constexpr int kJobClasses = 3;
constexpr const char* kClassNames[kJobClasses] = {"interactive", "normal", "batch"};
constexpr double kNever = std::numeric_limits<double>::infinity();
using JobId = uint64_t;  ///< from 1, in order of submission

struct JobSpec {
  std::string client;
  JobClass jobClass = JobClass::Normal;
  double deadline = kNever;  ///< on the clock of `now`, seconds
  uint64_t pinnedBytes = 0;  ///< held while it runs
  std::string group = {};    ///< empty: the client is a group of its own
  double expected = 0;       ///< seconds in a slot, for those who ask place(); 0: nobody knows
  bool small = false;        ///< rule 10
};

struct SchedulerOptions {
  int slots = 1;  ///< jobs at once
  uint64_t pinnedLimit = std::numeric_limits<uint64_t>::max();
  std::array<size_t, kJobClasses> queueLimit{64, 256, 4096};      ///< queued jobs of a class
  size_t clientLimit = 256;                                       ///< queued jobs of a group, all classes
  double clientPart = 1;                                          ///< of a class's queue that one group may fill
  std::array<double, kJobClasses> ageing{kNever, 10, 30};         ///< seconds
  std::array<double, kJobClasses> slice{kNever, kNever, kNever};  ///< seconds
  double protectedSeconds = 1;
  int beside = 0;  ///< slots of rule 10
  double besideSeconds = 1;
  double reserveAfter = 5;
  double retryMinMs = 10, retryMaxMs = 60000;
};

struct Submit {
  Status status;  ///< Ok, ResourceExhausted (retryMs > 0), FailedPrecondition (never fits), DeadlineExceeded (already past)
  JobId id = 0;
  double retryMs = 0;
};

struct Action {
  enum class Kind { Start, Preempt, Stop, Expire } kind;
  JobId id;
  StopReason reason = StopReason::None;  ///< Preempt: Preempted. Stop: Cancelled or Deadline. Expire: Deadline.
  bool beside = false;                   ///< Start: in a slot of rule 10
};

/// Where a job that was submitted is.
struct Place {
  bool queued = false;
  size_t ahead = 0;     ///< queued jobs of its class that are asked to go first
  double expected = 0;  ///< seconds until it is over, by what jobs said of themselves; 0: nothing is known
};

enum class Outcome { Done, Failed };
enum class CancelResult { Unknown, Removed, Stopping };  ///< Stopping: the next decide() holds the Stop

struct SchedulerStats {
  struct Class {
    size_t queued = 0, running = 0;
    uint64_t submitted = 0, started = 0, done = 0, failed = 0, expired = 0, cancelled = 0, preempted = 0, refused = 0;
    double runSeconds = 0;      ///< consumed, preempted runs included
    double meanRunSeconds = 0;  ///< of a job, moving mean; 0 before the first
    double startInterval = 0;   ///< seconds between starts while jobs waited, moving mean; 0 before the first
  };
  std::array<Class, kJobClasses> classes;
  size_t queued = 0, running = 0;
  uint64_t pinnedBytes = 0;
  std::map<std::string, uint64_t> pinnedOfGroups;
  std::map<std::string, double> clientSeconds;  ///< consumed by groups that are known now
};

class Scheduler {
 public:
  explicit Scheduler(const SchedulerOptions& options);

  // `now`: seconds, on any clock that does not run backwards (an earlier value is taken as the latest one).
  Submit submit(const JobSpec& spec, double now);
  /// What submit() would refuse now, counted as refused; Ok and no id: nothing. So that nobody plans what has no place in the queue.
  Submit refusal(const JobSpec& spec, double now);
  /// What to do now. Each action is given once; a Start or Expire changes the state at once, a Preempt or Stop is done when
  /// finished() or preempted() is called.
  std::vector<Action> decide(double now);
  /// A running job is over. Unknown or not running: a CHECK fails.
  void finished(JobId id, double now, Outcome outcome);
  /// A running job gave way. True: queued again. False: it is gone, as it was cancelled or is past its deadline meanwhile.
  bool preempted(JobId id, double now);
  CancelResult cancel(JobId id, double now);
  /// Nothing for a job that is over, or never was.
  std::optional<Place> place(JobId id, double now);
  /// The next time at which decide() may have something to say without any other event.
  std::optional<double> nextEvent(double now) const;
  SchedulerStats stats() const;
  static constexpr size_t kNames = 8;
  size_t queued() const { return queued_; }
  size_t running() const { return running_; }

 private:
  enum class State { Queued, Running, Preempting, Stopping };  // the last two still hold their slot and bytes
  struct Job {
    JobSpec spec;
    std::string group, client;  // keys of the books
    State state = State::Queued;
    bool stopPending = false;  // cancelled while running, Stop not given out yet
    bool cancelled = false;
    double started = 0;  // of this run
    double chargedUntil = 0;
    double ran = 0;  // seconds of all its runs
    double protectedUntil = -kNever;
    double blockedSince = kNever;  // first time that bytes kept it from starting
    double ranBefore = 0;          // rule 9: seconds of the runs before this one
    bool beside = false;           // rule 10: runs there
  };
  struct Client {
    double virtualTime = 0, seconds = 0;
    size_t queued = 0, running = 0;
  };
  struct Group : Client {
    std::map<std::string, Client> clients;
    double clock = 0;  // virtual time of its clients
  };
  struct ClassState {
    std::map<std::string, Group> groups;
    double virtualTime = 0;
    double waited = 0, served = 0, charged = 0;             // rule 6: seconds; `charged`: until when they are counted
    size_t queued = 0, running = 0, beside = 0, small = 0;  // beside: of the running ones; small: of the queued ones
    double lastStart = -kNever, waitingSince = 0;           // rule 8
    uint64_t refusedSinceStart = 0;
    SchedulerStats::Class stats;
  };
  struct Room {
    int64_t freeSlots, comingSlots;
    uint64_t freeBytes, comingBytes;
    int64_t beside;
  };
  using Jobs = std::map<JobId, Job>;
  class Line;  // the order in which the queued jobs of a class are asked

  double advance(double now);
  void expire(double now, std::vector<Action>& actions);
  std::vector<int> classOrder() const;
  bool due(int c) const;
  double meanRun(int c) const;
  bool tryStart(JobId id, Job& job, double now, bool first, Room& room, std::vector<Action>& actions);
  double sliceEnd(const Job& job) const;
  double givesWayAt(const Job& job) const;  ///< when decide() has to look at rule 9 again
  bool sliceFor(const Job& job, double now, Room& room, std::vector<Action>& actions);
  bool preemptFor(const Job& job, double now, Room& room, std::vector<Action>& actions);
  void start(JobId id, Job& job, double now, bool beside);
  bool mayGoBeside(const Job& job, const Room& room) const;
  void leave(Jobs::iterator at);                  // out of queue or slots, and out of the books
  void count(Job& job, int queued, int running);  // into the books of its client, group and class
  static void activate(ClassState& state, Group& group, Client& client);
  static void settle(ClassState& state);  // forgets clients and groups without debt
  double retryMs(int c, bool clientBound, double now);

  SchedulerOptions options_;
  Jobs jobs_;
  std::array<ClassState, kJobClasses> classes_;
  std::map<std::string, size_t> queuedOf_;
  size_t queued_ = 0, running_ = 0, beside_ = 0;  // beside_: of the running ones
  uint64_t pinned_ = 0;
  JobId next_ = 1;
  double now_ = -kNever;
};

}  // namespace server
}  // namespace gobo
