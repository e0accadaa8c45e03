// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/postgres_job_store.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <random>
#include <thread>

#include "server/jobs/postgres_schema.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr int kConflicts = 20;  // attempts
constexpr const char* kBeginChange = "BEGIN ISOLATION LEVEL READ COMMITTED READ WRITE; SELECT seconds()";
constexpr const char* kBeginLook = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY; SELECT seconds()";

/// Whatever is in the database before a store is opened; 0 without one.
Result<int> postgresStoreVersion(Postgres& db) {
  GOBO_ASSIGN(const std::string tables, db.exec("SELECT count(*) FROM pg_tables WHERE schemaname = 'gobo'"));
  if (tables == "0") return 0;
  GOBO_ASSIGN(const std::string ours, db.exec("SELECT count(*) FROM pg_tables WHERE schemaname = 'gobo' AND tablename IN ('job', 'task', 'counter', 'store')"));
  if (ours != "4") return Status(Code::FailedPrecondition, "has a schema gobo that is no job store", db.name());
  GOBO_ASSIGN(const std::string allowed, db.exec("SELECT bool_and(has_table_privilege(quote_ident(schemaname) || '.' || quote_ident(tablename), r))"
                                                 " FROM pg_tables, unnest(ARRAY['SELECT', 'INSERT', 'UPDATE', 'DELETE']) r WHERE schemaname = 'gobo'"));
  if (allowed != "t") return Status(Code::PermissionDenied, "this user may not write the tables of schema gobo", db.name());
  GOBO_ASSIGN(const std::string text, db.exec("SELECT version FROM store"));
  const int version = std::atoi(text.c_str());
  if (version < 1 || version > PostgresJobStore::kVersion)
    return Status(Code::FailedPrecondition,
                  strf("job store has schema version %d, this build reads versions 1 to %d: start the newer release, or name another database", version,
                       PostgresJobStore::kVersion),
                  db.name());
  return version;
}

}  // namespace

Result<std::unique_ptr<PostgresJobStore>> PostgresJobStore::open(const std::string& uri, const JobStoreOptions& options) {
  GOBO_TRY(checkPostgresUri(uri));
  std::unique_ptr<PostgresJobStore> store(new PostgresJobStore(uri, options));
  GOBO_TRY(store->db_.connect());
  GOBO_TRY(store->migrate());
  store->db_.step = options.step;
  return store;
}

Status PostgresJobStore::check(const std::string& uri) {
  GOBO_TRY(checkPostgresUri(uri));
  Postgres db(uri, JobStoreOptions().busySeconds);
  GOBO_TRY(db.connect());
  GOBO_ASSIGN(const int version, postgresStoreVersion(db));
  if (version) return {};
  GOBO_ASSIGN(const std::string allowed, db.exec("SELECT coalesce((SELECT has_schema_privilege(oid, 'CREATE') FROM pg_namespace WHERE nspname = 'gobo'),"
                                                 " has_database_privilege(current_database(), 'CREATE'))"));
  if (allowed != "t") return {Code::PermissionDenied, "has no job store yet, and this user may not make its schema (GRANT CREATE ON DATABASE)", db.name()};
  return {};
}

Status PostgresJobStore::migrate() {
  // Daemons that start together make one store. The transaction's own lock: it goes with it, however it ends.
  GOBO_TRY(db_.exec("BEGIN; SELECT pg_advisory_xact_lock(7305799234)").status());
  const auto make = [&]() -> Status {
    GOBO_ASSIGN(const int version, postgresStoreVersion(db_));
    if (!version) {
      if (!options_.create) return {Code::DataLoss, "job store is missing", db_.name()};
      GOBO_ASSIGN(const std::string schemas, db_.exec("SELECT count(*) FROM pg_namespace WHERE nspname = 'gobo'"));
      if (schemas == "0") GOBO_TRY(db_.exec("CREATE SCHEMA gobo").status());  // an administrator may have made it
      GOBO_TRY(db_.exec(kPostgresSchema).status());
      GOBO_TRY(db_.exec(kPostgresVersion2).status());
      GOBO_TRY(db_.exec("INSERT INTO identity VALUES('" + newStoreIdentity() + "')").status());
      return {};
    }
    if (version == 1) GOBO_TRY(db_.exec(kPostgresVersion2).status());
    // Transaction numbers begin again in a database that was dumped and restored; revisions go on.
    return db_
        .exec(
            "UPDATE counter SET value = value + ahead FROM (SELECT coalesce(max(t.revision), 0) + 1 - pg_snapshot_xmin(pg_current_snapshot())::text::bigint"
            " - (SELECT value FROM counter WHERE name = 'revision') AS ahead,"
            " coalesce(max(t.revision), 0) - pg_snapshot_xmax(pg_current_snapshot())::text::bigint - (SELECT value FROM counter WHERE name = 'revision') AS "
            "over"
            " FROM task t) a WHERE name = 'revision' AND a.over >= 0")
        .status();
  };
  const Status status = make();
  if (status.ok()) return db_.commit();
  (void)db_.exec("ROLLBACK");
  return status;
}

