// SPDX-License-Identifier: Apache-2.0
// StopToken: how running work learns that it must leave the cores. Nodes poll it at least every 10 ms.
// The flag is a relaxed atomic: polling it costs a load. One StopSource per request; tokens are copies that share it.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>

namespace gobo {
inline namespace base {

enum class StopReason : int { None = 0, Cancelled, Deadline, Preempted, TimeUp };

class StopToken {
 public:
  using Clock = std::chrono::steady_clock;
  StopToken() = default;  ///< never stops
  bool stopRequested() const { return set(flag_) || set(outer_) || (limited_ && Clock::now() >= limit_); }
  StopReason reason() const {
    for (const Flag& flag : {outer_, flag_})
      if (flag && flag->load(std::memory_order_relaxed) > 0) return StopReason(flag->load(std::memory_order_relaxed));
    return limited_ && Clock::now() >= limit_ ? StopReason::TimeUp : StopReason::None;
  }
  /// The same that also stops at `limit` (TimeUp), without a thread that watches the clock: a poll reads it, 25 ns.
  StopToken until(Clock::time_point limit) const {
    StopToken token = *this;
    token.limit_ = limited_ ? std::min(limit, limit_) : limit;
    token.limited_ = true;
    return token;
  }

 private:
  friend class StopSource;
  using Flag = std::shared_ptr<std::atomic<int>>;
  explicit StopToken(Flag flag, Flag outer) : flag_(std::move(flag)), outer_(std::move(outer)) {}
  static bool set(const Flag& flag) {
    const int v = flag ? flag->load(std::memory_order_relaxed) : 0;
    return v != 0 && (v > 0 || countDown(*flag));
  }
  static bool countDown(std::atomic<int>& flag) {  // StopSource::stopAtPoll
    int v = flag.load();
    while (v < 0)
      if (flag.compare_exchange_weak(v, v == -1 ? int(StopReason::Cancelled) : v + 1)) return v == -1;
    return v > 0;
  }
  Flag flag_, outer_;
  Clock::time_point limit_{};
  bool limited_ = false;
};

class StopSource {
 public:
  StopSource() : flag_(std::make_shared<std::atomic<int>>(0)) {}
  /// Its tokens stop with `outer` as well, whose reason goes first. (`outer` must not have an outer one itself, or a limit: they are lost.)
  explicit StopSource(const StopToken& outer) : StopSource() { outer_ = outer.flag_; }
  StopToken token() const { return StopToken(flag_, outer_); }
  /// The first reason wins, but for Cancelled, which overrides Preempted (a cancelled job must not be resumed).
  void stop(StopReason reason) {
    int v = flag_->load();
    while (v <= 0 || reason == StopReason::Cancelled)
      if (flag_->compare_exchange_weak(v, int(reason))) return;
  }
  /// Its tokens stop (Cancelled) at the n-th poll from now: so that tests end work at chosen places, whatever the clock says.
  void stopAtPoll(int n) { flag_->store(-n); }
  int pollsLeft() const { return -flag_->load(); }  ///< of stopAtPoll
  void reset() { flag_->store(0); }

 private:
  std::shared_ptr<std::atomic<int>> flag_, outer_;
};

}  // namespace base
}  // namespace gobo
