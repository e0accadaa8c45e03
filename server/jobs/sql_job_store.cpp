// SPDX-License-Identifier: Apache-2.0
// Submitting, reading and steering jobs; sql_job_tasks.cpp has the tasks, sql_job_depend.cpp who waits for whom, sql_job_log.cpp the log.
#include "server/jobs/sql_job_store.h"

#include <algorithm>
#include <cstdlib>
#include <random>
#include <set>

#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

using Query = SqlQuery;

constexpr const char* kJobColumns =
    "SELECT id, spec, state, error_code, error, frames, done, failed, scene_hash, submitted, started, ended, result_bytes, expired,"
    " (SELECT coalesce(sum(progress), 0) FROM task WHERE task.job = job.id AND task.state < 3 AND progress > 0 AND whole IS NULL),"
    " scene_source, scene_file, environment_digest, client, parts FROM job ";

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
  r.parts = uint32_t(q.integer(19));
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

Result<std::string> SqlJobStore::identity() {
  const std::lock_guard lock(mutex_);
  std::string id;
  GOBO_TRY(look([&]() -> Status {
    id.clear();
    Query q(db(), "SELECT id FROM identity");
    while (q.next()) id = q.text(0);
    return q.status();
  }));
  return id;
}

Status SqlJobStore::identify(const std::string& id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    Query q(db(), "INSERT INTO identity SELECT ?1 WHERE NOT EXISTS(SELECT 1 FROM identity)");
    return q.bind(id).run();
  });
}

Status SqlJobStore::disown(int64_t last) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_ASSIGN(const int64_t given, lastJob());
    if (last <= given) return {};
    Query q(db(), "INSERT INTO unowned VALUES(?1, ?2)");
    GOBO_TRY(q.bind(given + 1).bind(last).run());
    return skipJobs(last);
  });
}

Result<OwnedJobs> SqlJobStore::owned() {
  const std::lock_guard lock(mutex_);
  OwnedJobs owned;
  GOBO_TRY(look([&]() -> Status {
    owned = {};
    GOBO_ASSIGN(owned.last, lastJob());
    Query q(db(), "SELECT first, last FROM unowned");
    while (q.next()) owned.except.push_back({q.integer(0), q.integer(1)});
    return q.status();
  }));
  return owned;
}

Result<int64_t> SqlJobStore::findKey(const std::string& client, const std::string& key, const std::string& digest) {
  if (key.empty()) return int64_t(0);
  const std::lock_guard lock(mutex_);
  int64_t id = 0;
  bool equal = true;
  GOBO_TRY(look([&]() -> Status {
    id = 0;
    Query q(db(), "SELECT id, digest FROM job WHERE client = ?1 AND key = ?2 AND key <> ''");
    q.bind(client).bind(key);
    while (q.next()) id = q.integer(0), equal = q.text(1) == digest;
    return q.status();
  }));
  if (id && !equal) return Status(Code::AlreadyExists, "key '" + key + "' is that of " + jobIdText(id) + ", which was made from another spec", "job.key");
  return id;
}

Result<int64_t> SqlJobStore::submit(const NewJob& n, bool& existed) {
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
      raced = false;
      GOBO_ASSIGN(id, nextJob());  // first: what follows sees every submission before this one
      {
        Query again(db(), "SELECT id FROM job WHERE client = ?1 AND key = ?2 AND key <> ''");
        again.bind(n.client).bind(n.spec.key());
        while (again.next()) raced = true;
        GOBO_TRY(again.status());
        if (raced) return {Code::AlreadyExists, "another process was first"};
      }
      GOBO_TRY(roomFor(n.frames.size() * (1 + uint64_t(n.parts))));
      GOBO_ASSIGN(const uint64_t revision, nextRevision());
      {
        Query q(db(),
                "INSERT INTO job(client, key, digest, spec, priority, deadline, max_attempts, state, frames, scene_hash, scene_source,"
                " scene_file, environment_digest, submitted, revision, id, parts) VALUES(?1, ?2, ?3, ?4, ?5, CASE WHEN ?6 > 0 THEN ?6 END, ?7, 1, ?8, ?9, ?10, "
                "?11, ?12, ?13, ?14, nullif(?15, 0), ?16) RETURNING id");
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
            .bind(revision)
            .bind(id)
            .bind(int64_t(n.parts));
        while (q.next()) id = q.integer(0);
        GOBO_TRY(q.status());
      }
      GOBO_TRY(addTasks(id, n.frames, n.parts, revision));
      GOBO_TRY(addNeeds(id, n.after, "job.after"));
      GOBO_TRY(noteJob(id, v1::JobLogEntry::SUBMITTED));
      return tell(News::Work);
    });
    if (raced) continue;
    if (!status.ok()) return status;
    return id;
  }
}

