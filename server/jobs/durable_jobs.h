// SPDX-License-Identifier: Apache-2.0
// DurableJobs: the job side of one daemon: store, files, scenes, workers, and the thread that expires leases, deadlines and
// results. Made by Server when [jobs] folder is set. Thread-safe but for start() and stop().
#pragma once

#include <memory>

#include "server/config.h"
#include "server/jobs/job_news.h"
#include "server/jobs/job_out.h"
#include "server/jobs/job_scenes.h"
#include "server/jobs/job_store.h"
#include "server/jobs/job_worker.h"
#include "server/jobs/store_looks.h"
#include "server/repeating.h"

namespace gobo {
inline namespace jobs {

class DurableJobs {
 public:
  /// Errors: the folder's or the store's, naming the file.
  static Result<std::unique_ptr<DurableJobs>> start(Engine& engine, JobRunner& runner, const ServerConfig& config);
  ~DurableJobs() { stop(); }
  /// Checkpoints and releases what runs. The store still answers.
  void stop();

  JobStore& store() { return *store_; }
  JobFiles& files() { return files_; }
  const JobOut& out() const { return out_; }
  JobScenes& scenes() { return *scenes_; }
  JobHub& hub() { return hub_; }
  StoreLooks& looks() { return *looks_; }
  const JobWorkerStats& stats() const { return worker_->stats(); }
  /// Keeps an upload for the jobs that may need it: `name` = sha256 + extension.
  Status keepUpload(const std::string& path, const std::string& name) { return files_.adopt(path, files_.scenePath(name)); }
  /// The same for the files of a scene that was opened by their digests; `key` names them.
  Status keepTree(const std::string& folder, const std::string& key) { return files_.adoptTree(folder, files_.scenePath(key)); }

 private:
  DurableJobs() = default;
  void mind();
  void mindResults();
  void mindLive();
  uint64_t keepBytes_ = 0;
  double keepSeconds_ = 0;
  Engine* engine_ = nullptr;
  JobFiles files_;
  JobOut out_;
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<StoreLooks> looks_;
  JobHub hub_;
  std::unique_ptr<JobNews> news_;  // of other daemons
  std::unique_ptr<JobScenes> scenes_;
  std::unique_ptr<CrashMarks> marks_;
  std::unique_ptr<JobWorker> worker_;
  int second_ = 0;  // of the minder
  Repeating minder_;
};

}  // namespace jobs
}  // namespace gobo
