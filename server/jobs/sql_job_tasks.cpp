// SPDX-License-Identifier: Apache-2.0
// Leases and reports of tasks, and what ends jobs.
#include <algorithm>
#include <cmath>

#include "server/jobs/sql_job_store.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

using Query = SqlQuery;

Result<SqlJobStore::TaskRow> SqlJobStore::task(TaskId id) {
  Query q(db(),
          "SELECT t.state, t.token, t.failures, j.state, j.max_attempts, t.frame, j.frames, j.parts FROM task t JOIN job j ON j.id = t.job"
          " WHERE t.job = ?1 AND t.idx = ?2");
  q.bind(id.job).bind(id.index);
  TaskRow row{};
  bool found = false;
  while (q.next()) {
    const auto parts = uint32_t(q.integer(7));
    row = {v1::Frame::State(q.integer(0)),
           uint64_t(q.integer(1)),
           uint32_t(q.integer(2)),
           v1::Job::State(q.integer(3)),
           uint32_t(q.integer(4)),
           q.integer(5),
           placeOf(id.index, q.integer(6), parts),
           parts};
    found = true;
  }
  if (!q.status().ok()) return q.status();
  if (!found) return Status(Code::FailedPrecondition, strf("frame %lld of %s is gone: the job was deleted", (long long)id.index, jobIdText(id.job).c_str()));
  return row;
}

Result<SqlJobStore::TaskRow> SqlJobStore::held(const Lease& lease) {
  GOBO_ASSIGN(const TaskRow row, task(lease.task));
  if (row.token == lease.token && row.state == v1::Frame::RUNNING) return row;
  return Status(Code::FailedPrecondition,
                strf("lease token %llu of %s frame %lld is over: the present token is %llu (frame is %s)", (unsigned long long)lease.token,
                     jobIdText(lease.task.job).c_str(), (long long)row.frame, (unsigned long long)row.token, v1::Frame::State_Name(row.state).c_str()));
}

Result<std::optional<Lease>> SqlJobStore::claim(const std::string& holder, double leaseSeconds) {
  const std::lock_guard lock(mutex_);
  std::optional<Lease> lease;
  std::string client;
  // The first ready frame of each client by its own priorities and deadlines; of these the one whose client has had least.
  const auto ready = [&]() -> Status {
    lease.reset();
    std::vector<std::string> clients;
    {
      Query q(db(), "SELECT DISTINCT client FROM job WHERE state IN (1, 2)");
      while (q.next()) clients.push_back(q.text(0));
      GOBO_TRY(q.status());
    }
    shares_.retain(clients);
    shares_.order(clients);
    for (const std::string& c : clients) {
      GOBO_TRY(firstReady(c, lease));
      if (!lease) continue;
      client = c;
      return {};
    }
    return {};
  };
  if (looksBeforeClaim()) {
    GOBO_TRY(look(ready));
    if (!lease) return lease;
  }
  GOBO_TRY(transact([&]() -> Status {
    GOBO_TRY(ready());  // another process may have been first
    if (!lease) return {};
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    GOBO_ASSIGN(lease->token, nextToken());
    lease->holder = holder;
    lease->expires = uptime() + leaseSeconds;
    {
      Query q(db(), "UPDATE task SET state = 2, token = ?3, holder = ?4, expires = ?5, revision = ?6 WHERE job = ?1 AND idx = ?2");
      GOBO_TRY(q.bind(lease->task.job).bind(lease->task.index).bind(lease->token).bind(holder).bind(lease->expires).bind(revision).run());
    }
    GOBO_TRY(noteTask(lease->task, v1::JobLogEntry::CLAIMED));
    // The row of a job that runs already is left alone: claims of its other frames need not wait.
    Query q(db(),
            "UPDATE job SET state = 2, started = CASE WHEN started = 0 THEN ?2 ELSE started END, revision = ?3 WHERE id = ?1 AND (state <> 2 OR started = 0)");
    return q.bind(lease->task.job).bind(now()).bind(revision).run();
  }));
  if (lease) shares_.started(client, *lease, shareClock());
  return lease;
}

