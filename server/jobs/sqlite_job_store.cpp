// SPDX-License-Identifier: Apache-2.0
// Opening, submitting, reading and steering jobs; sqlite_job_tasks.cpp has the tasks.
#include "server/jobs/sqlite_job_store.h"

#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <random>

#include "server/log.h"

namespace gobo {

namespace {

using Query = Sqlite::Query;

constexpr int kVersion = 2;
// States are the numbers of v1.Job.State and v1.Frame.State. revision: of the store when the row last changed.
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

std::string bootId() {
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::string id;
  std::getline(in, id);
  return id.empty() ? "unknown" : id;
}

constexpr const char* kJobColumns =
    "SELECT id, spec, state, error_code, error, frames, done, failed, scene_hash, submitted, started, ended, result_bytes, expired,"
    " (SELECT ifnull(sum(progress), 0) FROM task WHERE task.job = job.id AND task.state < 3 AND progress > 0),"
    " scene_source, scene_file, environment_digest, client FROM job ";

JobRecord jobOf(const Query& q) {
  JobRecord r;
  r.id = q.integer(0);
  v1::Job& job = r.job;
  job.set_id(jobIdText(r.id));
  job.mutable_spec()->ParseFromString(q.text(1));
  job.set_state(v1::Job::State(q.integer(2)));
  if (q.integer(3)) {
    job.mutable_error()->set_code(int32_t(q.integer(3)));
    job.mutable_error()->set_message(q.text(4));
  }
  job.set_frames_total(uint64_t(q.integer(5)));
  job.set_frames_done(uint64_t(q.integer(6)));
  job.set_frames_failed(uint64_t(q.integer(7)));
  job.set_scene_hash(q.text(8));
  job.set_submitted_unix_s(q.real(9));
  job.set_started_unix_s(q.real(10));
  job.set_ended_unix_s(q.real(11));
  job.set_result_bytes(uint64_t(q.integer(12)));
  job.set_results_expired(q.integer(13) != 0);
  job.set_progress((double(job.frames_done()) + q.real(14)) / double(std::max<uint64_t>(1, job.frames_total())));
  r.sceneSource = q.text(15);
  r.sceneFile = q.text(16);
  r.environmentDigest = q.text(17);
  job.mutable_spec()->set_client(q.text(18));
  return r;
}

Status noJob(int64_t id) { return notFound("no job '" + jobIdText(id) + "'", "id"); }

}  // namespace

bool OwnedJobs::has(int64_t id) const {
  return id > 0 && id <= last && std::none_of(except.begin(), except.end(), [&](const auto& range) { return id >= range.first && id <= range.second; });
}

std::string newStoreIdentity() {
  std::random_device random;
  std::string text;
  for (int i = 0; i < 4; ++i) text += strf("%08x", unsigned(random()));
  return text;
}

std::string jobIdText(int64_t id) { return "j-" + std::to_string(id); }

int64_t jobIdOf(const std::string& text) {
  if (text.rfind("j-", 0) != 0 || text.size() < 3 || text.size() > 20 || text.find_first_not_of("0123456789", 2) != std::string::npos) return 0;
  return std::atoll(text.c_str() + 2);
}

bool jobIsOver(v1::Job::State s) { return s == v1::Job::DONE || s == v1::Job::FAILED || s == v1::Job::CANCELLED; }

Result<std::unique_ptr<SqliteJobStore>> SqliteJobStore::open(const std::string& path, const JobStoreOptions& options) {
  std::unique_ptr<SqliteJobStore> store(new SqliteJobStore);
  store->path_ = path;
  store->options_ = options;
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
    if (version > kVersion)
      return {Code::FailedPrecondition,
              strf("job store has schema version %d, this build reads versions 1 to %d: start the newer release, or move the folder away", version, kVersion),
              path_};
    if (tables != "0" && (ours != "3" || version < 1)) return {Code::FailedPrecondition, "is a database, but no job store", path_};
    if (version == kVersion && tables != "0") return {};
    if (version == 1 && tables != "0") return db_.exec(kVersion2);
    if (!options_.create) return {Code::DataLoss, "job store is empty", path_};
    GOBO_TRY(db_.exec(kSchema));
    GOBO_TRY(db_.exec(kVersion2));
    return db_.exec("INSERT INTO identity VALUES('" + newStoreIdentity() + "')");
  });
}

