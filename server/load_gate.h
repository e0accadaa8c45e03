// SPDX-License-Identifier: Apache-2.0
// LoadGate: bounds how many scenes are loaded or patched at once, and lets a client that has gone stop its load between phases.
// The work runs on a thread of its own while the handler's watches the client. Thread-safe.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>

#include "base/status.h"
#include "base/stop.h"

namespace gobo {

class LoadGate {
 public:
  void setLimit(uint32_t limit);
  /// Waits for a place, then runs `work` and returns when it has returned. `gone` is asked every 10 ms, waiting or running; once it
  /// says true the token says Cancelled. Work that never got a place: Cancelled when the caller has gone, ResourceExhausted when
  /// kWaiting callers wait already. An exception that leaves the work becomes Internal.
  Status run(const std::function<Status(const StopToken&)>& work, const std::function<bool()>& gone);
  uint32_t running() const;
  uint32_t waiting() const;
  static constexpr uint32_t kWaiting = 32;

 private:
  mutable std::mutex mutex_;
  std::condition_variable free_;
  uint32_t limit_ = 1, running_ = 0, waiting_ = 0;
};

}  // namespace gobo
