// SPDX-License-Identifier: Apache-2.0
// TaskCheckpoints: the states of one running frame's extendable nodes, in memory for the render and in files for the next daemon.
// load() and save() are the render's (its thread holds the cores: they only keep pointers, but for the first load after a restart);
// flush() is the worker's, while the render goes on. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>

#include "plan/checkpoints.h"
#include "server/jobs/job_files.h"

namespace gobo {
inline namespace jobs {

class TaskCheckpoints final : public RenderCheckpoints {
 public:
  using Clock = std::chrono::steady_clock;
  /// `rows`: what the store has. Files of them that are missing or damaged count as not there.
  TaskCheckpoints(TaskStore& store, JobFiles& files, const Lease& lease, std::vector<CheckpointRow> rows);

  TermPtr load(const Hash128& recipe, uint32_t blocks) override;
  void save(const Hash128& recipe, uint32_t blocks, TermPtr state) override;

  /// An extendable node has run since then; nothing when none does. Reset before each start of the render.
  std::optional<Clock::time_point> activeSince() const;
  /// Whether the node that ran last has left what it had; of one that has not the next run begins anew.
  bool kept() const;
  void begin();
  bool pending() const;
  /// Mean samples per pixel of the state that has most.
  double samples() const;
  /// Writes what was saved since the last time and records it. FailedPrecondition: the lease is lost. Other errors: it stays pending.
  Status flush(double progress, uint32_t spp);
  /// The frame is over, one way or another: its files go.
  void drop();
  uint64_t resumed() const { return resumed_; }  ///< states taken from files
  uint64_t written() const { return written_; }

 private:
  struct State {
    uint32_t blocks = 0;
    TermPtr term;
    bool written = false;
  };
  TaskStore& store_;
  JobFiles& files_;
  const Lease lease_;
  mutable std::mutex mutex_;
  std::map<std::string, CheckpointRow> rows_;
  std::map<Hash128, State> states_;
  std::optional<Clock::time_point> active_;
  bool kept_ = true;
  std::atomic<uint64_t> resumed_{0}, written_{0};
};

}  // namespace jobs
}  // namespace gobo
