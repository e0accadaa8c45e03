// SPDX-License-Identifier: Apache-2.0
// RenderCheckpoints: how a render that must survive its process hands out the states of its extendable nodes, and gets them back.
// A checkpoint is a preemption whose parked state is kept: pixels with their sums and counts, so that going on from it gives the
// same bits as never having stopped (terms/path_trace.h). States are immutable terms; keeping one costs its memory, no copy.
#pragma once

#include <cstdint>

#include "base/hash.h"
#include "terms/term.h"

namespace gobo {
inline namespace plan {

class RenderCheckpoints {
 public:
  virtual ~RenderCheckpoints() = default;
  /// The latest state of `recipe` that was saved by a run towards at most `blocks` blocks; null if there is none. Called by
  /// the rendering thread before the node runs.
  virtual TermPtr load(const Hash128& recipe, uint32_t blocks) = 0;
  /// Called by the rendering thread, which holds the cores: keep the pointer, write later. `state` of a run towards `blocks`
  /// that was preempted (or finished). May be the very state that load() gave.
  virtual void save(const Hash128& recipe, uint32_t blocks, TermPtr state) = 0;
};

}  // namespace plan
}  // namespace gobo