Result<JobRecord> SqlJobStore::readJob(int64_t id) {
  JobRecord record;
  {
    static const std::string sql = std::string(kJobColumns) + "WHERE id = ?1";
    Query q(db(), sql.c_str());
    q.bind(id);
    while (q.next()) record = jobOf(q);
    if (!q.status().ok()) return q.status();
  }
  if (!record.id) return noJob(id);
  GOBO_ASSIGN(const std::vector<int64_t> needs, needsOf(id));
  for (int64_t need : needs) record.job.add_waits_for(jobIdText(need));
  GOBO_ASSIGN(record.revision, revision());
  return record;
}

Status SqlJobStore::readFrames(const JobRecord& record, uint64_t after, v1::Job& job) {
  const int64_t id = record.id;
  std::vector<int64_t> indices;
  {
    Query q(db(),
            "SELECT idx, frame, state, failures, progress, spp, error_code, error, seconds,"
            " (SELECT digest FROM checkpoint c WHERE c.job = task.job AND c.idx = task.idx ORDER BY bytes DESC LIMIT 1), holder"
            " FROM task WHERE job = ?1 AND revision > ?2 AND whole IS NULL ORDER BY idx");
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
      if (f.state() == v1::Frame::RUNNING || f.state() == v1::Frame::DONE) f.set_holder(q.text(10));
    }
    GOBO_TRY(q.status());
  }
  Query q(db(),
          "SELECT f.idx, f.message FROM task t JOIN file f ON f.job = t.job AND f.idx = t.idx"
          " WHERE t.job = ?1 AND t.revision > ?2 AND t.whole IS NULL ORDER BY f.idx, f.output");
  q.bind(id).bind(after);
  size_t at = 0;
  while (q.next()) {
    while (at < indices.size() && indices[at] < q.integer(0)) ++at;
    if (at < indices.size() && indices[at] == q.integer(0)) job.mutable_frames(int(at))->add_files()->ParseFromString(q.text(1));
  }
  GOBO_TRY(q.status());
  return record.parts ? readParts(record, indices, after, job) : Status();
}

Result<JobRecord> SqlJobStore::get(int64_t id, bool withFrames) {
  const std::lock_guard lock(mutex_);
  JobRecord record;
  GOBO_TRY(look([&]() -> Status {
    GOBO_ASSIGN(record, readJob(id));
    return withFrames ? readFrames(record, 0, record.job) : Status();
  }));
  return record;
}

Result<JobRecord> SqlJobStore::changes(int64_t id, uint64_t revision) {
  const std::lock_guard lock(mutex_);
  JobRecord record;
  GOBO_TRY(look([&]() -> Status {
    GOBO_ASSIGN(record, readJob(id));
    return readFrames(record, revision, record.job);  // even where the revision is the same: one that stands still has not seen all
  }));
  record.job.clear_spec();
  return record;
}

Result<std::vector<v1::Job>> SqlJobStore::list(const JobFilter& filter) {
  const std::lock_guard lock(mutex_);
  std::string sql = std::string(kJobColumns) + "WHERE id < ?1 AND (?2 = '' OR client = ?2)";
  if (!filter.states.empty()) {
    std::string states;  // each once, in order: a statement is kept for each text that there was
    for (const int state : std::set<int>(filter.states.begin(), filter.states.end())) states += (states.empty() ? "" : ",") + std::to_string(state);
    sql += " AND state IN (" + states + ")";
  }
  sql += " ORDER BY id DESC LIMIT ?3";
  std::vector<v1::Job> jobs;
  GOBO_TRY(look([&]() -> Status {
    jobs.clear();
    Query q(db(), sql.c_str());
    q.bind(filter.before > 0 ? filter.before : INT64_MAX).bind(filter.client).bind(int64_t(filter.limit));
    for (uint64_t bytes = 0; (jobs.size() < 2 || bytes <= filter.bytes) && q.next();) {
      jobs.push_back(jobOf(q).job);
      bytes += jobs.back().ByteSizeLong();
    }
    GOBO_TRY(q.status());
    if (jobs.empty()) return {};
    return readNeeds(jobIdOf(jobs.back().id()), jobIdOf(jobs.front().id()), jobs);
  }));
  return jobs;
}

Status SqlJobStore::cancel(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_ASSIGN(const JobRecord record, readJob(id));
    if (jobIsOver(record.job.state())) return {};
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    GOBO_TRY(noteJob(id, v1::JobLogEntry::CANCELLED));
    GOBO_TRY(endJob(id, v1::Job::CANCELLED, {}, revision));
    return tell(News::Steered);
  });
}

