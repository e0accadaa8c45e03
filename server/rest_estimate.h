// SPDX-License-Identifier: Apache-2.0
// RestEstimate: when a render that runs will be over, for whoever watches it: by its time bound, by the rate of its finished passes, or
// before the first one by its plan. Pure; one thread at a time.
#pragma once

#include <cstdint>

#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace server {

class RestEstimate {
 public:
  /// `expectedMs` of the whole render, by its plan; 0: nobody knows.
  RestEstimate(const v1::Halt& resolved, double expectedMs) : halt_(resolved), expectedMs_(expectedMs) {}
  /// A whole picture of `spp` samples a pixel is there, `ms` after the run began. Pictures that a stopped run had made already come at
  /// once in the next one: they say nothing of the rate.
  void passDone(uint32_t spp, double ms);
  /// Expected milliseconds from `ms` after the run began to its end; 0: nothing is known.
  double rest(double ms) const;

 private:
  const v1::Halt halt_;
  const double expectedMs_;
  uint32_t spp_ = 0;  // of the last pass
  double at_ = 0, perSample_ = 0;
};

}  // namespace server
}  // namespace gobo
