// SPDX-License-Identifier: Apache-2.0
// Frames in parts (frame_parts.h): task.whole of a part is the index of its frame; task.waits of a frame is how many of its parts are not done.
// Parts of a frame are neighbours: their index says which they are, and finds them by the primary key.
#include <map>

#include "server/jobs/sql_job_store.h"

namespace gobo {
inline namespace jobs {

using Query = SqlQuery;

// Of the parts of frame ?2 of job ?1, for rows called `task`.
#define GOBO_ITS_PARTS                                                       \
  " job = ?1 AND idx >= (SELECT frames + ?2 * parts FROM job WHERE id = ?1)" \
  " AND idx < (SELECT frames + (?2 + 1) * parts FROM job WHERE id = ?1) AND whole = ?2"

Result<std::vector<v1::FrameFile>> SqlJobStore::parts(TaskId frame) {
  const std::lock_guard lock(mutex_);
  std::vector<v1::FrameFile> files;
  GOBO_TRY(look([&]() -> Status {
    files.clear();
    Query q(db(),
            "SELECT f.message FROM file f JOIN task p ON p.job = f.job AND p.idx = f.idx JOIN task w ON w.job = p.job AND w.idx = p.whole"
            " WHERE f.job = ?1 AND p.whole = ?2 AND w.waits = 0 AND f.idx >= (SELECT frames + ?2 * parts FROM job WHERE id = ?1)"
            " AND f.idx < (SELECT frames + (?2 + 1) * parts FROM job WHERE id = ?1) ORDER BY f.idx");
    q.bind(frame.job).bind(frame.index);
    while (q.next()) files.emplace_back().ParseFromString(q.text(0));
    return q.status();
  }));
  return files;
}

Status SqlJobStore::partDone(TaskId frame, uint32_t parts, double seconds, uint64_t revision) {
  Query q(db(),
          "UPDATE task SET waits = waits - 1, progress = CAST(?3 - waits + 1 AS DOUBLE PRECISION) / (?3 + 1), seconds = seconds + ?4, revision = ?5"
          " WHERE job = ?1 AND idx = ?2");
  return q.bind(frame.job).bind(frame.index).bind(int64_t(parts)).bind(seconds).bind(revision).run();
}

Status SqlJobStore::dropParts(TaskId frame, uint64_t revision) {
  uint64_t bytes = 0;
  {
    Query q(db(), "DELETE FROM file WHERE job = ?1 AND idx IN (SELECT idx FROM task WHERE" GOBO_ITS_PARTS ") RETURNING bytes");
    q.bind(frame.job).bind(frame.index);
    while (q.next()) bytes += uint64_t(q.integer(0));
    GOBO_TRY(q.status());
  }
  Query q(db(), "UPDATE job SET result_bytes = result_bytes - ?2, revision = ?3 WHERE id = ?1");
  return q.bind(frame.job).bind(bytes).bind(revision).run();
}

Status SqlJobStore::partsAgain(TaskId frame, const TaskRow& row, uint64_t revision) {
  GOBO_TRY(dropParts(frame, revision));
  {
    Query q(db(), "UPDATE task SET state = 1, progress = 0, spp = 0, seconds = 0, revision = ?3 WHERE" GOBO_ITS_PARTS);
    GOBO_TRY(q.bind(frame.job).bind(frame.index).bind(revision).run());
  }
  Query q(db(), "UPDATE task SET waits = ?3, progress = 0, seconds = 0, revision = ?4 WHERE job = ?1 AND idx = ?2");
  return q.bind(frame.job).bind(frame.index).bind(int64_t(row.parts)).bind(revision).run();
}

Status SqlJobStore::endParts(TaskId frame, uint64_t revision) {
  // New tokens for what ran: its holders find their lease over.
  GOBO_ASSIGN(const uint64_t token, nextToken());
  {
    Query q(db(), "DELETE FROM checkpoint WHERE job = ?1 AND idx IN (SELECT idx FROM task WHERE" GOBO_ITS_PARTS " AND state IN (1, 2))");
    GOBO_TRY(q.bind(frame.job).bind(frame.index).run());
  }
  Query q(db(), "UPDATE task SET token = CASE WHEN state = 2 THEN ?3 ELSE token END, state = 5, holder = '', revision = ?4 WHERE" GOBO_ITS_PARTS
                " AND state IN (1, 2)");
  return q.bind(frame.job).bind(frame.index).bind(token).bind(revision).run();
}

Status SqlJobStore::recountParts(const JobRecord& record, uint64_t revision) {
  const int64_t frames = int64_t(record.job.frames_total());
  Query q(db(),
          "UPDATE task SET revision = ?4,"
          " waits = (SELECT count(*) FROM task p WHERE p.job = ?1 AND p.idx >= ?2 + task.idx * ?3 AND p.idx < ?2 + (task.idx + 1) * ?3 AND p.state <> 3)"
          " WHERE job = ?1 AND whole IS NULL AND state = 1");
  return q.bind(record.id).bind(frames).bind(int64_t(record.parts)).bind(revision).run();
}

Status SqlJobStore::readParts(const JobRecord& record, const std::vector<int64_t>& indices, uint64_t after, v1::Job& job) {
  if (indices.empty()) return {};
  std::map<int64_t, v1::Frame*> frames;
  for (size_t i = 0; i < indices.size(); ++i) frames[indices[i]] = job.mutable_frames(int(i));
  {
    Query q(db(), "SELECT idx, waits FROM task WHERE job = ?1 AND revision > ?2 AND whole IS NULL");
    q.bind(record.id).bind(after);
    while (q.next())
      if (const auto f = frames.find(q.integer(0)); f != frames.end()) {
        f->second->set_parts(record.parts);
        f->second->set_parts_done(record.parts - uint32_t(q.integer(1)));
      }
    GOBO_TRY(q.status());
  }
  // A frame of which a part is taken runs.
  Query q(db(), "SELECT DISTINCT whole FROM task WHERE job = ?1 AND state = 2 AND whole IS NOT NULL");
  q.bind(record.id);
  while (q.next())
    if (const auto f = frames.find(q.integer(0)); f != frames.end() && f->second->state() == v1::Frame::QUEUED) {
      f->second->set_state(v1::Frame::RUNNING);
      f->second->set_attempts(f->second->attempts() + 1);
    }
  return q.status();
}

}  // namespace jobs
}  // namespace gobo
