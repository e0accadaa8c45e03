// SPDX-License-Identifier: Apache-2.0
#include "server/fair_gate.h"

#include <chrono>
#include <tuple>

namespace gobo {
inline namespace server {

static constexpr std::chrono::milliseconds kLeftEvery{10};  // between two looks at whether a waiter has gone

void FairGate::setLimits(Limits limits) {
  const std::lock_guard lock(mutex_);
  limits_ = limits;
  call();
}

uint32_t FairGate::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

uint32_t FairGate::waiting() const {
  const std::lock_guard lock(mutex_);
  return uint32_t(waiters_.size());
}

void FairGate::call() {
  while (running_ < limits_.places) {
    Waiter* best = nullptr;
    for (Waiter& w : waiters_) {
      const Client& c = clients_[w.client];
      if (w.called || (c.running > 0 && running_ >= limits_.shared)) continue;
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

void FairGate::forget(const std::string& client) {
  const auto at = clients_.find(client);
  if (at->second.running == 0 && at->second.waiting == 0) clients_.erase(at);
}

void FairGate::leave(const std::string& client) {
  const std::lock_guard lock(mutex_);
  --running_;
  --clients_[client].running;
  forget(client);
  call();
}

std::optional<FairGate::Place> FairGate::enter(const std::string& client, const std::function<bool()>& gone, const std::function<bool(const Queue&)>& refuse) {
  std::unique_lock lock(mutex_);
  const auto mine = clients_.find(client);
  const Client me = mine == clients_.end() ? Client() : mine->second;
  // Whoever waits beside a free place may not take it (call()), so nobody is before this one there.
  const bool free = running_ < limits_.places && (me.running == 0 || running_ < limits_.shared);
  if (refuse && refuse({waiters_.size(), me.waiting, running_, free})) return std::nullopt;
  const auto waiter = waiters_.insert(waiters_.end(), {client, false});
  ++clients_[client].waiting;
  call();
  bool left = false;
  while (!waiter->called && !left) {
    if (free_.wait_for(lock, kLeftEvery) == std::cv_status::timeout && !waiter->called) {
      lock.unlock();
      left = gone();
      lock.lock();
    }
  }
  const bool called = waiter->called;
  waiters_.erase(waiter);
  --clients_[client].waiting;
  if (called) return Place(*this, client);
  forget(client);
  return std::nullopt;
}

}  // namespace server
}  // namespace gobo
