// SPDX-License-Identifier: Apache-2.0
// TaskStore: a worker's side of the job store (job_store.h has the rules of leases and tokens): the store itself beside it, or the coordinator's
// over gRPC (server/farm/remote_tasks.h). Thread-safe.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/jobs.pb.h"

namespace gobo {
inline namespace jobs {

/// How holders begin that are on other machines: a daemon that starts alone on its folder does not know that they are dead.
inline constexpr char kRemoteHolder[] = "farm/";

struct JobRecord {
  int64_t id = 0;
  v1::Job job;  ///< progress counts finished frames and checkpoints
  std::string sceneSource, sceneFile, environmentDigest;
  uint32_t parts = 0;     ///< of each frame; 0: not split
  uint64_t revision = 0;  ///< of the store when read; grows with every change
};

struct TaskId {
  int64_t job = 0, index = 0;  ///< index of the frame in the job, from 0; of a part: placeOf
  auto operator<=>(const TaskId&) const = default;
};

/// What a task of a job of `frames` frames of `parts` parts is: 0 .. frames - 1 are the frames, frames + f parts + p is part p of frame f.
struct TaskPlace {
  int64_t frame = 0;             ///< index
  std::optional<uint32_t> part;  ///< absent: the frame
};
inline TaskPlace placeOf(int64_t index, int64_t frames, uint32_t parts) {
  if (index < frames || parts == 0) return {index, {}};
  return {(index - frames) / parts, uint32_t((index - frames) % parts)};
}

struct Lease {
  TaskId task;
  uint64_t token = 0;
  std::string holder;
  double expires = 0;  ///< on the store's own clock
  int64_t frame = 0;
  double progress = 0;  ///< of the last checkpoint
};

struct CheckpointRow {
  std::string recipe, digest;
  uint32_t blocks = 0;
  uint64_t bytes = 0;
};

struct FailedReport {
  Status reason;
  bool retry = true;      ///< false: no attempt of this frame can do better
  bool wholeJob = false;  ///< nor of any other frame
};

class TaskStore {
 public:
  virtual ~TaskStore() = default;

  virtual Result<JobRecord> get(int64_t id, bool withFrames) = 0;  ///< NotFound
  /// The next task: of the client that has had least time of this process's workers (server/jobs/job_shares.h), by job priority, then job
  /// deadline, then job id, then frame. None: nothing is ready now.
  virtual Result<std::optional<Lease>> claim(const std::string& holder, double leaseSeconds) = 0;
  /// Extends the lease. The job's state: a holder that reads Paused is to release soon.
  virtual Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) = 0;
  /// The job's state, if the lease still holds. Writes nothing.
  virtual Result<v1::Job::State> check(const Lease& lease) = 0;
  /// Records a checkpoint file that is on disk; it replaces the one of the same recipe. The digests of files not needed any more.
  virtual Result<std::vector<CheckpointRow>> checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) = 0;
  virtual Result<std::vector<CheckpointRow>> checkpoints(TaskId task) = 0;
  /// Files of a frame's parts, in their order; none of a frame that is not split, or not all of whose parts are done.
  virtual Result<std::vector<v1::FrameFile>> parts(TaskId frame) = 0;
  /// The frame or part is done; `files` are on disk. Again with the same token and files: Ok.
  virtual Status complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) = 0;
  virtual Status fail(const Lease& lease, const FailedReport& report) = 0;
  /// Gives the task back: it waits again, no attempt is counted.
  virtual Status release(const Lease& lease) = 0;
};

}  // namespace jobs
}  // namespace gobo