Result<v1::Job::State> SqlJobStore::renew(Lease& lease, double leaseSeconds) {
  const std::lock_guard lock(mutex_);
  v1::Job::State state{};
  double expires = 0;
  GOBO_TRY(transact([&]() -> Status {
    GOBO_TRY(lockJob(lease.task.job, Hold::Shared));
    GOBO_ASSIGN(const TaskRow row, held(lease));
    state = row.job;
    expires = uptime() + leaseSeconds;
    Query q(db(), "UPDATE task SET expires = CASE WHEN expires > ?3 THEN expires ELSE ?3 END WHERE job = ?1 AND idx = ?2");
    return q.bind(lease.task.job).bind(lease.task.index).bind(expires).run();
  }));
  lease.expires = std::max(lease.expires, expires);
  return state;
}

Result<v1::Job::State> SqlJobStore::check(const Lease& lease) {
  const std::lock_guard lock(mutex_);
  v1::Job::State state{};
  GOBO_TRY(look([&]() -> Status {
    GOBO_ASSIGN(const TaskRow row, held(lease));
    state = row.job;
    return {};
  }));
  return state;
}

Result<std::vector<CheckpointRow>> SqlJobStore::checkpoints(TaskId id) {
  const std::lock_guard lock(mutex_);
  std::vector<CheckpointRow> rows;
  GOBO_TRY(look([&]() -> Status {
    rows.clear();
    Query q(db(), "SELECT recipe, digest, blocks, bytes FROM checkpoint WHERE job = ?1 AND idx = ?2 ORDER BY recipe");
    q.bind(id.job).bind(id.index);
    while (q.next()) rows.push_back({q.text(0), q.text(1), uint32_t(q.integer(2)), uint64_t(q.integer(3))});
    return q.status();
  }));
  return rows;
}

Result<std::vector<CheckpointRow>> SqlJobStore::checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) {
  const std::lock_guard lock(mutex_);
  std::vector<CheckpointRow> old;
  GOBO_TRY(transact([&]() -> Status {
    old.clear();
    GOBO_TRY(lockJob(lease.task.job, Hold::Shared));
    GOBO_TRY(held(lease).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    {
      Query q(db(), "SELECT recipe, digest, blocks, bytes FROM checkpoint WHERE job = ?1 AND idx = ?2 AND recipe = ?3 AND digest <> ?4");
      q.bind(lease.task.job).bind(lease.task.index).bind(row.recipe).bind(row.digest);
      while (q.next()) old.push_back({q.text(0), q.text(1), uint32_t(q.integer(2)), uint64_t(q.integer(3))});
      GOBO_TRY(q.status());
    }
    {
      Query q(db(),
              "INSERT INTO checkpoint(job, idx, recipe, blocks, digest, bytes) VALUES(?1, ?2, ?3, ?4, ?5, ?6)"
              " ON CONFLICT(job, idx, recipe) DO UPDATE SET blocks = excluded.blocks, digest = excluded.digest, bytes = excluded.bytes");
      GOBO_TRY(q.bind(lease.task.job).bind(lease.task.index).bind(row.recipe).bind(int64_t(row.blocks)).bind(row.digest).bind(row.bytes).run());
    }
    Query q(db(), "UPDATE task SET progress = ?3, spp = ?4, losses = 0, revision = ?5 WHERE job = ?1 AND idx = ?2");
    return q.bind(lease.task.job).bind(lease.task.index).bind(std::min(std::max(progress, 0.0), 1.0)).bind(int64_t(spp)).bind(revision).run();
  }));
  return old;
}

Status SqlJobStore::complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) {
  const std::lock_guard lock(mutex_);
  shares_.ended(lease, shareClock());
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(lease.task.job, Hold::Whole));
    GOBO_ASSIGN(const TaskRow row, task(lease.task));
    if (row.token == lease.token && row.state == v1::Frame::DONE) {  // the acknowledgement was lost: the report comes again
      Query q(db(), "SELECT sha256 FROM file WHERE job = ?1 AND idx = ?2 ORDER BY output");
      q.bind(lease.task.job).bind(lease.task.index);
      size_t n = 0;
      bool equal = true;
      while (q.next()) {
        equal = equal && n < files.size() && q.text(0) == files[n].sha256();
        ++n;
      }
      GOBO_TRY(q.status());
      if (equal && n == files.size()) return {};
      return {Code::FailedPrecondition, strf("%s frame %lld was completed with token %llu and other files", jobIdText(lease.task.job).c_str(),
                                             (long long)row.frame, (unsigned long long)lease.token)};
    }
    GOBO_TRY(held(lease).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    uint64_t bytes = 0;
    for (size_t i = 0; i < files.size(); ++i) {
      bytes += files[i].bytes();
      Query q(db(), "INSERT INTO file(job, idx, output, sha256, bytes, message) VALUES(?1, ?2, ?3, ?4, ?5, ?6)");
      GOBO_TRY(q.bind(lease.task.job)
                   .bind(lease.task.index)
                   .bind(int64_t(i))
                   .bind(files[i].sha256())
                   .bind(files[i].bytes())
                   .blob(files[i].SerializeAsString())
                   .run());
    }
    {
      Query q(db(), "DELETE FROM checkpoint WHERE job = ?1 AND idx = ?2");
      GOBO_TRY(q.bind(lease.task.job).bind(lease.task.index).run());
    }
    GOBO_TRY(noteTask(lease.task, v1::JobLogEntry::DONE, {}, seconds));
    {  // holder stays: who finished it
      Query q(db(), "UPDATE task SET state = 3, progress = 1, seconds = seconds + ?3, revision = ?4 WHERE job = ?1 AND idx = ?2");
      GOBO_TRY(q.bind(lease.task.job).bind(lease.task.index).bind(seconds).bind(revision).run());
    }
    {
      Query q(db(), "UPDATE job SET done = done + ?4, result_bytes = result_bytes + ?2, revision = ?3 WHERE id = ?1");
      GOBO_TRY(q.bind(lease.task.job).bind(bytes).bind(revision).bind(int(!row.place.part)).run());
    }
    if (row.place.part) return partDone({lease.task.job, row.place.frame}, row.parts, seconds, revision);
    if (row.parts) GOBO_TRY(dropParts(lease.task, revision));
    return settle(lease.task.job, revision);
  });
}

