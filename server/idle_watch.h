// SPDX-License-Identifier: Apache-2.0
// IdleWatch: ends calls whose client neither sends what it announced nor takes what it asked for. A blocking Read or Write of a
// synchronous handler has no time-out of its own: a silent client would hold the handler's thread, its slot and its picture for ever.
// One thread for all calls. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <list>
#include <mutex>

#include <grpcpp/grpcpp.h>

#include "server/repeating.h"

namespace gobo {
inline namespace server {

class IdleWatch {
 public:
  explicit IdleWatch(double seconds) : seconds_(seconds) {}
  /// For waits that begin from now on.
  void setSeconds(double seconds) { seconds_.store(seconds); }
  double seconds() const { return seconds_.load(); }
  uint64_t ended() const { return ended_.load(); }  ///< calls

  /// Around one blocking read or write: when it lasts too long its call is cancelled, and the read or write returns false.
  class Wait {
   public:
    Wait(IdleWatch& watch, grpc::ServerContext& context);
    ~Wait();
    Wait(const Wait&) = delete;
    Wait& operator=(const Wait&) = delete;

   private:
    IdleWatch& watch_;
    std::list<std::pair<std::chrono::steady_clock::time_point, grpc::ServerContext*>>::iterator at_;
  };

 private:
  using Waits = std::list<std::pair<std::chrono::steady_clock::time_point, grpc::ServerContext*>>;
  void look();
  std::atomic<double> seconds_;
  std::atomic<uint64_t> ended_{0};
  std::mutex mutex_;
  Waits waits_;
  Repeating looking_;  // from the first wait; last: it ends before what it looks at
};

}  // namespace server
}  // namespace gobo
