// SPDX-License-Identifier: Apache-2.0
// SqlJobStore: what every operation of a JobStore does, once, in SQL that SQLite and PostgreSQL both understand. A derived store says how
// its database differs: transactions, locks, clocks, where ids, tokens and revisions come from, and how the next frame of a client is found.
// One connection under a mutex. Each operation is one transaction, so a kill at any moment leaves the state before or after it.
// Isolation: an operation that changes a job begins with lockJob, and reads afterwards; of one job, whole locks exclude each other and
// shared ones. Several jobs are locked by ascending id, so no two operations wait for each other.
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "server/jobs/job_shares.h"
#include "server/jobs/job_store.h"
#include "server/jobs/sql.h"

namespace gobo {
inline namespace jobs {

struct JobStoreOptions {
  std::function<double()> now;        ///< seconds since 1970; the system clock (PostgreSQL: the database's) if empty
  std::function<double()> uptime;     ///< seconds since the machine started, the same in all processes; if empty: `now` where that is given, else the system's
  std::string boot;                   ///< names the start of the machine that `uptime` counts from; the system's if empty. SQLite only
  bool create = true;                 ///< a store that is missing or empty is made
  double busySeconds = 5;             ///< wait for what other processes hold
  double retrySeconds = 1;            ///< wait before the second attempt; doubles, at most a minute
  uint32_t maxLosses = 25;            ///< leases lost in a row without a checkpoint: a frame that kills its worker each time
  uint64_t maxActiveTasks = 1000000;  ///< of jobs that are not over; more: ResourceExhausted
  uint32_t logEntries = 10000;        ///< of a job's log that are kept, and some more until they are pruned
  std::function<Status(const char* sql)> step;  ///< see Sqlite::step, Postgres::step
};

/// 32 random hex digits.
std::string newStoreIdentity();

class SqlJobStore : public JobStore {
 public:
  Result<int64_t> submit(const NewJob& job, bool& existed) override;
  Result<int64_t> findKey(const std::string& client, const std::string& key, const std::string& digest) override;
  Result<JobRecord> get(int64_t id, bool withFrames) override;
  Result<std::vector<v1::Job>> list(const JobFilter& filter) override;
  Result<JobRecord> changes(int64_t id, uint64_t revision) override;
  Status cancel(int64_t id) override;
  Status pause(int64_t id) override;
  Status resume(int64_t id) override;
  Status retry(int64_t id) override;
  Status prioritize(int64_t id, v1::JobSpec::Priority priority) override;
  Status depend(int64_t id, const std::vector<int64_t>& after) override;
  Status remove(int64_t id) override;
  Result<std::vector<v1::JobLogEntry>> log(int64_t id, const JobLogFilter& filter) override;

  Result<std::optional<Lease>> claim(const std::string& holder, double leaseSeconds) override;
  Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) override;
  Result<v1::Job::State> check(const Lease& lease) override;
  Result<std::vector<CheckpointRow>> checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) override;
  Result<std::vector<CheckpointRow>> checkpoints(TaskId task) override;
  Result<std::vector<v1::FrameFile>> parts(TaskId frame) override;
  Status complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) override;
  Status fail(const Lease& lease, const FailedReport& report) override;
  Status release(const Lease& lease) override;

  Result<uint64_t> expireLeases() override;
  Result<uint64_t> endAllLeases() override;
  Status blame(TaskId task, const Status& reason, bool certain) override;
  Result<std::vector<int64_t>> expireResults(uint64_t keepBytes, double keepSeconds) override;
  Result<std::vector<std::string>> neededCheckpoints() override;
  Result<std::vector<std::string>> neededResults(int64_t id) override;
  Result<std::vector<int64_t>> jobIds() override;
  Result<OwnedJobs> owned() override;
  Result<std::vector<std::string>> neededScenes() override;
  Result<JobTotals> totals() override;
  /// The random name that the store got when it was made; empty in one that an earlier version made, until it is given one.
  Result<std::string> identity();
  Status identify(const std::string& id);
  /// Jobs up to `last` have files in the folder: those of them that the store never made (it is an older copy) are not its own, and new
  /// jobs get ids above.
  Status disown(int64_t last);
  /// "ok", or what is damaged.
  virtual Result<std::string> integrity() = 0;

 protected:
  struct TaskRow {
    v1::Frame::State state;
    uint64_t token;
    uint32_t failures;
    v1::Job::State job;
    uint32_t maxAttempts;
    int64_t frame;
    TaskPlace place;
    uint32_t parts;  ///< of each frame of the job
  };
  enum class Hold { Shared, Whole };  ///< shared: with others that each change one frame which is theirs
  enum class News { Work, Steered };

  explicit SqlJobStore(const JobStoreOptions& options) : options_(options) {}
  virtual SqlConnection& db() = 0;
  /// Runs `change` in a transaction; rolled back unless it returns Ok. It may run several times: it sets all that it leaves behind anew.
  virtual Status transact(const std::function<Status()>& change) = 0;
  /// Runs `read` on one state of the store, and more than once perhaps.
  virtual Status look(const std::function<Status()>& read) = 0;
  virtual double now() const = 0;     ///< seconds since 1970; in a transaction: of its begin, perhaps
  virtual double uptime() const = 0;  ///< the store's own clock
  virtual double shareClock() const = 0;
  virtual Status lockJob(int64_t, Hold) { return {}; }
  virtual Result<uint64_t> revision() = 0;      ///< changes with a greater one, and perhaps some with it, are not seen by this state
  virtual Result<uint64_t> nextRevision() = 0;  ///< of this transaction's changes
  virtual Result<uint64_t> nextToken() = 0;     ///< greater than all before
  virtual Result<int64_t> nextJob() = 0;        ///< 0: the table gives one. Excludes other submissions
  virtual Result<int64_t> lastJob() = 0;        ///< the greatest id that was given
  virtual Status skipJobs(int64_t last) = 0;
  virtual Status addTasks(int64_t job, const std::vector<int64_t>& frames, uint32_t parts, uint64_t revision) = 0;
  /// The first ready frame of the client by priority, deadline, id, frame: task, frame, progress; locked until the transaction ends.
  virtual Status firstReady(const std::string& client, std::optional<Lease>& lease) = 0;
  /// The condition that a whole number is one of those in value ?`k`, a text with commas between them.
  virtual std::string listed(const char* number, int k) const = 0;
  virtual bool looksBeforeClaim() const { return false; }
  virtual Result<double> endedAt() { return uptime(); }  ///< in a transaction: the own clock, for the age of results
  virtual Status mindClock() { return {}; }
  virtual Status tell(News) { return {}; }  ///< in a transaction: other processes hear of it when it is committed

  JobStoreOptions options_;
  std::mutex mutex_;
  JobShares shares_;  ///< of this process

 private:
  Result<TaskRow> task(TaskId id);
  Result<TaskRow> held(const Lease& lease);                  ///< FailedPrecondition when the lease is over
  Status endLease(TaskId id, bool lost, uint64_t revision);  ///< back to the queue, or failed after too many losses
  Status setFailure(TaskId id, const Status& reason, uint64_t revision);
  // Of frames in parts (sql_frame_parts.cpp).
  Status partDone(TaskId frame, uint32_t parts, double seconds, uint64_t revision);
  Status dropParts(TaskId frame, uint64_t revision);                       ///< their files are needed no more
  Status partsAgain(TaskId frame, const TaskRow& row, uint64_t revision);  ///< their files are damaged or gone
  Status endParts(TaskId frame, uint64_t revision);                        ///< what of them waits or runs is cancelled
  Status recountParts(const JobRecord& record, uint64_t revision);         ///< of frames that wait
  Status readParts(const JobRecord& record, const std::vector<int64_t>& indices, uint64_t after, v1::Job& job);
  Status settle(int64_t job, uint64_t revision);  ///< job done or failed when no frame is left
  Status idle(int64_t job, uint64_t revision);    ///< a running job none of whose frames runs is a queued one again
  Status endJob(int64_t job, v1::Job::State state, const Status& reason, uint64_t revision);
  Status ended(int64_t job, v1::Job::State state);  ///< what follows from the end of a job
  // sql_job_depend.cpp
  Status addNeeds(int64_t job, const std::vector<int64_t>& needs, const char* field);
  Result<std::vector<int64_t>> needsOf(int64_t job);
  Status checkCircle(int64_t job);
  Status checkNobodyWaits(int64_t job);
  Status letDependentsGo(int64_t job);
  Status readNeeds(int64_t first, int64_t last, std::vector<v1::Job>& jobs);  ///< waits_for of jobs whose ids are in first..last
  // sql_job_log.cpp
  Status noteJob(int64_t job, v1::JobLogEntry::Kind kind);
  /// Its holder is whose the task is in this moment: call it before that is cleared.
  Status noteTask(TaskId id, v1::JobLogEntry::Kind kind, const Status& reason = {}, double seconds = 0);
  Status noted(SqlQuery& insert, int64_t job);
  Result<JobRecord> readJob(int64_t id);
  Status readFrames(const JobRecord& record, uint64_t after, v1::Job& job);
  Status roomFor(uint64_t frames);
  Result<uint64_t> endLeases(double before, double deadlines, bool remoteToo);
  Result<std::vector<int64_t>> jobsWithEnds(double before, double deadlines);
  Status chooseResults(uint64_t keepBytes, double keepSeconds, std::vector<int64_t>& gone);
  Result<std::vector<std::string>> texts(const char* sql, int64_t id = 0);
};

}  // namespace jobs
}  // namespace gobo
