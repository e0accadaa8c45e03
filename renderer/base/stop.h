// SPDX-License-Identifier: Apache-2.0
// StopToken: how running work learns that it must leave the cores. Nodes poll it at least every 10 ms.
// The flag is a relaxed atomic: polling it costs a load. One StopSource per request; tokens are copies that share it.
#pragma once

#include <atomic>
#include <memory>

namespace gobo {

enum class StopReason : int { None = 0, Cancelled, Deadline, Preempted };

class StopToken {
 public:
  StopToken() = default;  ///< never stops
  bool stopRequested() const { return flag_ && flag_->load(std::memory_order_relaxed) != 0; }
  StopReason reason() const { return flag_ ? StopReason(flag_->load(std::memory_order_relaxed)) : StopReason::None; }

 private:
  friend class StopSource;
  explicit StopToken(std::shared_ptr<std::atomic<int>> flag) : flag_(std::move(flag)) {}
  std::shared_ptr<std::atomic<int>> flag_;
};

class StopSource {
 public:
  StopSource() : flag_(std::make_shared<std::atomic<int>>(0)) {}
  StopToken token() const { return StopToken(flag_); }
  /// The first reason wins, but for Cancelled, which overrides Preempted (a cancelled job must not be resumed).
  void stop(StopReason reason) {
    int none = 0;
    if (!flag_->compare_exchange_strong(none, int(reason)) && reason == StopReason::Cancelled) flag_->store(int(reason));
  }
  void reset() { flag_->store(0); }

 private:
  std::shared_ptr<std::atomic<int>> flag_;
};

}  // namespace gobo
