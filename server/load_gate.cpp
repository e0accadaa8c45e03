// SPDX-License-Identifier: Apache-2.0
#include "server/load_gate.h"

#include <chrono>
#include <exception>
#include <string>
#include <thread>
#include <tuple>

namespace gobo {

static constexpr std::chrono::milliseconds kLook{10};   // between two looks at whether a waiter has gone

void LoadGate::setLimit(uint32_t limit) {
  const std::lock_guard lock(mutex_);
  limit_ = limit;
  call();
}

uint32_t LoadGate::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

uint32_t LoadGate::waiting() const {
  const std::lock_guard lock(mutex_);
  return uint32_t(waiters_.size());
}

void LoadGate::call() {
  while (running_ < limit_) {
    Waiter* best = nullptr;
    for (Waiter& w : waiters_) {
      const Client& c = clients_[w.client];
      if (w.called || (c.running > 0 && running_ + 1 >= limit_)) continue;
      if (best) {
        const Client& b = clients_[best->client];
        if (std::tuple(c.running, c.served) >= std::tuple(b.running, b.served)) continue;
      }
      best = &w;
    }
    if (!best) break;
    Client& c = clients_[best->client];
    best->called = true;
    c.served = ++calls_;
    ++c.running;
    ++running_;
  }
  free_.notify_all();
}

void LoadGate::forget(const std::string& client) {
  const auto at = clients_.find(client);
  if (at->second.running == 0 && at->second.waiting == 0) clients_.erase(at);
}

Status LoadGate::run(const std::string& client, const std::function<Status(const StopToken&)>& work, const std::function<bool()>& gone) {
  std::unique_lock lock(mutex_);
  const auto mine = clients_.find(client);
  const uint32_t ofMine = mine == clients_.end() ? 0 : mine->second.waiting;
  if (waiters_.size() >= kWaiting || ofMine >= kWaitingOfOne)
    return {Code::ResourceExhausted, std::to_string(running_) + " scenes are being loaded (limits.loads_at_once) and " + std::to_string(waiters_.size()) +
            " calls wait for that, " + std::to_string(ofMine) + " of them of \"" + client + "\": at most " + std::to_string(kWaiting) + ", " +
            std::to_string(kWaitingOfOne) + " of one client"};
  const auto place = waiters_.insert(waiters_.end(), {client, false});
  ++clients_[client].waiting;
  call();
  bool left = false;
  while (!place->called && !left) {
    if (free_.wait_for(lock, kLook) == std::cv_status::timeout && !place->called) {
      lock.unlock();
      left = gone();
      lock.lock();
    }
  }
  const bool called = place->called;
  waiters_.erase(place);
  --clients_[client].waiting;
  if (!called) {
    forget(client);
    return {Code::Cancelled, "cancelled while it waited for other loads"};
  }
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
  --clients_[client].running;
  forget(client);
  call();
  return status;
}

}  // namespace gobo
