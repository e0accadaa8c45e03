// SPDX-License-Identifier: Apache-2.0
// SqliteJobStore: JobStore in one SQLite file (WAL, synchronous=FULL; schema: docs/job_store.md). Each operation is one
// transaction, BEGIN IMMEDIATE to COMMIT, so a kill at any moment leaves the state before or after it. One connection under a
// mutex; other processes are waited for (busySeconds). Cost: one synced commit a change (about 1 ms on an SSD).
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "server/jobs/job_shares.h"
#include "server/jobs/job_store.h"
#include "server/jobs/sqlite.h"

namespace gobo {

struct JobStoreOptions {
  std::function<double()> now;     ///< seconds since 1970; the system clock if empty
  std::function<double()> uptime;  ///< seconds since the machine started, the same in all processes; if empty: `now` where that is given, else the system's
  std::string boot;                ///< names the start of the machine that `uptime` counts from; the system's if empty
  bool create = true;              ///< a file that is missing or empty becomes a new store
  double busySeconds = 5;
  double retrySeconds = 1;                      ///< wait before the second attempt; doubles, at most a minute
  uint32_t maxLosses = 25;                      ///< leases lost in a row without a checkpoint: a frame that kills its worker each time
  uint64_t maxActiveTasks = 1000000;            ///< of jobs that are not over; more: ResourceExhausted
  std::function<Status(const char* sql)> step;  ///< see Sqlite::step
};

/// 32 random hex digits.
std::string newStoreIdentity();

class SqliteJobStore final : public JobStore {
 public:
  /// Errors: DataLoss when the file is damaged (it is never made anew: it holds promises), or empty and not to be made; FailedPrecondition for a schema of a
  /// newer Gobo, Internal, Unavailable; all name the file.
  static Result<std::unique_ptr<SqliteJobStore>> open(const std::string& path, const JobStoreOptions& options = {});

  Result<int64_t> submit(const NewJob& job, bool& existed) override;
  Result<int64_t> findKey(const std::string& client, const std::string& key, const std::string& digest) override;
  Result<JobRecord> get(int64_t id, bool withFrames) override;
  Result<std::vector<v1::Job>> list(const JobFilter& filter) override;
  Result<JobRecord> changes(int64_t id, uint64_t revision) override;
  Status cancel(int64_t id) override;
  Status pause(int64_t id) override;
  Status resume(int64_t id) override;
  Status remove(int64_t id) override;

  Result<std::optional<Lease>> claim(const std::string& holder, double leaseSeconds) override;
  Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) override;
  Result<v1::Job::State> check(const Lease& lease) override;
  Result<std::vector<CheckpointRow>> checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) override;
  Result<std::vector<CheckpointRow>> checkpoints(TaskId task) override;
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
  /// PRAGMA integrity_check; "ok" or what it says.
  Result<std::string> integrity();

 private:
  struct TaskRow {
    v1::Frame::State state;
    uint64_t token;
    uint32_t failures;
    v1::Job::State job;
    uint32_t maxAttempts;
    int64_t frame;
  };
  SqliteJobStore() = default;
  Status migrate();
  Status startClock();
  /// Runs `change` in a transaction; rolled back unless it returns Ok.
  Status transact(const std::function<Status()>& change);
  Result<uint64_t> bump(const char* counter);  ///< in a transaction: the next revision or token
  Result<TaskRow> task(TaskId id);
  Result<TaskRow> held(const Lease& lease);                  ///< FailedPrecondition when the lease is over
  Status endLease(TaskId id, bool lost, uint64_t revision);  ///< back to the queue, or failed after too many losses
  Status setFailure(TaskId id, const Status& reason, uint64_t revision);
  Status settle(int64_t job, uint64_t revision);  ///< job done or failed when no frame is left
  Status idle(int64_t job, uint64_t revision);    ///< a running job none of whose frames runs is a queued one again
  Status endJob(int64_t job, v1::Job::State state, const Status& reason, uint64_t revision);
  Result<JobRecord> readJob(int64_t id);
  Status readFrames(int64_t id, uint64_t after, v1::Job& job);
  Result<uint64_t> endLeases(double before);
  Result<std::vector<std::string>> texts(const char* sql, int64_t id = 0);
  double now() const { return options_.now(); }
  double uptime() const { return clockBase_ + options_.uptime(); }  ///< the store's own clock
  Status keepClock();                                               ///< in a transaction: after a restart of the machine the clock goes on from here

  std::mutex mutex_;
  JobShares shares_;  ///< of this process
  Sqlite db_;
  std::string path_;
  JobStoreOptions options_;
  double clockBase_ = 0, clockKept_ = 0;
};

}  // namespace gobo