Status PostgresJobStore::run(const char* begin, bool reads, const std::function<Status()>& work) {
  static thread_local std::minstd_rand random{std::random_device{}()};
  bool again = false;
  passed_.clear();
  for (int attempt = 1;; ++attempt) {
    GOBO_TRY(db_.connect());
    Result<std::string> begun = db_.exec(begin);
    Status status = begun.status();
    bool committing = false;
    if (status.ok()) {
      time_ = std::atof(begun->c_str());
      status = work();
      if (status.ok()) {
        committing = true;
        status = db_.commit();
        if (status.ok()) return status;
      }
    }
    const bool conflict = db_.conflict() || status.code() == Code::Aborted;
    if (db_.connected()) {
      const auto step = std::move(db_.step);  // a failing test seam must not keep the transaction open
      db_.step = nullptr;
      (void)db_.exec("ROLLBACK");
      db_.step = step;
    } else if ((reads || !committing) && !again) {
      again = true;  // the server was started anew since the last operation
      continue;
    }
    if (!conflict) return status;
    if (attempt >= kConflicts) return {Code::Unavailable, status.message() + strf(" (%d attempts)", attempt), db_.name()};
    if (status.code() != Code::Aborted) std::this_thread::sleep_for(std::chrono::milliseconds(1 + random() % (2u << std::min(attempt, 5))));
  }
}

Status PostgresJobStore::transact(const std::function<Status()>& change) { return run(kBeginChange, false, change); }
Status PostgresJobStore::look(const std::function<Status()>& read) { return run(kBeginLook, true, read); }

