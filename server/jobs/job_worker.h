// SPDX-License-Identifier: Apache-2.0
// JobWorker: threads that claim frames, render them as batch work of the daemon's scheduler, and report. Each frame's own thread
// waits outside the slot: it renews the lease, writes checkpoints while the render goes on, and notices cancel, pause and lost
// leases; so neither disk nor store ever holds the cores. A checkpoint is asked for by preempting the frame for a moment.
// A finished frame is reported until the store has acknowledged it or said that the lease is over. Who gives one back because the scene cannot be had now
// (of a coordinator, say) waits longer each time before the next claim.
#pragma once

#include <atomic>
#include <functional>
#include <thread>
#include <vector>

#include "plan/display_transforms.h"
#include "server/job_runner.h"
#include "server/jobs/crash_marks.h"
#include "server/jobs/job_files.h"
#include "server/jobs/job_hub.h"
#include "server/jobs/job_out.h"
#include "server/jobs/task_scenes.h"

namespace gobo {
inline namespace jobs {

struct JobWorkerOptions {
  std::shared_ptr<DisplayTransforms> displays;  ///< of the engine's config: frames put together from parts are shown by it; may be null
  int workers = 1;
  double leaseSeconds = 30;
  double checkpointSeconds = 30;  ///< between checkpoints of a frame; more when writing one takes over a twentieth of it
  std::string holder;             ///< names this process in the store
  double pollSeconds = 0.5;       ///< between claims when nothing was ready: other processes submit too, and retries become ready
  CrashMarks* marks = nullptr;    ///< may be null
  const JobOut* out = nullptr;    ///< null elsewhere than beside the store: the daemon that has it writes the files
  /// Told of a frame's files before they are written; may be empty.
  std::function<void(const Lease& lease, const std::vector<v1::FrameFile>& files)> delivers;
};

struct JobWorkerStats {
  std::atomic<uint64_t> frames{0}, failures{0}, lost{0}, checkpoints{0}, resumed{0}, repeatedReports{0};
};

class JobWorker {
 public:
  JobWorker(Engine& engine, JobRunner& runner, TaskStore& store, JobFiles& files, TaskScenes& scenes, JobHub& hub, const JobWorkerOptions& options);
  ~JobWorker() { stop(); }
  /// Frames that run are checkpointed and released; returns when all threads are out.
  void stop();
  /// From now on, frames that run among them: a coordinator that was started again may have been given other times.
  void setTimes(double leaseSeconds, double checkpointSeconds);
  const JobWorkerStats& stats() const { return stats_; }

 private:
  friend class TaskRun;
  void loop(int number);
  void rest(double seconds, uint64_t& seen);  // as long as nobody stops this worker
  Engine& engine_;
  JobRunner& runner_;
  TaskStore& store_;
  JobFiles& files_;
  TaskScenes& scenes_;
  JobHub& hub_;
  const JobWorkerOptions options_;
  std::atomic<double> leaseSeconds_, checkpointSeconds_;  // what those of options_ have become
  JobWorkerStats stats_;
  std::atomic<bool> stopping_{false};
  std::vector<std::thread> threads_;
};

}  // namespace jobs
}  // namespace gobo
