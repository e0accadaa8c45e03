// SPDX-License-Identifier: Apache-2.0
// Stopping work at chosen polls of its token, and counting them: whether it stops does not depend on the clock.
#pragma once

#include "base/stop.h"

namespace gobo::tests {

/// A token that stops (Cancelled) at its n-th poll; 1: at the first.
inline StopToken stopAt(int n) {
  StopSource source;
  source.stopAtPoll(n);
  return source.token();
}

inline StopToken stoppedAlready() {
  StopSource source;
  source.stop(StopReason::Cancelled);
  return source.token();
}

/// How often `work(token)` looks at a token that does not stop.
template <typename Work>
int pollsOf(const Work& work) {
  constexpr int many = 1 << 30;
  StopSource source;
  source.stopAtPoll(many);
  work(source.token());
  return many - source.pollsLeft();
}

}  // namespace gobo::tests
