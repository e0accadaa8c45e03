// SPDX-License-Identifier: Apache-2.0
// RightOfWay: short work has the cores while it runs; long work that shares them steps aside between its pieces. A system that divides the
// cores among more threads than it has of them makes the short work take two to three times as long, and the long work hardly faster.
// Long work stands still for at most half of the time, and `most` at a stretch: what never ends is not short. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>

#include "base/stop.h"

namespace gobo {
inline namespace base {

class RightOfWay {
 public:
  using Clock = std::chrono::steady_clock;
  explicit RightOfWay(Clock::duration most = std::chrono::milliseconds(100)) : most_(most), credit_(most) {}

  /// Has the way from construction to destruction. Must not wait for long work meanwhile.
  class Taken {
   public:
    explicit Taken(RightOfWay* way);
    ~Taken();
    Taken(const Taken&) = delete;
    Taken& operator=(const Taken&) = delete;

   private:
    RightOfWay* way_;
  };

  /// Returns once nobody has the way, what may be waited is used up, or `stop` fires (looked at every few milliseconds). A load where nobody has it.
  void stepAside(const StopToken& stop) {
    if (taken_.load(std::memory_order_relaxed) > 0) wait(stop);
  }
  /// What may be waited now.
  Clock::duration credit();

 private:
  void wait(const StopToken& stop);
  void settle(Clock::time_point now);  // mutex_ held

  const Clock::duration most_;
  std::atomic<int> taken_{0};
  std::mutex mutex_;
  std::condition_variable free_;
  int waiting_ = 0;
  Clock::duration credit_;  // falls while somebody waits, grows else
  Clock::time_point settled_ = Clock::now();
};

}  // namespace base
}  // namespace gobo
