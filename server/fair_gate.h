// SPDX-License-Identifier: Apache-2.0
// FairGate: how many do a thing at once, shared by client. Places go to the client that has the fewest now, then to the one served longest
// ago, then by arrival. A client that has none may take any free place; further ones only while fewer than `shared` are taken, so that
// nobody's crowd keeps everybody else out. Thread-safe.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

namespace gobo {
inline namespace server {

class FairGate {
 public:
  struct Limits {
    uint32_t places = 1, shared = 1;
  };
  struct Queue {
    size_t waiting = 0, ofClient = 0;
    uint32_t running = 0;
    bool free = false;  ///< there is a place for this client now: it would not wait
  };
  FairGate() = default;
  explicit FairGate(Limits limits) : limits_(limits) {}
  void setLimits(Limits limits);

  /// A place; given back by its destructor. Must not outlive its gate.
  class Place {
   public:
    Place(FairGate& gate, std::string client) : gate_(&gate), client_(std::move(client)) {}
    Place(Place&& other) noexcept : gate_(std::exchange(other.gate_, nullptr)), client_(std::move(other.client_)) {}
    Place& operator=(Place&&) = delete;
    ~Place() {
      if (gate_) gate_->leave(client_);
    }

   private:
    FairGate* gate_;
    std::string client_;
  };
  /// Waits for a place. None when `refuse` says so of the queue that it would join, or when `gone`, asked every 10 ms, does.
  std::optional<Place> enter(const std::string& client, const std::function<bool()>& gone, const std::function<bool(const Queue&)>& refuse = {});
  uint32_t running() const;
  uint32_t waiting() const;

 private:
  struct Waiter {
    std::string client;
    bool called = false;
  };
  struct Client {
    uint32_t running = 0, waiting = 0;
    uint64_t served = 0;
  };            ///< served: when it was last called, in calls
  void call();  ///< under mutex_: gives free places away
  void leave(const std::string& client);
  void forget(const std::string& client);
  mutable std::mutex mutex_;
  std::condition_variable free_;
  Limits limits_;
  uint32_t running_ = 0;
  std::list<Waiter> waiters_;  ///< in order of arrival
  std::map<std::string, Client> clients_;
  uint64_t calls_ = 0;
};

}  // namespace server
}  // namespace gobo
