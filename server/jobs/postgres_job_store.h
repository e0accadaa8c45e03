// SPDX-License-Identifier: Apache-2.0
// PostgresJobStore: JobStore in the schema "gobo" of a PostgreSQL database (13 and later, UTF-8), for several daemons on several machines.
//   isolation   READ COMMITTED under a lock on the job's row (FOR UPDATE; FOR SHARE for what changes one frame that is the caller's own), so
//               changes of one job come one after the other and claims side by side. Each statement after the lock sees all that was
//               committed before it. Reads of several statements are REPEATABLE READ.
//   claims      FOR UPDATE SKIP LOCKED on the frame: nobody waits for a frame that another one is taking
//   tokens      of a sequence, which is never set back: not by a rollback, and a crash skips some
//   revisions   of the transaction that changes. What a reader names is the oldest one that had not ended for it: all older ones have ended and
//               are seen, so no change that is committed late is skipped; one that was seen already may be told again
//   clock       the server's, for leases, waits, ages and deadlines: clocks of workers do not matter
//   lost        a connection that is lost before COMMIT was sent is made anew and the operation runs again, once; later: Unavailable
//   conflicts   serialization failures and deadlocks run again, at most 20 times, then Unavailable
// Cost: a commit (about 1 ms with a disk under it) and 4 to 10 round trips a change.
#pragma once

#include <set>

#include "server/jobs/postgres.h"
#include "server/jobs/sql_job_store.h"

namespace gobo {
inline namespace jobs {

class PostgresJobStore final : public SqlJobStore {
 public:
  static constexpr int kVersion = 2;
  static constexpr const char* kChannel = "gobo_jobs";  ///< NOTIFY: "work", "steered"

  /// Makes the schema where there is none (options.create). Errors: Unavailable when the server cannot be reached; DataLoss when there is no
  /// store and none is to be made; FailedPrecondition for a schema of a newer Gobo or a foreign one, PermissionDenied; all name the database.
  static Result<std::unique_ptr<PostgresJobStore>> open(const std::string& uri, const JobStoreOptions& options = {});
  /// What open() would say; changes nothing.
  static Status check(const std::string& uri);
  /// Counts of jobs against their frames; "ok" or the first job that differs.
  Result<std::string> integrity() override;
  Result<std::string> edition() override;
  using SqlJobStore::check;

 private:
  PostgresJobStore(const std::string& uri, const JobStoreOptions& options) : SqlJobStore(options), db_(uri, options.busySeconds) {}
  Status migrate();
  Status run(const char* begin, bool reads, const std::function<Status()>& work);
  SqlConnection& db() override { return db_; }
  Status transact(const std::function<Status()>& change) override;
  Status look(const std::function<Status()>& read) override;
  double now() const override { return options_.now ? options_.now() : time_; }
  double uptime() const override { return options_.uptime ? options_.uptime() : now(); }
  double shareClock() const override;
  Status lockJob(int64_t id, Hold hold) override;
  Result<uint64_t> revision() override;
  Result<uint64_t> nextRevision() override;
  Result<uint64_t> nextToken() override;
  Result<int64_t> nextJob() override;
  Result<int64_t> lastJob() override;
  Status skipJobs(int64_t last) override;
  Status addTasks(int64_t job, const std::vector<int64_t>& frames, uint32_t parts, uint64_t revision) override;
  Status firstReady(const std::string& client, std::optional<Lease>& lease) override;
  std::string listed(const char* number, int k) const override;
  Status tell(News news) override;
  Result<int64_t> number(const char* sql);

  Postgres db_;
  double time_ = 0;           ///< the server's clock at the begin of the transaction
  std::set<int64_t> passed_;  ///< jobs whose ready frames others are taking while this claim looks
};

}  // namespace jobs
}  // namespace gobo
