// SPDX-License-Identifier: Apache-2.0
// FarmWorker: this daemon renders frames of a coordinator's jobs (`gobod --worker ADDR`, docs/farm.md). One thread attends: it keeps a stream
// open over which the coordinator says that there is something to do, and opens it again when it ends; the frames' own threads are a
// JobWorker's over RemoteTasks. start() and stop() from one thread.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

#include "server/config.h"
#include "server/farm/remote_scenes.h"
#include "server/jobs/job_worker.h"
#include "server/repeating.h"
#include "server/scratch.h"

namespace gobo::farm {

class FarmWorker {
 public:
  /// Does not wait for the coordinator, which may come later. Errors: of the options (farm.*) and of the folder.
  static Result<std::unique_ptr<FarmWorker>> start(Engine& engine, JobRunner& runner, const ServerConfig& config);
  ~FarmWorker();
  /// Frames that run are checkpointed and given back, if the coordinator answers.
  void stop();
  /// Why the coordinator does not want this worker, if so: another build, numeric class or token. It is asked again, but seldom.
  Status refused() const;
  bool attends() const { return !link_.id().empty(); }
  const std::string& name() const { return name_; }
  /// Of the frames; null before the first time that it attended.
  const JobWorkerStats* stats() const;

 private:
  FarmWorker(Engine& engine, JobRunner& runner, const ServerConfig& config) : engine_(engine), runner_(runner), config_(config) {}
  void attendLoop();
  Status attendOnce();
  Engine& engine_;
  JobRunner& runner_;
  const ServerConfig config_;
  std::string name_;
  std::unique_ptr<ScratchFolder> ownFolder_;  // null: farm.folder
  FarmLink link_;
  JobFiles files_;
  JobHub hub_;
  std::unique_ptr<RemoteTasks> tasks_;
  std::unique_ptr<RemoteScenes> scenes_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::unique_ptr<JobWorker> worker_;         // under mutex_ until it is made
  Status refused_;                            // under mutex_
  grpc::ClientContext* attending_ = nullptr;  // under mutex_
  bool stopping_ = false;                     // under mutex_
  std::thread thread_;
  Repeating telling_;  // of progress; ends before what it reads
};

}  // namespace gobo::farm