Status SqlJobStore::pause(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_TRY(readJob(id).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    bool changed = false;
    {
      Query q(db(), "UPDATE job SET state = 3, revision = ?2 WHERE id = ?1 AND state IN (1, 2) RETURNING id");
      q.bind(id).bind(revision);
      while (q.next()) changed = true;
      GOBO_TRY(q.status());
    }
    if (changed) GOBO_TRY(noteJob(id, v1::JobLogEntry::PAUSED));
    return tell(News::Steered);
  });
}

Status SqlJobStore::resume(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_TRY(readJob(id).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    bool changed = false;
    {
      Query q(db(),
              "UPDATE job SET state = CASE WHEN EXISTS(SELECT 1 FROM task WHERE job = ?1 AND state = 2) THEN 2 ELSE 1 END, revision = ?2"
              " WHERE id = ?1 AND state = 3 RETURNING id");
      q.bind(id).bind(revision);
      while (q.next()) changed = true;
      GOBO_TRY(q.status());
    }
    if (changed) GOBO_TRY(noteJob(id, v1::JobLogEntry::RESUMED));
    return tell(News::Steered);
  });
}

Status SqlJobStore::roomFor(uint64_t frames) {
  Query active(db(), "SELECT coalesce(sum((frames - done - failed) * (1 + parts)), 0) FROM job WHERE state IN (1, 2, 3)");
  uint64_t tasks = 0;
  while (active.next()) tasks = uint64_t(active.integer(0));
  GOBO_TRY(active.status());
  if (tasks + frames <= options_.maxActiveTasks) return {};
  return {Code::ResourceExhausted,
          strf("%llu frames wait already; at most %llu are kept", (unsigned long long)tasks, (unsigned long long)options_.maxActiveTasks), "job.frames"};
}

Status SqlJobStore::retry(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_ASSIGN(const JobRecord record, readJob(id));
    uint64_t again = 0;
    {
      Query q(db(), "SELECT count(*) FROM task WHERE job = ?1 AND state IN (4, 5)");
      q.bind(id);
      while (q.next()) again = uint64_t(q.integer(0));
      GOBO_TRY(q.status());
    }
    if (again == 0) return {};
    if (record.job.results_expired()) return {Code::FailedPrecondition, jobIdText(id) + ": results of its other frames were removed: submit it again", "id"};
    if (record.job.spec().has_deadline_unix_s() && record.job.spec().deadline_unix_s() <= now())
      return {Code::FailedPrecondition, jobIdText(id) + strf(": its deadline (%.3f) has passed", record.job.spec().deadline_unix_s()), "id"};
    GOBO_TRY(roomFor(again));
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    {
      Query q(db(),
              "UPDATE task SET state = 1, failures = 0, losses = 0, ready = 0, progress = 0, spp = 0, error_code = 0, error = '', revision = ?2"
              " WHERE job = ?1 AND state IN (4, 5)");
      GOBO_TRY(q.bind(id).bind(revision).run());
    }
    if (record.parts) GOBO_TRY(recountParts(record, revision));
    Query q(db(),
            "UPDATE job SET state = CASE WHEN state = 3 THEN 3 WHEN EXISTS(SELECT 1 FROM task WHERE job = ?1 AND state = 2) THEN 2 ELSE 1 END,"
            " failed = 0, error_code = 0, error = '', ended = 0, ended_uptime = 0, revision = ?2 WHERE id = ?1");
    GOBO_TRY(q.bind(id).bind(revision).run());
    GOBO_TRY(noteJob(id, v1::JobLogEntry::RETRIED));
    return tell(News::Work);
  });
}

Status SqlJobStore::prioritize(int64_t id, v1::JobSpec::Priority priority) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_ASSIGN(JobRecord record, readJob(id));
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    record.job.mutable_spec()->set_priority(priority);
    Query q(db(), "UPDATE job SET priority = ?2, spec = ?3, revision = ?4 WHERE id = ?1");
    GOBO_TRY(q.bind(id).bind(int(priority)).blob(record.job.spec().SerializeAsString()).bind(revision).run());
    GOBO_TRY(noteJob(id, v1::JobLogEntry::PRIORITIZED));
    return tell(News::Work);
  });
}

Status SqlJobStore::remove(int64_t id) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_ASSIGN(const JobRecord record, readJob(id));
    if (!jobIsOver(record.job.state()))
      return {Code::FailedPrecondition, jobIdText(id) + " is " + v1::Job::State_Name(record.job.state()) + ": cancel it first", "id"};
    GOBO_TRY(checkNobodyWaits(id));
    Query q(db(), "DELETE FROM job WHERE id = ?1");
    return q.bind(id).run();
  });
}

}  // namespace jobs
}  // namespace gobo
