// SPDX-License-Identifier: Apache-2.0
// RefusalPause: how long a refusal is kept back. Who was refused with a hint when to come back and is here before that is answered late, so that
// a loop of refused calls does not take the cores from those who are served. A pure object: no clock, no sleep. Thread-safe.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace gobo {
inline namespace server {

class RefusalPause {
 public:
  static constexpr double kLongest = 0.25;  ///< seconds
  /// `most` calls are held back at once (each holds a thread), half of them of one caller.
  explicit RefusalPause(uint32_t most) : most_(most) {}
  /// `caller` is refused at `now` and told to come back after `hint` seconds. How long to keep the answer; if more than 0, end() comes after it.
  double begin(const std::string& caller, double now, double hint);
  void end(const std::string& caller);
  uint32_t held() const;

 private:
  struct Caller {
    double back = 0;
    uint32_t held = 0;
  };
  const uint32_t most_;
  mutable std::mutex mutex_;
  uint32_t held_ = 0;
  std::map<std::string, Caller> callers_;
};

}  // namespace server
}  // namespace gobo
