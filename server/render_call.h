// SPDX-License-Identifier: Apache-2.0
// RenderCall: one render request on its way through the job runner, on a thread of its own, so that the thread which talks
// to the client can notice within milliseconds that the client has gone, and a slow client never holds the cores.
// Events wait in a mailbox of the latest progress and the latest snapshot: a client slower than the render skips snapshots,
// except for the first one, which is always delivered. One consumer thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "server/core.h"

namespace gobo {
inline namespace server {

struct RenderCallOptions {
  std::string client;  ///< for fair share
  std::string owner;   ///< of the reply's render id (Rpc::renderOwner)
  std::optional<std::chrono::steady_clock::time_point> deadline;
  SceneAccess access;   ///< to the scene
  bool events = false;  ///< progress and snapshots wanted
  std::string payer;    ///< whose part of ServerCore::replies it takes, from the first run to its end
  uint64_t replyBytes = 0;
  double encodeMs = 0;          ///< that its picture is expected to take once it is made, of halt.time_s
  std::string environmentFile;  ///< see PreparedRender
};

JobClass jobClassOf(v1::Scheduling::Class priority);

class RenderCall {
 public:
  /// `request` has been resolved (its ranges are checked). It is planned first, for admission's count of bytes; that ends with
  /// the deadline as well.
  RenderCall(ServerCore& core, StopSource stop, v1::RenderRequest request, RenderCallOptions options);
  /// Cancels and joins.
  ~RenderCall();

  struct News {
    std::optional<v1::Progress> progress;
    std::optional<RenderResult> snapshot;
    bool done = false;
  };
  /// Returns at the first news or after `timeout`. Snapshots come before done.
  News wait(std::chrono::milliseconds timeout);
  void cancel() { stop_.stop(StopReason::Cancelled); }
  /// In the queue (of plans or of renders), planned or running, or nothing once it is over.
  std::optional<Place> place();

  /// After done. The result is there when the status is ok; queue_ms and total_ms are filled in.
  const Status& status() const { return status_; }
  RenderResult& result() { return *result_; }
  double queueMs() const { return queueMs_; }
  double ranMs() const { return ranMs_; }    ///< in a slot, all runs
  int runs() const { return runs_; }         ///< more than one: it was preempted
  bool planned() const { return planned_; }  ///< false: the status says why it could not be
  double retryAfterMs() const { return retryAfterMs_; }
  bool replyRefused() const { return replyRefused_; }  ///< there was no room for its pictures

 private:
  void work();
  ServerCore& core_;
  StopSource stop_;
  const v1::RenderRequest request_;
  const RenderCallOptions options_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<v1::Progress> progress_;
  std::optional<JobId> job_;  // once it is in the scheduler
  std::deque<RenderResult> snapshots_;
  bool firstTaken_ = false;
  bool planning_ = false, planned_ = false, done_ = false;
  Status status_;
  std::optional<RenderResult> result_;
  double queueMs_ = 0, ranMs_ = 0;
  int runs_ = 0;
  double retryAfterMs_ = 0;
  bool replyRefused_ = false;
  std::unique_ptr<SharedLimit::Hold> reply_;
  std::thread thread_;
};

}  // namespace server
}  // namespace gobo
