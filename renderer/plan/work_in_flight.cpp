// SPDX-License-Identifier: Apache-2.0
#include "plan/work_in_flight.h"

#include <chrono>

namespace gobo {
inline namespace plan {

Result<WorkInFlight::Turn> WorkInFlight::take(const Hash128& recipe, uint32_t blocks, const StopToken& stop) {
  constexpr auto kLook = std::chrono::milliseconds(5);  // at the stop token
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto at = running_.find(recipe);
    // The largest that is not larger: what it leaves saves most.
    const auto next = at == running_.end() ? std::map<uint32_t, WorkPtr>::iterator{} : at->second.upper_bound(blocks);
    if (at == running_.end() || next == at->second.begin()) break;
    const auto [count, work] = *std::prev(next);
    ++work->waiting;
    while (!work->over && !stop.stopRequested()) changed_.wait_for(lock, kLook);
    --work->waiting;
    if (!work->over) return Status(Code::Cancelled, "stopped");
    if (work->result && count == blocks) {
      ++shared_;
      return Turn(work->result);
    }
  }
  auto work = std::make_shared<Work>();
  running_[recipe][blocks] = work;
  return Turn(this, recipe, blocks, std::move(work));
}

uint64_t WorkInFlight::ended() const {
  const std::lock_guard lock(mutex_);
  return ended_;
}

uint64_t WorkInFlight::shared() const {
  const std::lock_guard lock(mutex_);
  return shared_;
}

WorkInFlight::Turn::~Turn() {
  if (!all_) return;
  const std::lock_guard lock(all_->mutex_);
  work_->over = true;
  ++all_->ended_;
  const auto at = all_->running_.find(recipe_);
  at->second.erase(blocks_);
  if (at->second.empty()) all_->running_.erase(at);
  all_->changed_.notify_all();
}

bool WorkInFlight::Turn::wanted() const {
  if (!all_) return false;
  const std::lock_guard lock(all_->mutex_);
  return work_->waiting > 0;
}

void WorkInFlight::Turn::finish(TermPtr term) {
  if (!all_) return;
  const std::lock_guard lock(all_->mutex_);
  work_->result = std::move(term);
}

}  // namespace plan
}  // namespace gobo