Status SqliteJobStore::startClock() {
  return transact([&]() -> Status {
    std::string boot;
    {
      Query q(db_, "SELECT boot, base, kept FROM clock");
      while (q.next()) boot = q.text(0), clockBase_ = q.real(1), clockKept_ = q.real(2);
      GOBO_TRY(q.status());
    }
    if (boot == options_.boot && uptime() >= clockKept_) return {};  // as the processes that are open
    clockBase_ = clockKept_ - options_.uptime();                     // a new store's begins at 0
    Query q(db_, "UPDATE clock SET boot = ?1, base = ?2");
    return q.bind(options_.boot).bind(clockBase_).run();
  });
}

Status SqliteJobStore::keepClock() {
  clockKept_ = std::max(clockKept_, uptime());
  Query q(db_, "UPDATE clock SET kept = max(kept, ?1)");
  return q.bind(clockKept_).run();
}

Result<std::string> SqliteJobStore::identity() {
  const std::lock_guard lock(mutex_);
  return db_.value("SELECT id FROM identity");
}

Status SqliteJobStore::identify(const std::string& id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    Query q(db_, "INSERT INTO identity SELECT ?1 WHERE NOT EXISTS(SELECT 1 FROM identity)");
    return q.bind(id).run();
  });
}

Status SqliteJobStore::disown(int64_t last) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_ASSIGN(const std::string text, db_.value("SELECT seq FROM sqlite_sequence WHERE name = 'job'"));
    const int64_t given = std::atoll(text.c_str());
    if (last <= given) return {};
    {
      Query q(db_, "INSERT INTO unowned VALUES(?1, ?2)");
      GOBO_TRY(q.bind(given + 1).bind(last).run());
    }
    Query q(db_, text.empty() ? "INSERT INTO sqlite_sequence(name, seq) VALUES('job', ?1)" : "UPDATE sqlite_sequence SET seq = ?1 WHERE name = 'job'");
    return q.bind(last).run();
  });
}

Result<OwnedJobs> SqliteJobStore::owned() {
  const std::lock_guard lock(mutex_);
  GOBO_ASSIGN(const std::string text, db_.value("SELECT seq FROM sqlite_sequence WHERE name = 'job'"));
  OwnedJobs owned;
  owned.last = std::atoll(text.c_str());
  Query q(db_, "SELECT first, last FROM unowned");
  while (q.next()) owned.except.push_back({q.integer(0), q.integer(1)});
  if (!q.status().ok()) return q.status();
  return owned;
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
  Query q(db_, "UPDATE counter SET value = value + 1 WHERE name = ?1 RETURNING value");
  q.bind(std::string(counter));
  uint64_t value = 0;
  while (q.next()) value = uint64_t(q.integer(0));
  if (!q.status().ok()) return q.status();
  return value;
}

Result<int64_t> SqliteJobStore::findKey(const std::string& client, const std::string& key, const std::string& digest) {
  if (key.empty()) return int64_t(0);
  const std::lock_guard lock(mutex_);
  Query q(db_, "SELECT id, digest FROM job WHERE client = ?1 AND key = ?2 AND key <> ''");
  q.bind(client).bind(key);
  int64_t id = 0;
  bool equal = true;
  while (q.next()) id = q.integer(0), equal = q.text(1) == digest;
  if (!q.status().ok()) return q.status();
  if (!equal) return Status(Code::AlreadyExists, "key '" + key + "' is that of " + jobIdText(id) + ", which was made from another spec", "job.key");
  return id;
}

