// SPDX-License-Identifier: Apache-2.0
// What happened to jobs and frames: one row a change, written in its transaction, so the log says neither more nor less than what was committed.
#include <algorithm>

#include "server/jobs/sql_job_store.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

/// One change in 256 prunes its job. By a hash of the sequence, which all jobs share: a job whose changes take turns with another's gets its turns too.
bool prunes(uint64_t sequence) { return (sequence * 0x9e3779b97f4a7c15u) >> 56 == 0; }

}  // namespace

Status SqlJobStore::noteJob(int64_t job, v1::JobLogEntry::Kind kind) {
  SqlQuery q(db(),
             "INSERT INTO log(job, at, kind, error_code, error) SELECT id, ?2, ?3, CASE WHEN ?4 = 1 THEN error_code ELSE 0 END,"
             " CASE WHEN ?4 = 1 THEN error ELSE '' END FROM job WHERE id = ?1 RETURNING seq");
  q.bind(job).bind(now()).bind(int(kind)).bind(int(kind == v1::JobLogEntry::ENDED));
  return noted(q, job);
}

Status SqlJobStore::noteTask(TaskId id, v1::JobLogEntry::Kind kind, const Status& reason, double seconds) {
  SqlQuery q(db(),
             "INSERT INTO log(job, idx, at, kind, holder, error_code, error, seconds) SELECT job, idx, ?3, ?4, holder, ?5, ?6, ?7"
             " FROM task WHERE job = ?1 AND idx = ?2 RETURNING seq");
  q.bind(id.job).bind(id.index).bind(now()).bind(int(kind)).bind(int(reason.code())).bind(reason.message()).bind(seconds);
  return noted(q, id.job);
}

Status SqlJobStore::noted(SqlQuery& insert, int64_t job) {
  uint64_t sequence = 0;
  while (insert.next()) sequence = uint64_t(insert.integer(0));
  GOBO_TRY(insert.status());
  if (!sequence || !prunes(sequence)) return {};
  SqlQuery q(db(), "DELETE FROM log WHERE job = ?1 AND seq <= (SELECT seq FROM log WHERE job = ?1 ORDER BY seq DESC LIMIT 1 OFFSET ?2)");
  return q.bind(job).bind(int64_t(options_.logEntries)).run();
}

Result<std::vector<v1::JobLogEntry>> SqlJobStore::log(int64_t id, const JobLogFilter& filter) {
  const std::lock_guard lock(mutex_);
  std::string sql =
      "SELECT l.seq, l.at, l.kind, l.idx, t.frame, l.holder, l.error_code, l.error, l.seconds, j.frames, j.parts"
      " FROM log l JOIN job j ON j.id = l.job LEFT JOIN task t ON t.job = l.job AND t.idx = l.idx WHERE l.job = ?1 AND l.seq > ?2";
  // As one value: a statement is kept for each text that there was.
  std::string frames;
  for (const int64_t frame : filter.frames) frames += (frames.empty() ? "" : ",") + std::to_string(frame);
  if (!frames.empty()) sql += " AND " + listed("t.frame", 4);
  sql += " ORDER BY l.seq DESC LIMIT ?3";
  std::vector<v1::JobLogEntry> entries;
  GOBO_TRY(look([&]() -> Status {
    entries.clear();
    SqlQuery q(db(), sql.c_str());
    q.bind(id).bind(int64_t(std::min<uint64_t>(filter.after, INT64_MAX))).bind(int64_t(std::min(filter.most, options_.logEntries)));
    if (!frames.empty()) q.bind(frames);
    for (uint64_t bytes = 0; (entries.empty() || bytes <= filter.bytes) && q.next();) {
      v1::JobLogEntry& e = entries.emplace_back();
      e.set_sequence(uint64_t(q.integer(0)));
      e.set_unix_s(q.real(1));
      e.set_kind(v1::JobLogEntry::Kind(q.integer(2)));
      const bool ofTask = e.kind() >= v1::JobLogEntry::CLAIMED && e.kind() <= v1::JobLogEntry::SET_ASIDE;
      if (ofTask) {
        e.set_frame(q.integer(4));
        if (const auto part = placeOf(q.integer(3), q.integer(9), uint32_t(q.integer(10))).part) e.set_part(*part);
      }
      e.set_holder(q.text(5));
      if (q.integer(6)) {
        e.mutable_error()->set_code(int32_t(q.integer(6)));
        e.mutable_error()->set_message(q.text(7));
      }
      e.set_seconds(q.real(8));
      bytes += e.ByteSizeLong();
    }
    GOBO_TRY(q.status());
    std::reverse(entries.begin(), entries.end());
    return {};
  }));
  return entries;
}

}  // namespace jobs
}  // namespace gobo