double PostgresJobStore::shareClock() const {
  if (options_.now || options_.uptime) return uptime();
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Result<int64_t> PostgresJobStore::number(const char* sql) {
  SqlQuery q(db_, sql);
  int64_t value = 0;
  while (q.next()) value = q.integer(0);
  if (!q.status().ok()) return q.status();
  return value;
}

Status PostgresJobStore::lockJob(int64_t id, Hold hold) {
  SqlQuery q(db_, hold == Hold::Whole ? "SELECT id FROM job WHERE id = ?1 FOR UPDATE" : "SELECT id FROM job WHERE id = ?1 FOR SHARE");
  return q.bind(id).run();
}

Result<uint64_t> PostgresJobStore::revision() {
  // Changes of transactions before the oldest that runs are all seen; "after" begins with that one.
  GOBO_ASSIGN(const int64_t value, number("SELECT pg_snapshot_xmin(pg_current_snapshot())::text::bigint - 1 + value FROM counter WHERE name = 'revision'"));
  return uint64_t(value);
}

Result<std::string> PostgresJobStore::edition() {
  const std::lock_guard lock(mutex_);
  std::string seen;
  GOBO_TRY(look([&]() -> Status {
    SqlQuery q(db_, "SELECT pg_current_snapshot()::text");  // which transactions are seen
    while (q.next()) seen = q.text(0);
    return q.status();
  }));
  return seen;
}

Result<uint64_t> PostgresJobStore::nextRevision() {
  GOBO_ASSIGN(const int64_t value, number("SELECT pg_current_xact_id()::text::bigint + value FROM counter WHERE name = 'revision'"));
  return uint64_t(value);
}

Result<uint64_t> PostgresJobStore::nextToken() {
  GOBO_ASSIGN(const int64_t value, number("SELECT nextval('token')"));
  return uint64_t(value);
}

Result<int64_t> PostgresJobStore::nextJob() { return number("UPDATE counter SET value = value + 1 WHERE name = 'job' RETURNING value"); }
Result<int64_t> PostgresJobStore::lastJob() { return number("SELECT value FROM counter WHERE name = 'job'"); }

Status PostgresJobStore::skipJobs(int64_t last) {
  SqlQuery q(db_, "UPDATE counter SET value = ?1 WHERE name = 'job' AND value < ?1");
  return q.bind(last).run();
}

std::string PostgresJobStore::listed(const char* number, int k) const { return strf("%s = ANY(CAST(string_to_array(?%d, ',') AS bigint[]))", number, k); }

Status PostgresJobStore::addTasks(int64_t job, const std::vector<int64_t>& frames, uint32_t parts, uint64_t revision) {
  std::string list = "{";
  for (size_t i = 0; i < frames.size(); ++i) list += (i ? "," : "") + std::to_string(frames[i]);
  list += "}";
  {
    SqlQuery q(db_,
               "INSERT INTO task(job, idx, frame, state, revision, waits)"
               " SELECT ?1, f.i - 1, f.frame, 1, ?3, ?4 FROM unnest(CAST(?2 AS bigint[])) WITH ORDINALITY AS f(frame, i)");
    GOBO_TRY(q.bind(job).bind(list).bind(revision).bind(int64_t(parts)).run());
  }
  if (parts == 0) return {};
  SqlQuery q(db_,
             "INSERT INTO task(job, idx, frame, state, revision, whole)"
             " SELECT ?1, ?5 + (f.i - 1) * ?4 + p, f.frame, 1, ?3, f.i - 1 FROM unnest(CAST(?2 AS bigint[])) WITH ORDINALITY AS f(frame, i),"
             " generate_series(0, ?4 - 1) AS p");
  return q.bind(job).bind(list).bind(revision).bind(int64_t(parts)).bind(int64_t(frames.size())).run();
}

Status PostgresJobStore::firstReady(const std::string& client, std::optional<Lease>& lease) {
  int64_t job = 0, state = 0;
  {
    // The subquery is evaluated job by job in the order of job_order, until one has a ready frame.
    SqlQuery q(db_,
               "SELECT j.id, j.state FROM job j WHERE j.state IN (1, 2) AND j.client = ?1 AND NOT EXISTS (SELECT 1 FROM depend d WHERE d.job = j.id)"
               " AND (SELECT 1 FROM task r WHERE r.job = j.id AND r.state = 1 AND r.waits = 0 AND r.ready <= ?2 ORDER BY r.idx LIMIT 1) IS NOT NULL"
               " ORDER BY j.client, j.priority DESC, coalesce(j.deadline, 1e300), j.id LIMIT ?3");
    q.bind(client).bind(uptime()).bind(int64_t(passed_.size() + 1));
    while (q.next())
      if (!job && !passed_.count(q.integer(0))) job = q.integer(0), state = q.integer(1);
    GOBO_TRY(q.status());
  }
  if (!job) return {};
  const Status again{Code::Aborted, "others are taking the frames"};
  // A job that runs is shared with other claims; the first claim of a job changes its row.
  const bool whole = state == v1::Job::QUEUED;
  {
    SqlQuery q(db_, whole ? "SELECT state FROM job WHERE id = ?1 FOR UPDATE" : "SELECT state FROM job WHERE id = ?1 FOR SHARE");
    q.bind(job);
    int64_t found = 0;
    while (q.next()) found = q.integer(0);
    GOBO_TRY(q.status());
    if (found != v1::Job::RUNNING && !(whole && found == v1::Job::QUEUED)) return again;  // it was steered, or went idle: look anew
  }
  // Asked again, now that the job is locked: it may have been told to wait meanwhile.
  SqlQuery q(db_,
             "SELECT idx, frame, progress FROM task WHERE job = ?1 AND state = 1 AND waits = 0 AND ready <= ?2"
             " AND NOT EXISTS (SELECT 1 FROM depend d WHERE d.job = ?1) ORDER BY idx LIMIT 1 FOR UPDATE SKIP LOCKED");
  q.bind(job).bind(uptime());
  while (q.next()) {
    lease.emplace();
    lease->task = {job, q.integer(0)};
    lease->frame = q.integer(1);
    lease->progress = q.real(2);
  }
  GOBO_TRY(q.status());
  if (lease) return {};
  passed_.insert(job);  // its last frames go to others: the next job, in a transaction that holds nothing of this one
  return again;
}

Status PostgresJobStore::tell(News news) {
  SqlQuery q(db_, "SELECT pg_notify('gobo_jobs', ?1)");
  return q.bind(std::string(news == News::Work ? "work" : "steered")).run();
}

Result<std::string> PostgresJobStore::integrity() {
  const std::lock_guard lock(mutex_);
  std::string found = "ok";
  GOBO_TRY(look([&]() -> Status {
    found = "ok";
    SqlQuery q(
        db_,
        "SELECT j.id FROM job j LEFT JOIN (SELECT job, count(*) FILTER (WHERE whole IS NULL) AS n, count(*) FILTER (WHERE state = 3 AND whole IS NULL) AS done,"
        " count(*) FILTER (WHERE state = 4 AND whole IS NULL) AS failed, count(*) FILTER (WHERE state = 2) AS running FROM task GROUP BY job) t ON t.job = j.id"
        " WHERE coalesce(t.n, 0) <> j.frames OR coalesce(t.done, 0) <> j.done OR coalesce(t.failed, 0) <> j.failed"
        " OR (j.state = 1 AND t.running > 0) OR (j.state > 3 AND t.running > 0) ORDER BY 1 LIMIT 1");
    while (q.next()) found = jobIdText(q.integer(0)) + " does not count its frames right";
    return q.status();
  }));
  return found;
}

}  // namespace jobs
}  // namespace gobo
