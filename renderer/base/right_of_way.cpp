// SPDX-License-Identifier: Apache-2.0
#include "base/right_of_way.h"

#include <algorithm>

namespace gobo {
inline namespace base {

RightOfWay::Taken::Taken(RightOfWay* way) : way_(way) {
  if (way_) ++way_->taken_;
}

RightOfWay::Taken::~Taken() {
  if (!way_ || --way_->taken_ > 0) return;
  { const std::lock_guard lock(way_->mutex_); }  // nobody is between its look and its wait
  way_->free_.notify_all();
}

void RightOfWay::settle(Clock::time_point now) {
  const auto passed = now - settled_;
  credit_ = std::clamp(credit_ + (waiting_ > 0 ? -passed : passed), Clock::duration::zero(), most_);
  settled_ = now;
}

RightOfWay::Clock::duration RightOfWay::credit() {
  const std::lock_guard lock(mutex_);
  settle(Clock::now());
  return credit_;
}

void RightOfWay::wait(const StopToken& stop) {
  constexpr std::chrono::milliseconds kPoll{5};
  std::unique_lock lock(mutex_);
  settle(Clock::now());
  ++waiting_;
  while (taken_.load() > 0 && credit_ > Clock::duration::zero() && !stop.stopRequested()) {
    free_.wait_for(lock, std::min<Clock::duration>(kPoll, credit_));
    settle(Clock::now());
  }
  --waiting_;
}

}  // namespace base
}  // namespace gobo
