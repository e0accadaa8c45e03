// SPDX-License-Identifier: Apache-2.0
// DeviceProbe: what this machine can render on, for `status`. The processor is known at once; drivers (Vulkan, EGL) are loaded
// on a thread of their own when somebody asks for the first time, never at the start: Mesa's take 0.1 s and more. Thread-safe.
#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace gobo {
inline namespace server {

class DeviceProbe {
 public:
  DeviceProbe();
  ~DeviceProbe();  ///< waits for the probing thread: a driver must not be left half loaded at exit
  /// "cpu: NAME (avx2 fma)", "vulkan: NAME", "egl: NAME", or "vulkan: none (why)". Starts the probe; waits for it up to `waitSeconds`,
  /// then says "...: being looked for" of what is not known yet.
  std::vector<std::string> list(double waitSeconds);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::string cpu_, vulkan_, egl_;
  std::thread thread_;
};

}  // namespace server
}  // namespace gobo
