// SPDX-License-Identifier: Apache-2.0
#include "server/rest_estimate.h"

#include <algorithm>

namespace gobo {
inline namespace server {

namespace {
constexpr uint32_t kPass = 16;  // samples of the first one; smaller pictures are the ladder's, whose samples cost more
}

void RestEstimate::passDone(uint32_t spp, double ms) {
  if (!halt_.has_spp() || spp < kPass || spp >= halt_.spp()) return;
  if (spp > spp_) {
    perSample_ = std::max(ms - (at_ < ms ? at_ : 0), 0.0) / (spp - spp_);
    spp_ = spp;
  }
  at_ = ms;
}

double RestEstimate::rest(double ms) const {
  if (halt_.has_time_s()) return std::max(halt_.time_s() * 1e3 - ms, 0.0);
  if (halt_.has_error() || !halt_.has_spp()) return 0;
  if (perSample_ > 0) return std::max((halt_.spp() - spp_) * perSample_ - std::max(ms - at_, 0.0), 0.0);
  return std::max(expectedMs_ - ms, 0.0);
}

}  // namespace server
}  // namespace gobo
