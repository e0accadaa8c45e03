// SPDX-License-Identifier: Apache-2.0
// What a store tells of a term beside the term: who made it and for what. For people and for eviction by name; in no key.
#pragma once

#include <cstdint>
#include <string>

#include "base/hash.h"

namespace gobo {
inline namespace plan {

struct TermNote {
  std::string label;   ///< of its node in the plan of the request that made it
  std::string scene;   ///< id of the scene of that request
  double ms = 0;       ///< that making it took, without its inputs
  double unsaved = 0;  ///< ms that a loss of this process loses: its own, and those of inputs that are not on disk either; 0 once it is there
};

struct StoredTerm {
  Hash128 key;
  std::string type;  ///< empty: a file of which nothing is noted
  TermNote note;
  uint64_t bytes = 0, diskBytes = 0;  ///< in memory, of its file; 0: not there
  int64_t used = 0;                   ///< last use, microseconds since 1970
  bool pinned = false;
};

}  // namespace plan
}  // namespace gobo
