// SPDX-License-Identifier: Apache-2.0
#include "server/load_gate.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <thread>

namespace gobo {
inline namespace server {

static constexpr std::chrono::milliseconds kGoneEvery{10};  // between two looks at whether the caller has gone

// The last place is for a client that has none.
void LoadGate::setLimit(uint32_t limit) { gate_.setLimits({limit, limit > 0 ? limit - 1 : 0}); }

Status LoadGate::run(const std::string& client, const std::function<Status(const StopToken&)>& work, const std::function<bool()>& gone) {
  Status refused(Code::Cancelled, "cancelled while it waited for other loads");
  const auto place = gate_.enter(client, gone, [&](const FairGate::Queue& queue) {
    if (queue.waiting < kWaiting && queue.ofClient < kWaitingOfOne) return false;
    refused = {Code::ResourceExhausted, std::to_string(queue.running) + " scenes are being loaded (limits.loads_at_once) and " + std::to_string(queue.waiting) +
                                            " calls wait for that, " + std::to_string(queue.ofClient) + " of them of \"" + client + "\": at most " +
                                            std::to_string(kWaiting) + ", " + std::to_string(kWaitingOfOne) + " of one client"};
    return true;
  });
  if (!place) return refused;

  StopSource stop;
  Status status;
  bool over = false;
  std::mutex doneMutex;
  std::condition_variable done;
  std::thread worker([&] {
    Status result;
    try {
      result = work(stop.token());
    } catch (const std::exception& e) { result = internalError(std::string("exception in a load: ") + e.what()); }
    const std::lock_guard hold(doneMutex);
    status = std::move(result);
    over = true;
    done.notify_all();
  });
  {
    std::unique_lock hold(doneMutex);
    while (!over) {
      if (done.wait_for(hold, kGoneEvery, [&] { return over; })) break;
      hold.unlock();
      if (gone()) stop.stop(StopReason::Cancelled);
      hold.lock();
    }
  }
  worker.join();
  return status;
}

}  // namespace server
}  // namespace gobo
