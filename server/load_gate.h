// SPDX-License-Identifier: Apache-2.0
// LoadGate: bounds how many scenes are loaded or patched at once, and lets a client that has gone stop its load between phases.
// Places go to the client that has the fewest loads now, then to the one served longest ago, then by arrival; the last place is not
// for a client that has one already, so that nobody's slow files keep everybody out. The work runs on a thread of its own while the
// handler's watches the client. Thread-safe.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/status.h"
#include "base/stop.h"
#include "server/fair_gate.h"

namespace gobo {
inline namespace server {

class LoadGate {
 public:
  void setLimit(uint32_t limit);
  /// Waits for a place, then runs `work` and returns when it has returned. `gone` is asked every 10 ms, waiting or running; once it
  /// says true the token says Cancelled. Work that never got a place: Cancelled when the caller has gone, ResourceExhausted when
  /// kWaiting callers, or kWaitingOfOne of this client, wait already. An exception that leaves the work becomes Internal.
  Status run(const std::string& client, const std::function<Status(const StopToken&)>& work, const std::function<bool()>& gone);
  uint32_t running() const { return gate_.running(); }
  uint32_t waiting() const { return gate_.waiting(); }
  static constexpr uint32_t kWaiting = 32, kWaitingOfOne = 16;

 private:
  FairGate gate_;
};

}  // namespace server
}  // namespace gobo
