// SPDX-License-Identifier: Apache-2.0
// RemoteTasks: the coordinator's frames, for a JobWorker here. Files go the same way as reports: before a checkpoint or a completion is reported its
// file, which the worker has written under its own folder, is put; a claimed frame's checkpoints and parts are fetched before its claim returns. Files stay
// here as long as a frame that is held needs them: frames of one job share its folder of results, and equal bytes one file. Thread-safe.
#pragma once

#include <functional>
#include <map>
#include <mutex>

#include "gobo/v1/farm.grpc.pb.h"
#include "server/jobs/job_files.h"
#include "server/jobs/job_hub.h"
#include "server/jobs/task_store.h"

namespace gobo::farm {

/// The way to a coordinator.
struct FarmLink {
  std::unique_ptr<v1::Farm::StubInterface> stub;
  std::string token;
  mutable std::mutex mutex;
  std::string worker;  ///< id; empty while nobody attends. Under mutex

  std::string id() const {
    const std::lock_guard lock(mutex);
    return worker;
  }
  /// With the token, and a time after which the call is given up.
  void prepare(grpc::ClientContext& context, double seconds) const;
};

class RemoteTasks final : public TaskStore {
 public:
  RemoteTasks(FarmLink& link, JobFiles& files, const JobHub& hub) : link_(link), files_(files), hub_(hub) {}

  Result<JobRecord> get(int64_t id, bool withFrames) override;
  Result<std::optional<Lease>> claim(const std::string& holder, double leaseSeconds) override;
  Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) override { return hold(lease, true); }
  Result<v1::Job::State> check(const Lease& lease) override { return hold(lease, false); }
  Result<std::vector<CheckpointRow>> checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) override;
  Result<std::vector<CheckpointRow>> checkpoints(TaskId task) override;
  Result<std::vector<v1::FrameFile>> parts(TaskId task) override;
  Status complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) override;
  Status fail(const Lease& lease, const FailedReport& report) override;
  Status release(const Lease& lease) override;

  /// Before the frame's files are written: what other frames leave behind is cleared, but for these.
  void delivers(const Lease& lease, const std::vector<v1::FrameFile>& files);

  /// Tells the coordinator how far frames are, where that has changed.
  void tellProgress();

  /// Fetches what `request` names (its lease is filled in) into the file. `meanwhile`: called after every piece of it.
  Status fetch(const Lease& lease, v1::GetFarmFileRequest request, const std::string& path, const std::function<void()>& meanwhile = {});
  /// The same of what is the job's, its scene or map: with any lease of it.
  Status fetch(int64_t job, const v1::GetFarmFileRequest& request, const std::string& path);

 private:
  struct Claimed {
    Lease lease;
    std::vector<CheckpointRow> checkpoints;
    std::vector<v1::FrameFile> parts, files;  // that it is put together from, that it delivers
    double told = 0;                          // progress
  };
  Result<v1::Job::State> hold(const Lease& lease, bool renew);
  Status put(const Lease& lease, bool checkpoint, const std::string& digest, const std::string& path);
  Status ended(const Lease& lease, const Status& answer, bool taken = true, const std::vector<v1::FrameFile>& files = {});
  void forget(const Lease& lease, const std::vector<v1::FrameFile>& files);
  FarmLink& link_;
  JobFiles& files_;
  const JobHub& hub_;
  std::mutex mutex_;
  std::map<TaskId, Claimed> claimed_;
  std::map<int64_t, JobRecord> jobs_;  // of claimed frames
};

}  // namespace gobo::farm
