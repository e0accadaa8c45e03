// SPDX-License-Identifier: Apache-2.0
// TaskRun: one claimed frame from claim to report, on its worker's thread. See job_worker.h.
#pragma once

#include "server/encode.h"
#include "server/jobs/job_worker.h"
#include "server/jobs/task_checkpoints.h"
#include "server/repeating.h"

namespace gobo {
inline namespace jobs {

class TaskRun {
 public:
  TaskRun(JobWorker& worker, Lease lease) : w_(worker), lease_(std::move(lease)) {}
  /// False: the frame was given back because this worker cannot have what it needs now, so that taking it again at once would be for nothing.
  bool run();

 private:
  using Clock = std::chrono::steady_clock;
  enum class End { None, Release, Lost };
  Status render(std::vector<EncodedImage>& images);  // Ok, or why not; end() tells what was asked meanwhile
  Status renderPicture(const v1::RenderRequest& request);
  Status joinFrame(const std::vector<v1::FrameFile>& parts);  // of a frame whose parts are done
  Status inSlot(uint64_t bytes, const std::function<Status(StopToken)>& body);
  Status work(StopToken slot, const PreparedRender& prepared);
  bool tick();        // true: take the frame out of the scheduler
  void renewIfDue();  // on the keeper's thread, whatever the frame is at: loading its scene, rendering, encoding, sending files
  void steer(const Result<v1::Job::State>& state);
  void ask(End end);
  End end() const { return end_.load(); }
  void flush();
  Status report(const char* what, const std::function<Status()>& attempt);
  Status deliver(const std::vector<EncodedImage>& images);
  void finish(const Status& status);

  JobWorker& w_;
  Lease lease_;
  JobRecord record_;
  TaskPlace place_;
  std::vector<v1::FrameFile> parts_;  // what the frame is put together from
  std::shared_ptr<const Scene> scene_;
  std::unique_ptr<TaskCheckpoints> checkpoints_;
  std::optional<RenderResult> result_;
  std::atomic<End> end_{End::None};
  std::atomic<bool> inSlot_{false};
  std::mutex mutex_;                 // inner_
  std::optional<StopSource> inner_;  // of the render that goes on
  std::atomic<double> progress_{0};
  std::atomic<uint32_t> spp_{0};
  uint64_t control_ = 0;
  double storedProgress_ = 0, shown_ = -1;
  Clock::time_point lastCheckpoint_ = Clock::now(), begun_ = Clock::now();
  bool sceneFault_ = false;
  bool wanting_ = false;            // what run() answers with
  bool inputFault_ = false;         // of files that this daemon reads: another try is one of the frame's, or one that nobody can read would be tried for ever
  double checkpointSeconds_ = 0;    // what gap_ was made of
  std::atomic<double> gap_{0};      // seconds between checkpoints
  Clock::time_point flushAfter_{};  // a failed write is tried again then
  double ranSeconds_ = 0;
  Clock::time_point nextRenew_;  // the keeper's
  Repeating keeper_;             // the last member: it ends first
};

}  // namespace jobs
}  // namespace gobo