Status SqlJobStore::fail(const Lease& lease, const FailedReport& report) {
  const std::lock_guard lock(mutex_);
  shares_.ended(lease, shareClock());
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(lease.task.job, Hold::Whole));
    GOBO_ASSIGN(const TaskRow row, task(lease.task));
    // Repeated: the same token has been told off already, and nobody claimed since.
    if (row.token == lease.token && (row.state == v1::Frame::FAILED || row.state == v1::Frame::QUEUED)) return {};
    GOBO_TRY(held(lease).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    const bool last = !report.retry || row.failures + 1 >= row.maxAttempts;
    GOBO_TRY(noteTask(lease.task, v1::JobLogEntry::FAILED, report.reason));
    {
      Query q(db(),
              "UPDATE task SET state = 1, holder = '', failures = failures + 1, ready = ?3, error_code = ?4, error = ?5, revision = ?6 WHERE job = ?1 AND idx "
              "= ?2");
      const double wait = std::min(60.0, options_.retrySeconds * std::exp2(std::min(row.failures, 10u)));
      GOBO_TRY(q.bind(lease.task.job)
                   .bind(lease.task.index)
                   .bind(uptime() + wait)
                   .bind(int(report.reason.code()))
                   .bind(report.reason.message())
                   .bind(revision)
                   .run());
    }
    // What a frame in parts is put together from is not there: it is rendered again, where this was the last try when the job is retried.
    if (row.parts && !row.place.part && report.reason.code() == Code::DataLoss) GOBO_TRY(partsAgain(lease.task, row, revision));
    if (report.wholeJob) return endJob(lease.task.job, v1::Job::FAILED, report.reason, revision);
    if (!last) return idle(lease.task.job, revision);
    GOBO_TRY(setFailure(lease.task, report.reason, revision));
    GOBO_TRY(settle(lease.task.job, revision));
    return idle(lease.task.job, revision);
  });
}

Status SqlJobStore::setFailure(TaskId id, const Status& reason, uint64_t revision) {
  {
    Query q(db(), "UPDATE task SET state = 4, holder = '', error_code = ?3, error = ?4, revision = ?5 WHERE job = ?1 AND idx = ?2");
    GOBO_TRY(q.bind(id.job).bind(id.index).bind(int(reason.code())).bind(reason.message()).bind(revision).run());
  }
  {
    Query q(db(), "DELETE FROM checkpoint WHERE job = ?1 AND idx = ?2");
    GOBO_TRY(q.bind(id.job).bind(id.index).run());
  }
  GOBO_ASSIGN(const TaskRow row, task(id));
  const TaskId frame{id.job, row.place.frame};
  if (row.parts) GOBO_TRY(endParts(frame, revision));
  if (row.place.part)  // the frame with it
    return setFailure(frame, {reason.code(), strf("part %u: ", *row.place.part) + reason.message()}, revision);
  Query q(db(),
          "UPDATE job SET failed = failed + 1, revision = ?2, error = CASE WHEN error_code = 0 THEN ?4 ELSE error END,"
          " error_code = CASE WHEN error_code = 0 THEN ?3 ELSE error_code END WHERE id = ?1");
  return q.bind(id.job).bind(revision).bind(int(reason.code())).bind(strf("frame %lld: ", (long long)row.frame) + reason.message()).run();
}

