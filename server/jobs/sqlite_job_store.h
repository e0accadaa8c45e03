// SPDX-License-Identifier: Apache-2.0
// SqliteJobStore: JobStore in one SQLite file (WAL, synchronous=FULL; schema: docs/job_store.md). A transaction is BEGIN IMMEDIATE to COMMIT;
// other processes are waited for (busySeconds). Cost: one synced commit a change (about 1 ms on an SSD).
#pragma once

#include "server/jobs/sql_job_store.h"
#include "server/jobs/sqlite.h"

namespace gobo {
inline namespace jobs {

class SqliteJobStore final : public SqlJobStore {
 public:
  /// Errors: DataLoss when the file is damaged (it is never made anew: it holds promises), or empty and not to be made; FailedPrecondition for a schema of a
  /// newer Gobo, Internal, Unavailable; all name the file.
  static Result<std::unique_ptr<SqliteJobStore>> open(const std::string& path, const JobStoreOptions& options = {});
  /// PRAGMA integrity_check; "ok" or what it says.
  Result<std::string> integrity() override;
  Result<std::string> edition() override;

 private:
  explicit SqliteJobStore(const JobStoreOptions& options) : SqlJobStore(options) {}
  Status migrate();
  Status startClock();
  Result<uint64_t> bump(const char* counter);
  Status keepClock();  ///< in a transaction: after a restart of the machine the clock goes on from here
  SqlConnection& db() override { return db_; }
  Status transact(const std::function<Status()>& change) override;
  Status look(const std::function<Status()>& read) override;
  double now() const override { return options_.now(); }
  double uptime() const override { return clockBase_ + options_.uptime(); }
  double shareClock() const override { return uptime(); }
  Result<uint64_t> revision() override;
  Result<uint64_t> nextRevision() override { return bump("revision"); }
  Result<uint64_t> nextToken() override { return bump("token"); }
  Result<int64_t> nextJob() override { return int64_t(0); }
  Result<int64_t> lastJob() override;
  Status skipJobs(int64_t last) override;
  Status addTasks(int64_t job, const std::vector<int64_t>& frames, uint32_t parts, uint64_t revision) override;
  Status firstReady(const std::string& client, std::optional<Lease>& lease) override;
  std::string listed(const char* number, int k) const override;
  bool looksBeforeClaim() const override { return true; }  ///< an idle worker asks often: without a write transaction
  Result<double> endedAt() override;
  Status mindClock() override;

  Sqlite db_;
  std::string path_;
  double clockBase_ = 0, clockKept_ = 0;
};

}  // namespace jobs
}  // namespace gobo
