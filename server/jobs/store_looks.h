// SPDX-License-Identifier: Apache-2.0
// StoreLooks: one question to the store for all streams that wait for news of jobs. Hundreds may, each several times a second, and most of the
// time nothing has changed. Thread-safe.
#pragma once

#include <chrono>
#include <mutex>
#include <string>

#include "server/jobs/job_store.h"

namespace gobo {
inline namespace jobs {

class StoreLooks {
 public:
  explicit StoreLooks(JobStore& store) : store_(store) {}

  /// A number that is another one once the store has changed since it was told. What this daemon changed is in it when `version`, of its hub
  /// (JobHub::version), was taken after; what others did at most kEvery seconds later. A store that does not answer has changed: who reads it says why.
  uint64_t number(uint64_t version);

  static constexpr double kEvery = 0.1;

 private:
  JobStore& store_;
  std::mutex mutex_;
  std::string edition_;
  uint64_t number_ = 0, asked_ = 0;  // asked_: the hub's version, at the last question
  std::chrono::steady_clock::time_point next_{};
};

}  // namespace jobs
}  // namespace gobo