Status SqlJobStore::settle(int64_t job, uint64_t revision) {
  GOBO_ASSIGN(const double clock, endedAt());
  int64_t state = 0;
  {
    Query q(db(),
            "UPDATE job SET state = CASE WHEN failed > 0 THEN 5 ELSE 4 END, ended = ?2, revision = ?3, ended_uptime = ?4 WHERE id = ?1 AND state IN (1, 2, 3) "
            "AND done + failed >= frames RETURNING state");
    q.bind(job).bind(now()).bind(revision).bind(clock);
    while (q.next()) state = q.integer(0);
    GOBO_TRY(q.status());
  }
  return state ? ended(job, v1::Job::State(state)) : Status();
}

Status SqlJobStore::ended(int64_t job, v1::Job::State state) {
  GOBO_TRY(noteJob(job, v1::JobLogEntry::ENDED));
  return state == v1::Job::DONE ? letDependentsGo(job) : Status();
}

Status SqlJobStore::endJob(int64_t job, v1::Job::State state, const Status& reason, uint64_t revision) {
  // New tokens for what ran: its holders find their lease over.
  GOBO_ASSIGN(const uint64_t token, nextToken());
  {
    Query q(db(),
            "UPDATE task SET token = CASE WHEN state = 2 THEN ?2 ELSE token END, state = 5, holder = '', revision = ?3 WHERE job = ?1 AND state IN (1, 2)");
    GOBO_TRY(q.bind(job).bind(token).bind(revision).run());
  }
  {
    Query q(db(), "DELETE FROM checkpoint WHERE job = ?1");
    GOBO_TRY(q.bind(job).run());
  }
  GOBO_ASSIGN(const double clock, endedAt());
  {
    Query q(db(), "UPDATE job SET state = ?2, error_code = ?3, error = ?4, ended = ?5, revision = ?6, ended_uptime = ?7 WHERE id = ?1");
    GOBO_TRY(q.bind(job).bind(int(state)).bind(int(reason.code())).bind(reason.message()).bind(now()).bind(revision).bind(clock).run());
  }
  return ended(job, state);
}

Status SqlJobStore::release(const Lease& lease) {
  const std::lock_guard lock(mutex_);
  shares_.ended(lease, shareClock());
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(lease.task.job, Hold::Whole));
    GOBO_TRY(held(lease).status());
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    return endLease(lease.task, false, revision);
  });
}

Status SqlJobStore::endLease(TaskId id, bool lost, uint64_t revision) {
  GOBO_ASSIGN(const uint64_t token, nextToken());
  GOBO_TRY(noteTask(id, lost ? v1::JobLogEntry::LOST : v1::JobLogEntry::RELEASED));
  uint64_t losses = 0;
  {
    Query q(db(), "UPDATE task SET state = 1, holder = '', token = ?3, losses = losses + ?4, revision = ?5 WHERE job = ?1 AND idx = ?2 RETURNING losses");
    q.bind(id.job).bind(id.index).bind(token).bind(int(lost)).bind(revision);
    while (q.next()) losses = uint64_t(q.integer(0));
    GOBO_TRY(q.status());
  }
  if (lost && losses >= options_.maxLosses) {
    const Status reason(Code::Aborted, strf("its worker was lost %llu times in a row before the first checkpoint", (unsigned long long)losses));
    GOBO_TRY(noteTask(id, v1::JobLogEntry::SET_ASIDE, reason));
    GOBO_TRY(setFailure(id, reason, revision));
    GOBO_TRY(settle(id.job, revision));
  }
  return idle(id.job, revision);
}

Status SqlJobStore::idle(int64_t job, uint64_t revision) {
  Query q(db(), "UPDATE job SET state = 1, revision = ?2 WHERE id = ?1 AND state = 2 AND NOT EXISTS(SELECT 1 FROM task WHERE job = ?1 AND state = 2)");
  return q.bind(job).bind(revision).run();
}

