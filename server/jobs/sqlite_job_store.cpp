// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/sqlite_job_store.h"

#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>

#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr int kSqliteVersion = 3;
// States are the numbers of v1.Job.State and v1.Frame.State. revision: of the store when the row last changed.
constexpr double kClockEvery = 60;  // seconds that a restart of the machine may take from the age of results
constexpr const char* kSchema = R"(
CREATE TABLE counter(name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;
INSERT INTO counter VALUES('revision', 0), ('token', 0);
CREATE TABLE job(
  id INTEGER PRIMARY KEY AUTOINCREMENT, client TEXT NOT NULL, key TEXT NOT NULL, digest TEXT NOT NULL, spec BLOB NOT NULL,
  priority INTEGER NOT NULL, deadline REAL, max_attempts INTEGER NOT NULL, state INTEGER NOT NULL,
  error_code INTEGER NOT NULL DEFAULT 0, error TEXT NOT NULL DEFAULT '', frames INTEGER NOT NULL, done INTEGER NOT NULL DEFAULT 0,
  failed INTEGER NOT NULL DEFAULT 0, scene_hash TEXT NOT NULL, scene_source TEXT NOT NULL, scene_file TEXT NOT NULL,
  environment_digest TEXT NOT NULL, submitted REAL NOT NULL, started REAL NOT NULL DEFAULT 0, ended REAL NOT NULL DEFAULT 0,
  result_bytes INTEGER NOT NULL DEFAULT 0, expired INTEGER NOT NULL DEFAULT 0, revision INTEGER NOT NULL);
CREATE UNIQUE INDEX job_key ON job(client, key) WHERE key <> '';
CREATE INDEX job_order ON job(priority DESC, ifnull(deadline, 1e300), id) WHERE state IN (1, 2);
CREATE INDEX job_state ON job(state, id);
CREATE TABLE task(
  job INTEGER NOT NULL REFERENCES job(id) ON DELETE CASCADE, idx INTEGER NOT NULL, frame INTEGER NOT NULL, state INTEGER NOT NULL,
  failures INTEGER NOT NULL DEFAULT 0, losses INTEGER NOT NULL DEFAULT 0, token INTEGER NOT NULL DEFAULT 0,
  holder TEXT NOT NULL DEFAULT '', expires REAL NOT NULL DEFAULT 0, ready REAL NOT NULL DEFAULT 0, progress REAL NOT NULL DEFAULT 0,
  spp INTEGER NOT NULL DEFAULT 0, error_code INTEGER NOT NULL DEFAULT 0, error TEXT NOT NULL DEFAULT '',
  seconds REAL NOT NULL DEFAULT 0, revision INTEGER NOT NULL, PRIMARY KEY(job, idx)) WITHOUT ROWID;
CREATE INDEX task_queued ON task(job, idx) WHERE state = 1;
CREATE INDEX task_running ON task(expires) WHERE state = 2;
CREATE INDEX task_partial ON task(job, progress) WHERE state < 3 AND progress > 0;
CREATE INDEX task_changed ON task(job, revision);
CREATE TABLE checkpoint(
  job INTEGER NOT NULL, idx INTEGER NOT NULL, recipe TEXT NOT NULL, blocks INTEGER NOT NULL, digest TEXT NOT NULL,
  bytes INTEGER NOT NULL, PRIMARY KEY(job, idx, recipe), FOREIGN KEY(job, idx) REFERENCES task(job, idx) ON DELETE CASCADE) WITHOUT ROWID;
CREATE TABLE file(
  job INTEGER NOT NULL, idx INTEGER NOT NULL, output INTEGER NOT NULL, sha256 TEXT NOT NULL, bytes INTEGER NOT NULL,
  message BLOB NOT NULL, PRIMARY KEY(job, idx, output), FOREIGN KEY(job, idx) REFERENCES task(job, idx) ON DELETE CASCADE) WITHOUT ROWID;
)";
// What version 2 added. Times of leases and waits were of the wall clock: they start anew, and so does the age of results.
constexpr const char* kVersion2 = R"(
CREATE TABLE identity(id TEXT NOT NULL);
CREATE TABLE clock(boot TEXT NOT NULL, base REAL NOT NULL, kept REAL NOT NULL);
INSERT INTO clock VALUES('', 0, 0);
CREATE TABLE unowned(first INTEGER NOT NULL, last INTEGER NOT NULL);
ALTER TABLE job ADD COLUMN ended_uptime REAL NOT NULL DEFAULT 0;
UPDATE task SET expires = 0, ready = 0;
PRAGMA user_version = 2;
)";
// What version 3 added: parts of frames, jobs that wait for others, the log.
constexpr const char* kVersion3 = R"(
ALTER TABLE job ADD COLUMN parts INTEGER NOT NULL DEFAULT 0;
ALTER TABLE task ADD COLUMN whole INTEGER;
ALTER TABLE task ADD COLUMN waits INTEGER NOT NULL DEFAULT 0;
DROP INDEX task_queued;
CREATE INDEX task_queued ON task(job, idx) WHERE state = 1 AND waits = 0;
CREATE TABLE depend(
  job INTEGER NOT NULL REFERENCES job(id) ON DELETE CASCADE, needs INTEGER NOT NULL REFERENCES job(id) ON DELETE CASCADE,
  PRIMARY KEY(job, needs)) WITHOUT ROWID;
