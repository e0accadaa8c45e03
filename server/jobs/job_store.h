// SPDX-License-Identifier: Apache-2.0
// JobStore: what is promised to clients, and who works on it. A job is a request and frames; a task is one frame, or a part of one
// (frame_parts.h): a frame that has parts is not ready until they are done, and fails when one of them does. A worker claims
// a task and gets a LEASE: holder, expiry, and a token. Tokens only grow, over all tasks and for ever. Every report carries its
// token; a report whose token is not the task's present one is refused (FailedPrecondition naming both), so a worker that was
// taken for dead cannot disturb the one that took over. A lease is over when the store says so (expireLeases, cancel, release,
// complete, fail), not when its time has passed: until then its holder may still report.
// Every change is durable when the call returns Ok. Unavailable, ResourceExhausted, Internal mean "not written, or not known":
// repeat the call; all reports may be repeated with the same token.
// Job states: queued -> running (a frame was claimed) -> done | failed; cancelled and paused from either. A frame that fails is
// tried again until max_attempts failures; the others go on, then the job is failed. docs/job_store.md has the schema.
// Times that clients read, and deadlines, are seconds since 1970. Leases, waits and the age of results are measured on the store's own
// clock, which counts the seconds that the machine is up and no jump of the wall clock moves. Thread-safe; several processes may open one
// store.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/jobs/task_store.h"

namespace gobo {
inline namespace jobs {

/// What is submitted: checked and resolved by the caller (server/jobs/job_spec.h).
struct NewJob {
  v1::JobSpec spec;  ///< resolved
  std::string client;
  std::string digest;                             ///< of the spec as it was sent: the same key must come with the same one
  std::string sceneHash, sceneSource, sceneFile;  ///< sceneFile: name under FOLDER/scenes of an upload, or empty
  std::string environmentDigest;                  ///< sha256 of the environment's file, or empty
  std::vector<int64_t> frames;
  uint32_t parts = 0;          ///< of each frame; 0: not split
  std::vector<int64_t> after;  ///< jobs that must be done first; each once
};

struct JobFilter {
  std::vector<v1::Job::State> states;
  std::string client;
  int64_t before = 0;  ///< ids below this one; 0: any
  uint32_t limit = 50;
  uint64_t bytes = UINT64_MAX;  ///< ends with the job that passes this sum
};

/// Which entries of a job's log.
struct JobLogFilter {
  std::vector<int64_t> frames;  ///< numbers; all, and what is of the job itself, if empty
  uint64_t after = 0;           ///< greater sequences only
  uint32_t most = 1000;         ///< the newest of them
  uint64_t bytes = UINT64_MAX;  ///< fewer, when messages are long; at least one
};

/// The job ids that a store has given: what else lies in the folder is not its to remove.
struct OwnedJobs {
  int64_t last = 0;
  std::vector<std::pair<int64_t, int64_t>> except;  ///< first and last of ranges that it found taken (JobStore::disown)
  bool has(int64_t id) const;
};

struct JobTotals {
  uint64_t queued = 0, running = 0, paused = 0, done = 0, failed = 0, cancelled = 0;  ///< jobs
  uint64_t activeTasks = 0;                                                           ///< frames of jobs that are not over
  uint64_t resultBytes = 0;
};

class JobStore : public TaskStore {
 public:
  /// The new job, or the one that has the same client and key (then `existed`). Errors: AlreadyExists naming it when that one was
  /// made from another spec.
  virtual Result<int64_t> submit(const NewJob& job, bool& existed) = 0;
  /// The job with this key, 0 if there is none. Errors: AlreadyExists as above.
  virtual Result<int64_t> findKey(const std::string& client, const std::string& key, const std::string& digest) = 0;
  virtual Result<std::vector<v1::Job>> list(const JobFilter& filter) = 0;  ///< newest first, without frames
  /// Frames that changed after `revision`, with the job (no frames, no spec in it) and the new revision.
  virtual Result<JobRecord> changes(int64_t id, uint64_t revision) = 0;
  /// Of the store's content: where it is what it was, nothing that changes() or get() say has changed meanwhile, whoever else may write.
  virtual Result<std::string> edition() = 0;
  virtual Status cancel(int64_t id) = 0;  ///< no change when it is over
  virtual Status pause(int64_t id) = 0;   ///< no change when it is over
  virtual Status resume(int64_t id) = 0;
  /// Frames that failed or were cancelled wait again, as if new. No change where there are none. Errors: FailedPrecondition when the deadline has passed
  /// or results are gone (expireResults); ResourceExhausted as submit.
  virtual Status retry(int64_t id) = 0;
  virtual Status prioritize(int64_t id, v1::JobSpec::Priority priority) = 0;
  /// What a job waits for, in place of what it waited for; of one that is over, nothing is all that it may be told. Those that are done are not waited for.
  /// Errors: NotFound at "after[K]"; InvalidArgument for a circle, naming the shortest way round; FailedPrecondition for one that is over and `after`.
  virtual Status depend(int64_t id, const std::vector<int64_t>& after) = 0;
  /// FailedPrecondition unless it is over, and while others wait for it, naming them.
  virtual Status remove(int64_t id) = 0;
  /// Oldest first. Each change writes its entry in its own transaction; JobStoreOptions::logEntries of a job are kept. Of changes that are made at the same
  /// moment one may be seen before another that has a smaller sequence.
  virtual Result<std::vector<v1::JobLogEntry>> log(int64_t id, const JobLogFilter& filter) = 0;

  /// Ends leases whose time has passed, and fails jobs past their deadline. The number of both.
  virtual Result<uint64_t> expireLeases() = 0;
  /// Ends all leases but those of workers elsewhere (kRemoteHolder): the caller knows that no other holder lives.
  virtual Result<uint64_t> endAllLeases() = 0;
  /// The daemon crashed while it worked on this frame. `certain`: on nothing else; then the frame is set aside (failed) with the reason. Else
  /// it counts as if a third of the losses that are borne had happened. No change when the frame is over.
  virtual Status blame(TaskId task, const Status& reason, bool certain) = 0;
  /// Marks the results of jobs that are over as gone: of those that ended more than `keepSeconds` ago (seconds
  /// in which the machine was up), and the earliest ended
  /// ones while results have more than `keepBytes`. Their ids.
  virtual Result<std::vector<int64_t>> expireResults(uint64_t keepBytes, double keepSeconds) = 0;
  virtual Result<std::vector<std::string>> neededCheckpoints() = 0;        ///< "JOB-INDEX-DIGEST"
  virtual Result<std::vector<std::string>> neededResults(int64_t id) = 0;  ///< sha256 of a job's files
  virtual Result<std::vector<int64_t>> jobIds() = 0;
  virtual Result<OwnedJobs> owned() = 0;
  virtual Result<std::vector<std::string>> neededScenes() = 0;  ///< sceneFile and environmentDigest of jobs that are not over
  virtual Result<JobTotals> totals() = 0;
};

/// "j-7"; 0 for what is not an id.
std::string jobIdText(int64_t id);
int64_t jobIdOf(const std::string& text);
bool jobIsOver(v1::Job::State state);

}  // namespace jobs
}  // namespace gobo