Result<std::vector<int64_t>> SqlJobStore::jobsWithEnds(double before, double deadlines) {
  Query q(db(), "SELECT job FROM task WHERE state = 2 AND expires <= ?1 UNION SELECT id FROM job WHERE state IN (1, 2, 3) AND deadline <= ?2 ORDER BY 1");
  q.bind(before).bind(deadlines);
  std::vector<int64_t> jobs;
  while (q.next()) jobs.push_back(q.integer(0));
  if (!q.status().ok()) return q.status();
  return jobs;
}

Result<uint64_t> SqlJobStore::endLeases(double before, double deadlines, bool remoteToo) {
  GOBO_ASSIGN(const std::vector<int64_t> jobs, jobsWithEnds(before, deadlines));
  if (jobs.empty()) return uint64_t(0);
  uint64_t count = 0;
  for (int64_t job : jobs) GOBO_TRY(lockJob(job, Hold::Whole));
  GOBO_ASSIGN(const uint64_t revision, nextRevision());
  for (int64_t job : jobs) {  // looked at again, now that they are locked
    std::vector<int64_t> over;
    {
      Query q(db(), "SELECT idx, holder FROM task WHERE job = ?1 AND state = 2 AND expires <= ?2 ORDER BY idx");
      q.bind(job).bind(before);
      while (q.next())
        if (remoteToo || q.text(1).rfind(kRemoteHolder, 0) != 0) over.push_back(q.integer(0));
      GOBO_TRY(q.status());
    }
    for (int64_t index : over) {
      GOBO_ASSIGN(const TaskRow row, task({job, index}));
      if (row.state != v1::Frame::RUNNING) continue;  // a part of a frame that failed with the part before
      GOBO_TRY(endLease({job, index}, true, revision));
      ++count;
    }
    bool late = false;
    {
      Query q(db(), "SELECT 1 FROM job WHERE id = ?1 AND state IN (1, 2, 3) AND deadline <= ?2");
      q.bind(job).bind(deadlines);
      while (q.next()) late = true;
      GOBO_TRY(q.status());
    }
    if (!late) continue;
    GOBO_TRY(endJob(job, v1::Job::FAILED, {Code::DeadlineExceeded, "the job's deadline passed"}, revision));
    ++count;
  }
  GOBO_TRY(tell(News::Steered));
  return count;
}

Result<uint64_t> SqlJobStore::expireLeases() {
  const std::lock_guard lock(mutex_);
  GOBO_TRY(mindClock());
  bool some = false;
  GOBO_TRY(look([&]() -> Status {
    GOBO_ASSIGN(const std::vector<int64_t> jobs, jobsWithEnds(uptime(), now()));
    some = !jobs.empty();
    return {};
  }));
  uint64_t count = 0;
  if (!some) return count;
  GOBO_TRY(transact([&]() -> Status {
    GOBO_ASSIGN(count, endLeases(uptime(), now(), true));
    return {};
  }));
  return count;
}

Result<uint64_t> SqlJobStore::endAllLeases() {
  const std::lock_guard lock(mutex_);
  uint64_t count = 0;
  GOBO_TRY(transact([&]() -> Status {
    GOBO_ASSIGN(count, endLeases(1e300, -1e300, false));
    return {};
  }));
  return count;
}

Status SqlJobStore::blame(TaskId id, const Status& reason, bool certain) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    GOBO_TRY(lockJob(id.job, Hold::Whole));
    const Result<TaskRow> row = task(id);
    if (!row.ok()) return row.status().code() == Code::FailedPrecondition ? Status() : row.status();  // the job was deleted
    if ((row->state != v1::Frame::QUEUED && row->state != v1::Frame::RUNNING) || jobIsOver(row->job)) return {};
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    uint64_t losses = 0;
    {
      Query q(db(), "UPDATE task SET losses = losses + ?3, revision = ?4 WHERE job = ?1 AND idx = ?2 RETURNING losses");
      q.bind(id.job).bind(id.index).bind(uint64_t(options_.maxLosses / 3 + 1)).bind(revision);
      while (q.next()) losses = uint64_t(q.integer(0));
      GOBO_TRY(q.status());
    }
    if (certain || losses >= options_.maxLosses) {
      GOBO_TRY(noteTask(id, v1::JobLogEntry::SET_ASIDE, reason));
      GOBO_TRY(setFailure(id, reason, revision));
      GOBO_TRY(settle(id.job, revision));
    }
    return idle(id.job, revision);
  });
}

