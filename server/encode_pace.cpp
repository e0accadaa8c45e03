// SPDX-License-Identifier: Apache-2.0
#include "server/encode_pace.h"

namespace gobo {
inline namespace server {

double EncodePace::expectedMs(v1::Encoding::Format format, uint64_t pixels) const {
  if (!v1::Encoding::Format_IsValid(format)) return 0;
  const std::lock_guard lock(mutex_);
  return msPerPixel_[size_t(format)] * double(pixels);
}

void EncodePace::took(v1::Encoding::Format format, uint64_t pixels, double ms) {
  constexpr uint64_t kLeast = 64 * 64;  // what each call costs would be taken for what each pixel costs
  if (!v1::Encoding::Format_IsValid(format) || pixels < kLeast || !(ms >= 0)) return;
  const std::lock_guard lock(mutex_);
  double& known = msPerPixel_[size_t(format)];
  const double now = ms / double(pixels);
  known = known == 0 ? now : known + 0.25 * (now - known);
}

}  // namespace server
}  // namespace gobo
