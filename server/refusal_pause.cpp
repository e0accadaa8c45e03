// SPDX-License-Identifier: Apache-2.0
#include "server/refusal_pause.h"

#include <algorithm>

namespace gobo {
inline namespace server {

double RefusalPause::begin(const std::string& caller, double now, double hint) {
  constexpr size_t kRemembered = 4096;  // names may be made up
  const std::lock_guard lock(mutex_);
  if (callers_.size() >= kRemembered) std::erase_if(callers_, [&](const auto& c) { return c.second.held == 0 && c.second.back <= now; });
  if (callers_.size() >= kRemembered && !callers_.count(caller)) return 0;
  Caller& c = callers_[caller];
  const bool early = now < c.back;
  c.back = std::max(c.back, now + hint);
  if (!early || held_ >= most_ || c.held >= std::max(1u, most_ / 2)) return 0;
  ++held_;
  ++c.held;
  return std::min(hint, kLongest);
}

void RefusalPause::end(const std::string& caller) {
  const std::lock_guard lock(mutex_);
  --held_;
  --callers_[caller].held;
}

uint32_t RefusalPause::held() const {
  const std::lock_guard lock(mutex_);
  return held_;
}

}  // namespace server
}  // namespace gobo
