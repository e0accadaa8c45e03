// SPDX-License-Identifier: Apache-2.0
#include "server/repeating.h"

namespace gobo {
inline namespace server {

Repeating::~Repeating() { stop(); }

void Repeating::start(std::chrono::milliseconds every, std::function<void()> act) {
  thread_ = std::thread([this, every, act = std::move(act)] {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, every, [this] { return ending_; })) {
      lock.unlock();
      act();
      lock.lock();
    }
  });
}

void Repeating::stop() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

}  // namespace server
}  // namespace gobo