CREATE INDEX depend_needs ON depend(needs);
CREATE TABLE log(
  seq INTEGER PRIMARY KEY AUTOINCREMENT, job INTEGER NOT NULL REFERENCES job(id) ON DELETE CASCADE, idx INTEGER, at REAL NOT NULL, kind INTEGER NOT NULL,
  holder TEXT NOT NULL DEFAULT '', error_code INTEGER NOT NULL DEFAULT 0, error TEXT NOT NULL DEFAULT '', seconds REAL NOT NULL DEFAULT 0);
CREATE INDEX log_job ON log(job, seq);
PRAGMA user_version = 3;
)";

std::string bootId() {
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::string id;
  std::getline(in, id);
  return id.empty() ? "unknown" : id;
}

}  // namespace

Result<std::unique_ptr<SqliteJobStore>> SqliteJobStore::open(const std::string& path, const JobStoreOptions& options) {
  std::unique_ptr<SqliteJobStore> store(new SqliteJobStore(options));
  store->path_ = path;
  if (!store->options_.now) store->options_.now = [] { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); };
  if (!store->options_.uptime)
    store->options_.uptime = options.now ? options.now : [] {
      timespec t{};
      ::clock_gettime(CLOCK_BOOTTIME, &t);
      return double(t.tv_sec) + double(t.tv_nsec) * 1e-9;
    };
  if (store->options_.boot.empty()) store->options_.boot = bootId();
  if (!options.create && ::access(path.c_str(), F_OK) != 0) return Status(Code::DataLoss, "job store is missing", path);
  GOBO_TRY(store->db_.open(path, options.busySeconds));
  ::chmod(path.c_str(), 0600);
  GOBO_TRY(store->migrate());
  GOBO_TRY(store->startClock());
  store->db_.step = options.step;
  return store;
}

Status SqliteJobStore::migrate() {
  GOBO_ASSIGN(const std::string sound, db_.value("PRAGMA quick_check(1)"));
  if (sound != "ok") return {Code::DataLoss, "job store is damaged: " + sound, path_};
  return transact([&]() -> Status {
    GOBO_ASSIGN(const std::string text, db_.value("PRAGMA user_version"));
    const int version = std::atoi(text.c_str());
    GOBO_ASSIGN(const std::string tables, db_.value("SELECT count(*) FROM sqlite_schema"));
    GOBO_ASSIGN(const std::string ours, db_.value("SELECT count(*) FROM sqlite_schema WHERE name IN ('job', 'task', 'counter')"));
    if (version > kSqliteVersion)
      return {
          Code::FailedPrecondition,
          strf("job store has schema version %d, this build reads versions 1 to %d: start the newer release, or move the folder away", version, kSqliteVersion),
          path_};
    if (tables != "0" && (ours != "3" || version < 1)) return {Code::FailedPrecondition, "is a database, but no job store", path_};
    if (version == kSqliteVersion && tables != "0") return {};
    if (tables != "0") {
      if (version == 1) GOBO_TRY(db_.exec(kVersion2));
      return db_.exec(kVersion3);
    }
    if (!options_.create) return {Code::DataLoss, "job store is empty", path_};
    GOBO_TRY(db_.exec(kSchema));
    GOBO_TRY(db_.exec(kVersion2));
    GOBO_TRY(db_.exec(kVersion3));
    return db_.exec("INSERT INTO identity VALUES('" + newStoreIdentity() + "')");
  });
}

Status SqliteJobStore::startClock() {
  return transact([&]() -> Status {
    std::string boot;
    {
      SqlQuery q(db_, "SELECT boot, base, kept FROM clock");
      while (q.next()) boot = q.text(0), clockBase_ = q.real(1), clockKept_ = q.real(2);
      GOBO_TRY(q.status());
    }
    if (boot == options_.boot && uptime() >= clockKept_) return {};  // as the processes that are open
    clockBase_ = clockKept_ - options_.uptime();                     // a new store's begins at 0
    SqlQuery q(db_, "UPDATE clock SET boot = ?1, base = ?2");
    return q.bind(options_.boot).bind(clockBase_).run();
  });
}

Status SqliteJobStore::keepClock() {
  clockKept_ = std::max(clockKept_, uptime());
  SqlQuery q(db_, "UPDATE clock SET kept = max(kept, ?1)");
  return q.bind(clockKept_).run();
}

