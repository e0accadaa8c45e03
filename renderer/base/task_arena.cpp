// SPDX-License-Identifier: Apache-2.0
#include "base/task_arena.h"

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>

namespace gobo {

struct TaskArena::Impl {
  explicit Impl(int threads) : arena(threads > 0 ? threads : tbb::info::default_concurrency()) {}
  mutable tbb::task_arena arena;
};

TaskArena::TaskArena(int threads) : impl_(std::make_unique<Impl>(threads)) {}
TaskArena::~TaskArena() = default;

int TaskArena::threads() const { return impl_->arena.max_concurrency(); }

bool TaskArena::parallelFor(size_t count, size_t grain, const std::function<void(size_t, size_t)>& body,
                            const StopToken& stop) const {
  if (count == 0) return true;
  if (grain == 0) grain = 1;
  const size_t pieces = (count + grain - 1) / grain;
  std::atomic<bool> complete{true};
  impl_->arena.execute([&] {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, pieces, 1), [&](const tbb::blocked_range<size_t>& range) {
      for (size_t i = range.begin(); i != range.end(); ++i) {
        if (stop.stopRequested()) { complete.store(false, std::memory_order_relaxed); return; }
        body(i * grain, std::min(count, (i + 1) * grain));
      }
    }, tbb::simple_partitioner{});
  });
  return complete.load();
}

void TaskArena::execute(const std::function<void()>& work) const { impl_->arena.execute(work); }

}  // namespace gobo
