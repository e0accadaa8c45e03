// SPDX-License-Identifier: Apache-2.0
// Litter: how long files have been of no use, by what this process has seen. A file's own times are of the wall clock: after a jump of it
// a file that was written a moment ago, and whose row is about to be, would look years old. Thread-safe.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "base/file_stamp.h"

namespace gobo {
inline namespace jobs {

class Litter {
 public:
  /// True when the file was seen here first at least `seconds` ago and stat has shown the same ever since. 0: at once.
  bool lain(const std::string& path, double seconds) {
    if (seconds <= 0) return true;
    const FileStamp stamp = FileStamp::of(path);
    const double time = now();
    const std::lock_guard lock(mutex_);
    auto [it, fresh] = seen_.try_emplace(path, Seen{stamp, time, time});
    if (it->second.stamp != stamp) it->second = {stamp, time, time};
    it->second.last = time;
    return time - it->second.first >= seconds;
  }
  /// Forgets what was not asked about for so long: it is gone, or needed again.
  void forget(double seconds) {
    const double time = now();
    const std::lock_guard lock(mutex_);
    std::erase_if(seen_, [&](const auto& s) { return time - s.second.last > seconds; });
  }

  /// Steady seconds; a test's seam.
  std::function<double()> now = [] { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); };

 private:
  struct Seen {
    FileStamp stamp;
    double first, last;
  };
  std::mutex mutex_;
  std::map<std::string, Seen> seen_;
};

}  // namespace jobs
}  // namespace gobo
