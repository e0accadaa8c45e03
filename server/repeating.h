// SPDX-License-Identifier: Apache-2.0
// Repeating: a thread that does a thing every so often, until it is destroyed: at once, without waiting for the next time.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace gobo {
inline namespace server {

class Repeating {
 public:
  Repeating() = default;
  ~Repeating();
  Repeating(const Repeating&) = delete;
  Repeating& operator=(const Repeating&) = delete;
  /// The first time `every` from now. Once per object.
  void start(std::chrono::milliseconds every, std::function<void()> act);
  bool started() const { return thread_.joinable(); }
  /// Ends it: when it returns `act` does not run and will not again.
  void stop();

 private:
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace server
}  // namespace gobo
