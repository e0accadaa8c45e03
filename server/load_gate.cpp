// SPDX-License-Identifier: Apache-2.0
#include "server/load_gate.h"

#include <chrono>
#include <exception>
#include <string>
#include <thread>

namespace gobo {

static constexpr std::chrono::milliseconds kLook{10};   // between two looks at whether a waiter has gone

void LoadGate::setLimit(uint32_t limit) {
  const std::lock_guard lock(mutex_);
  limit_ = limit;
  free_.notify_all();
}

uint32_t LoadGate::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

uint32_t LoadGate::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_;
}

Status LoadGate::run(const std::function<Status(const StopToken&)>& work, const std::function<bool()>& gone) {
  std::unique_lock lock(mutex_);
  if (running_ >= limit_ && waiting_ >= kWaiting)
    return {Code::ResourceExhausted, std::to_string(running_) + " scenes are being loaded (limits.loads_at_once) and " + std::to_string(waiting_) +
            " calls wait for that: at most " + std::to_string(kWaiting)};
  ++waiting_;
  bool left = false;
  while (running_ >= limit_ && !left) {
    if (free_.wait_for(lock, kLook) == std::cv_status::timeout) {
      lock.unlock();
      left = gone();
      lock.lock();
    }
  }
  --waiting_;
  if (left) return {Code::Cancelled, "cancelled while it waited for other loads"};
  ++running_;
  lock.unlock();

  StopSource stop;
  Status status;
  bool over = false;
  std::mutex doneMutex;
  std::condition_variable done;
  std::thread worker([&] {
    Status result;
    try {
      result = work(stop.token());
    } catch (const std::exception& e) {
      result = internalError(std::string("exception in a load: ") + e.what());
    }
    const std::lock_guard hold(doneMutex);
    status = std::move(result);
    over = true;
    done.notify_all();
  });
  {
    std::unique_lock hold(doneMutex);
    while (!over) {
      if (done.wait_for(hold, kLook, [&] { return over; })) break;
      hold.unlock();
      if (gone()) stop.stop(StopReason::Cancelled);
      hold.lock();
    }
  }
  worker.join();
  lock.lock();
  --running_;
  free_.notify_one();
  return status;
}

}  // namespace gobo
