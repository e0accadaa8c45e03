// SPDX-License-Identifier: Apache-2.0
// FreedMemory: gives back to the system what malloc keeps of memory that was freed. Messages and scenes of many MiB go through the arenas of
// many threads (eight a core), and each may keep all it ever had: hundreds of MiB that no holder of the ledger has. Pages that are given back
// cost whoever uses them next a fault each, so renders that free and take alike keep theirs: only what is beyond `keep` goes.
#pragma once

#include <cstdint>

#include "server/repeating.h"

namespace gobo {
inline namespace server {

class FreedMemory {
 public:
  explicit FreedMemory(uint64_t keepBytes) : keep_(keepBytes) {}
  /// Of `total` bytes that the process may hold: a sixteenth, at least 64 MiB and at most 1 GiB.
  static uint64_t keepOf(uint64_t total);
  /// For the whole process, once, before its threads: large blocks are the system's own and go back when they are freed. (malloc learns to keep blocks of up to
  /// 32 MiB, at the ends of its arenas as well, where no look gets them back.)
  static void boundMalloc();
  /// Looks each second from now on, in a thread of its own.
  void start();
  /// One look: bytes that went.
  uint64_t look();

 private:
  const uint64_t keep_;
  uint64_t stuck_ = 0;  ///< what the last time left: it lies between what is in use, or at the end of an arena
  Repeating looking_;   ///< last: it ends before what it uses
};

}  // namespace server
}  // namespace gobo
