// SPDX-License-Identifier: Apache-2.0
#include "plan/planner.h"

namespace gobo {
inline namespace plan {

EnvironmentPtr LastSky::find(const std::string& settings) const {
  std::lock_guard lock(mutex_);
  return map_ && settings_ == settings ? map_ : nullptr;
}

void LastSky::keep(const std::string& settings, EnvironmentPtr map) {
  std::lock_guard lock(mutex_);
  settings_ = settings;
  map_ = std::move(map);
}

uint64_t LastSky::bytes() const {
  std::lock_guard lock(mutex_);
  return map_ ? map_->texels.size() * sizeof(Vec3) : 0;
}

}  // namespace plan
}  // namespace gobo
