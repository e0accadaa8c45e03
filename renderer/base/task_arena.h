// SPDX-License-Identifier: Apache-2.0
// TaskArena: the threads that a caller lends to the renderer (a TBB arena). The renderer never starts threads of its own.
// parallelFor gives out indices in no fixed order: bodies must write disjoint data, and nothing may depend on which
// thread ran an index. Reductions go through arrays indexed by task, folded in index order afterwards.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "base/stop.h"

namespace gobo {
inline namespace base {

class RightOfWay;  // base/right_of_way.h

class TaskArena {
 public:
  enum class Threads { Shared, Own };
  /// threads = 0: all the machine's. Shared: arenas at work divide one set of threads, and who comes second waits for a thread to come free of its
  /// piece of work. Own: for short work that runs beside another arena's; the system divides the cores. With a `way` in common (which outlives both), work on
  /// an Own arena has the right of it, and pieces on a Shared one step aside before they begin.
  explicit TaskArena(int threads = 0, Threads whose = Threads::Shared, RightOfWay* way = nullptr);
  ~TaskArena();
  TaskArena(const TaskArena&) = delete;
  TaskArena& operator=(const TaskArena&) = delete;

  int threads() const;
  /// Calls body(begin, end) over [0, count) in pieces of at most `grain`. Pieces not begun when `stop` fires are skipped.
  /// Returns false if any piece was skipped.
  bool parallelFor(size_t count, size_t grain, const std::function<void(size_t begin, size_t end)>& body, const StopToken& stop = {}) const;
  /// Runs `work` inside the arena (so that libraries using TBB, such as Embree's builder, use these threads).
  void execute(const std::function<void()>& work) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace base
}  // namespace gobo