Status SqliteJobStore::transact(const std::function<Status()>& change) {
  // SQLite goes on writing into a file that has no name any more: nothing is promised there.
  if (!db_.current())
    return {Code::Unavailable, "job store was removed or replaced under the daemon: put it back, or stop the daemon and see docs/job_store.md", path_};
  GOBO_TRY(db_.exec("BEGIN IMMEDIATE"));
  Status status = change();
  if (status.ok()) {
    status = db_.exec("COMMIT");
    if (status.ok()) return status;
  }
  const auto step = std::move(db_.step);  // a failing test seam must not keep the transaction open
  db_.step = nullptr;
  (void)db_.exec("ROLLBACK");
  db_.step = step;
  return status;
}

Result<uint64_t> SqliteJobStore::bump(const char* counter) {
  SqlQuery q(db_, "UPDATE counter SET value = value + 1 WHERE name = ?1 RETURNING value");
  q.bind(std::string(counter));
  uint64_t value = 0;
  while (q.next()) value = uint64_t(q.integer(0));
  if (!q.status().ok()) return q.status();
  return value;
}

Status SqliteJobStore::look(const std::function<Status()>& read) {
  GOBO_TRY(db_.exec("BEGIN"));
  const Status status = read();
  (void)db_.exec("COMMIT");
  return status;
}

Result<uint64_t> SqliteJobStore::revision() {
  SqlQuery q(db_, "SELECT value FROM counter WHERE name = 'revision'");
  uint64_t value = 0;
  while (q.next()) value = uint64_t(q.integer(0));
  if (!q.status().ok()) return q.status();
  return value;
}

Result<std::string> SqliteJobStore::edition() {
  const std::lock_guard lock(mutex_);
  SqlQuery q(db_, "PRAGMA data_version");  // what other connections committed; of this one's changes SQLite counts the rows
  int64_t others = 0;
  while (q.next()) others = q.integer(0);
  if (!q.status().ok()) return q.status();
  return strf("%lld %lld", (long long)others, (long long)db_.changes());
}

Result<int64_t> SqliteJobStore::lastJob() {
  GOBO_ASSIGN(const std::string text, db_.value("SELECT seq FROM sqlite_sequence WHERE name = 'job'"));
  return int64_t(std::atoll(text.c_str()));
}

std::string SqliteJobStore::listed(const char* number, int k) const { return strf("%s IN (SELECT value FROM json_each('[' || ?%d || ']'))", number, k); }

Status SqliteJobStore::skipJobs(int64_t last) {
  {
    SqlQuery q(db_, "INSERT INTO sqlite_sequence(name, seq) SELECT 'job', 0 WHERE NOT EXISTS(SELECT 1 FROM sqlite_sequence WHERE name = 'job')");
    GOBO_TRY(q.run());
  }
  SqlQuery q(db_, "UPDATE sqlite_sequence SET seq = ?1 WHERE name = 'job'");
  return q.bind(last).run();
}

Status SqliteJobStore::addTasks(int64_t job, const std::vector<int64_t>& frames, uint32_t parts, uint64_t revision) {
  for (size_t i = 0; i < frames.size(); ++i) {
    SqlQuery q(db_, "INSERT INTO task(job, idx, frame, state, revision, waits) VALUES(?1, ?2, ?3, 1, ?4, ?5)");
    GOBO_TRY(q.bind(job).bind(int64_t(i)).bind(frames[i]).bind(revision).bind(int64_t(parts)).run());
  }
  for (size_t i = 0; i < frames.size() * parts; ++i) {
    SqlQuery q(db_, "INSERT INTO task(job, idx, frame, state, revision, whole) VALUES(?1, ?2, ?3, 1, ?4, ?5)");
    GOBO_TRY(q.bind(job).bind(int64_t(frames.size() + i)).bind(frames[i / parts]).bind(revision).bind(int64_t(i / parts)).run());
  }
  return {};
}

Status SqliteJobStore::firstReady(const std::string& client, std::optional<Lease>& lease) {
  SqlQuery q(db_,
             "SELECT j.id, t.idx, t.frame, t.progress FROM job j JOIN task t ON t.job = j.id AND t.idx ="
             " (SELECT idx FROM task r WHERE r.job = j.id AND r.state = 1 AND r.waits = 0 AND r.ready <= ?1 ORDER BY idx LIMIT 1)"
             " WHERE j.state IN (1, 2) AND j.client = ?2 AND NOT EXISTS (SELECT 1 FROM depend d WHERE d.job = j.id)"
             " ORDER BY j.priority DESC, ifnull(j.deadline, 1e300), j.id LIMIT 1");
  q.bind(uptime()).bind(client);
  while (q.next()) {
    lease.emplace();
    lease->task = {q.integer(0), q.integer(1)};
    lease->frame = q.integer(2);
    lease->progress = q.real(3);
  }
  return q.status();
}

Result<double> SqliteJobStore::endedAt() {
  GOBO_TRY(keepClock());
  return clockKept_;
}

Status SqliteJobStore::mindClock() {
  if (uptime() - clockKept_ < kClockEvery) return {};
  return transact([&] { return keepClock(); });
}

Result<std::string> SqliteJobStore::integrity() {
  const std::lock_guard lock(mutex_);
  return db_.value("PRAGMA integrity_check");
}

}  // namespace jobs
}  // namespace gobo