Status SqlJobStore::chooseResults(uint64_t keepBytes, double keepSeconds, std::vector<int64_t>& gone) {
  gone.clear();
  Query q(db(),
          "SELECT id, result_bytes, ended_uptime FROM job WHERE state IN (4, 5, 6) AND result_bytes > 0 AND expired = 0"
          " ORDER BY ended_uptime DESC, ended DESC, id DESC");
  uint64_t sum = 0;
  const double time = uptime();
  while (q.next()) {  // newest first: what is beyond the bound goes
    sum += uint64_t(q.integer(1));
    if (sum > keepBytes || q.real(2) + keepSeconds < time) gone.push_back(q.integer(0));
  }
  return q.status();
}

Result<std::vector<int64_t>> SqlJobStore::expireResults(uint64_t keepBytes, double keepSeconds) {
  const std::lock_guard lock(mutex_);
  std::vector<int64_t> gone;
  GOBO_TRY(look([&] { return chooseResults(keepBytes, keepSeconds, gone); }));
  if (gone.empty()) return gone;
  GOBO_TRY(transact([&]() -> Status {
    std::vector<int64_t> chosen;
    GOBO_TRY(chooseResults(keepBytes, keepSeconds, chosen));
    std::sort(chosen.begin(), chosen.end());
    for (int64_t id : chosen) GOBO_TRY(lockJob(id, Hold::Whole));
    GOBO_TRY(chooseResults(keepBytes, keepSeconds, gone));  // again: another process may have been first
    std::erase_if(gone, [&](int64_t id) { return !std::binary_search(chosen.begin(), chosen.end(), id); });
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    for (int64_t id : gone) {
      {
        Query q(db(), "DELETE FROM file WHERE job = ?1");
        GOBO_TRY(q.bind(id).run());
      }
      Query q(db(), "UPDATE job SET expired = 1, result_bytes = 0, revision = ?2 WHERE id = ?1");
      GOBO_TRY(q.bind(id).bind(revision).run());
    }
    return {};
  }));
  return gone;
}

Result<std::vector<std::string>> SqlJobStore::texts(const char* sql, int64_t id) {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> out;
  GOBO_TRY(look([&]() -> Status {
    out.clear();
    Query q(db(), sql);
    if (id) q.bind(id);
    while (q.next()) out.push_back(q.text(0));
    return q.status();
  }));
  return out;
}

Result<std::vector<std::string>> SqlJobStore::neededCheckpoints() {
  return texts("SELECT job || '-' || idx || '-' || digest FROM checkpoint ORDER BY job, idx, recipe");
}
Result<std::vector<std::string>> SqlJobStore::neededResults(int64_t id) { return texts("SELECT sha256 FROM file WHERE job = ?1", id); }
Result<std::vector<std::string>> SqlJobStore::neededScenes() {
  return texts(
      "SELECT scene_file FROM job WHERE state IN (1, 2, 3) AND scene_file <> '' "
      "UNION SELECT environment_digest FROM job WHERE state IN (1, 2, 3) AND environment_digest <> ''");
}

Result<std::vector<int64_t>> SqlJobStore::jobIds() {
  GOBO_ASSIGN(const auto rows, texts("SELECT CAST(id AS TEXT) FROM job"));
  std::vector<int64_t> ids;
  for (const std::string& r : rows) ids.push_back(std::atoll(r.c_str()));
  return ids;
}

Result<JobTotals> SqlJobStore::totals() {
  const std::lock_guard lock(mutex_);
  JobTotals t;
  GOBO_TRY(look([&]() -> Status {
    t = {};
    Query q(db(), "SELECT state, count(*), sum(frames - done - failed), sum(result_bytes) FROM job GROUP BY state");
    while (q.next()) {
      const auto n = uint64_t(q.integer(1));
      switch (v1::Job::State(q.integer(0))) {
        case v1::Job::QUEUED: t.queued = n; break;
        case v1::Job::RUNNING: t.running = n; break;
        case v1::Job::PAUSED: t.paused = n; break;
        case v1::Job::DONE: t.done = n; break;
        case v1::Job::FAILED: t.failed = n; break;
        default: t.cancelled = n; break;
      }
      if (q.integer(0) <= 3) t.activeTasks += uint64_t(q.integer(2));
      t.resultBytes += uint64_t(q.integer(3));
    }
    return q.status();
  }));
  return t;
}

}  // namespace jobs
}  // namespace gobo