Result<int64_t> SqliteJobStore::submit(const NewJob& n, bool& existed) {
  existed = false;
  for (;;) {
    GOBO_ASSIGN(int64_t id, findKey(n.client, n.spec.key(), n.digest));
    if (id) {
      existed = true;
      return id;
    }
    const std::lock_guard lock(mutex_);
    bool raced = false;
    const Status status = transact([&]() -> Status {
      {
        Query again(db_, "SELECT id FROM job WHERE client = ?1 AND key = ?2 AND key <> ''");
        again.bind(n.client).bind(n.spec.key());
        while (again.next()) raced = true;
        GOBO_TRY(again.status());
        if (raced) return {Code::Aborted, "another process was first"};
      }
      {
        Query active(db_, "SELECT ifnull(sum(frames - done - failed), 0) FROM job WHERE state IN (1, 2, 3)");
        uint64_t tasks = 0;
        while (active.next()) tasks = uint64_t(active.integer(0));
        GOBO_TRY(active.status());
        if (tasks + n.frames.size() > options_.maxActiveTasks)
          return {Code::ResourceExhausted,
                  strf("%llu frames wait already; at most %llu are kept", (unsigned long long)tasks, (unsigned long long)options_.maxActiveTasks),
                  "job.frames"};
      }
      GOBO_ASSIGN(const uint64_t revision, bump("revision"));
      {
        Query q(db_,
                "INSERT INTO job(client, key, digest, spec, priority, deadline, max_attempts, state, frames, scene_hash, scene_source,"
                " scene_file, environment_digest, submitted, revision) VALUES(?1, ?2, ?3, ?4, ?5, CASE WHEN ?6 > 0 THEN ?6 END, ?7, 1, ?8, ?9, ?10, ?11, ?12, "
                "?13, ?14)");
        q.bind(n.client)
            .bind(n.spec.key())
            .bind(n.digest)
            .blob(n.spec.SerializeAsString())
            .bind(int(n.spec.priority()))
            .bind(n.spec.deadline_unix_s())
            .bind(int64_t(n.spec.max_attempts()))
            .bind(int64_t(n.frames.size()))
            .bind(n.sceneHash)
            .bind(n.sceneSource)
            .bind(n.sceneFile)
            .bind(n.environmentDigest)
            .bind(now())
            .bind(revision);
        GOBO_TRY(q.run());
      }
      id = db_.lastId();
      for (size_t i = 0; i < n.frames.size(); ++i) {
        Query q(db_, "INSERT INTO task(job, idx, frame, state, revision) VALUES(?1, ?2, ?3, 1, ?4)");
        q.bind(id).bind(int64_t(i)).bind(n.frames[i]).bind(revision);
        GOBO_TRY(q.run());
      }
      return {};
    });
    if (raced) continue;
    if (!status.ok()) return status;
    return id;
  }
}

Result<JobRecord> SqliteJobStore::readJob(int64_t id) {
  JobRecord record;
  {
    static const std::string sql = std::string(kJobColumns) + "WHERE id = ?1";
    Query q(db_, sql.c_str());
    q.bind(id);
    while (q.next()) record = jobOf(q);
    if (!q.status().ok()) return q.status();
  }
  if (!record.id) return noJob(id);
  Query q(db_, "SELECT value FROM counter WHERE name = 'revision'");
  while (q.next()) record.revision = uint64_t(q.integer(0));
  if (!q.status().ok()) return q.status();
  return record;
}

Status SqliteJobStore::readFrames(int64_t id, uint64_t after, v1::Job& job) {
  std::vector<int64_t> indices;
  {
    Query q(db_,
            "SELECT idx, frame, state, failures, progress, spp, error_code, error, seconds,"
            " (SELECT digest FROM checkpoint c WHERE c.job = task.job AND c.idx = task.idx ORDER BY bytes DESC LIMIT 1)"
            " FROM task WHERE job = ?1 AND revision > ?2 ORDER BY idx");
    q.bind(id).bind(after);
    while (q.next()) {
      indices.push_back(q.integer(0));
      v1::Frame& f = *job.add_frames();
      f.set_frame(q.integer(1));
      f.set_state(v1::Frame::State(q.integer(2)));
      f.set_attempts(uint32_t(q.integer(3)) + (f.state() == v1::Frame::RUNNING || f.state() == v1::Frame::DONE));
      f.set_progress(f.state() == v1::Frame::DONE ? 1 : q.real(4));
      f.set_spp(uint32_t(q.integer(5)));
      if (q.integer(6)) {
        f.mutable_error()->set_code(int32_t(q.integer(6)));
        f.mutable_error()->set_message(q.text(7));
      }
      f.set_seconds(q.real(8));
      f.set_checkpoint(q.text(9));
    }
    GOBO_TRY(q.status());
  }
  Query q(db_,
          "SELECT f.idx, f.message FROM task t JOIN file f ON f.job = t.job AND f.idx = t.idx"
          " WHERE t.job = ?1 AND t.revision > ?2 ORDER BY f.idx, f.output");
  q.bind(id).bind(after);
  size_t at = 0;
  while (q.next()) {
    while (at < indices.size() && indices[at] < q.integer(0)) ++at;
    if (at < indices.size() && indices[at] == q.integer(0)) job.mutable_frames(int(at))->add_files()->ParseFromString(q.text(1));
  }
  return q.status();
}

