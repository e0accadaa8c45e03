// SPDX-License-Identifier: Apache-2.0
// EncodePace: how long pictures of each format take to encode, so that halt.time_s, which is the caller's time, is kept.
// Thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>

#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace server {

class EncodePace {
 public:
  /// Of so many values (pixels x outputs); 0 before the first.
  double expectedMs(v1::Encoding::Format format, uint64_t pixels) const;
  void took(v1::Encoding::Format format, uint64_t pixels, double ms);

 private:
  mutable std::mutex mutex_;
  std::array<double, v1::Encoding::Format_ARRAYSIZE> msPerPixel_{};
};

}  // namespace server
}  // namespace gobo
