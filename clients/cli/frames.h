// SPDX-License-Identifier: Apache-2.0
// Frame numbers as people write them: "7", "0-9", "0-99:10", "-5--1", and several of them, "1,5,9-20:2".
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo::cli {

struct FrameSpan {
  int64_t first = 0, last = 0, step = 1;
};

/// The numbers in the order in which they are written, each once. Errors: InvalidArgument with the flag and the part that is wrong: not a number or
/// range, a range that descends, a number named twice, more than 100000 frames.
Result<std::vector<int64_t>> parseFrames(const std::string& text, const std::string& flag);
/// The one range that these numbers are, if they are one.
bool oneSpan(const std::vector<int64_t>& frames, FrameSpan& span);

}  // namespace gobo::cli