Result<JobRecord> SqliteJobStore::get(int64_t id, bool withFrames) {
  const std::lock_guard lock(mutex_);
  // A read transaction: job and frames are of one moment, whatever other processes write.
  GOBO_TRY(db_.exec("BEGIN"));
  Result<JobRecord> record = readJob(id);
  Status status = record.status();
  if (status.ok() && withFrames) status = readFrames(id, 0, record->job);
  (void)db_.exec("COMMIT");
  if (!status.ok()) return status;
  return record;
}

Result<JobRecord> SqliteJobStore::changes(int64_t id, uint64_t revision) {
  const std::lock_guard lock(mutex_);
  GOBO_TRY(db_.exec("BEGIN"));
  Result<JobRecord> record = readJob(id);
  Status status = record.status();
  if (status.ok() && record->revision > revision) status = readFrames(id, revision, record->job);
  (void)db_.exec("COMMIT");
  if (!status.ok()) return status;
  record->job.clear_spec();
  return record;
}

Result<std::vector<v1::Job>> SqliteJobStore::list(const JobFilter& filter) {
  const std::lock_guard lock(mutex_);
  std::string sql = std::string(kJobColumns) + "WHERE id < ?1 AND (?2 = '' OR client = ?2)";
  if (!filter.states.empty()) {
    sql += " AND state IN (";
    for (size_t i = 0; i < filter.states.size(); ++i) sql += (i ? "," : "") + std::to_string(int(filter.states[i]));
    sql += ")";
  }
  sql += " ORDER BY id DESC LIMIT ?3";
  Query q(db_, sql.c_str());
  q.bind(filter.before > 0 ? filter.before : INT64_MAX).bind(filter.client).bind(int64_t(filter.limit));
  std::vector<v1::Job> jobs;
  for (uint64_t bytes = 0; (jobs.size() < 2 || bytes <= filter.bytes) && q.next();) {
    jobs.push_back(jobOf(q).job);
    bytes += jobs.back().ByteSizeLong();
  }
  if (!q.status().ok()) return q.status();
  return jobs;
}

Status SqliteJobStore::cancel(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_ASSIGN(const JobRecord record, readJob(id));
    if (jobIsOver(record.job.state())) return {};
    GOBO_ASSIGN(const uint64_t revision, bump("revision"));
    return endJob(id, v1::Job::CANCELLED, {}, revision);
  });
}

Status SqliteJobStore::pause(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(readJob(id).status());
    GOBO_ASSIGN(const uint64_t revision, bump("revision"));
    Query q(db_, "UPDATE job SET state = 3, revision = ?2 WHERE id = ?1 AND state IN (1, 2)");
    return q.bind(id).bind(revision).run();
  });
}

Status SqliteJobStore::resume(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(readJob(id).status());
    GOBO_ASSIGN(const uint64_t revision, bump("revision"));
    Query q(db_,
            "UPDATE job SET state = CASE WHEN EXISTS(SELECT 1 FROM task WHERE job = ?1 AND state = 2) THEN 2 ELSE 1 END, revision = ?2 WHERE id = ?1 AND state "
            "= 3");
    return q.bind(id).bind(revision).run();
  });
}

Status SqliteJobStore::remove(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_ASSIGN(const JobRecord record, readJob(id));
    if (!jobIsOver(record.job.state()))
      return {Code::FailedPrecondition, jobIdText(id) + " is " + v1::Job::State_Name(record.job.state()) + ": cancel it first", "id"};
    Query q(db_, "DELETE FROM job WHERE id = ?1");
    return q.bind(id).run();
  });
}

}  // namespace gobo
