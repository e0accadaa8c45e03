// SPDX-License-Identifier: Apache-2.0
#include "base/task_arena.h"

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <optional>

#include "base/right_of_way.h"

#ifdef GOBO_THREAD_SANITIZER
#include <sanitizer/tsan_interface.h>
#endif

namespace gobo {
inline namespace base {

namespace {

// The thread sanitizer sees our code, not the inside of TBB's library: it is told that a piece begins after the call and ends before its return.
#ifdef GOBO_THREAD_SANITIZER
void passedOn(void* what) { __tsan_release(what); }
void takenOver(void* what) { __tsan_acquire(what); }
#else
void passedOn(void*) {}
void takenOver(void*) {}
#endif

}  // namespace

struct TaskArena::Impl {
  Impl(int threads, Threads whose, RightOfWay* way)
      : arena(threads > 0 ? threads : tbb::info::default_concurrency()),
        has(whose == Threads::Own ? way : nullptr),
        gives(whose == Threads::Own ? nullptr : way) {
    // One arena of default size takes all workers that TBB would have.
    if (whose == Threads::Own)
      workers.emplace(tbb::global_control::max_allowed_parallelism, size_t(tbb::info::default_concurrency()) + size_t(arena.max_concurrency()));
  }
  std::optional<tbb::global_control> workers;
  mutable tbb::task_arena arena;
  RightOfWay *has, *gives;
};

TaskArena::TaskArena(int threads, Threads whose, RightOfWay* way) : impl_(std::make_unique<Impl>(threads, whose, way)) {}
TaskArena::~TaskArena() = default;

int TaskArena::threads() const { return impl_->arena.max_concurrency(); }

bool TaskArena::parallelFor(size_t count, size_t grain, const std::function<void(size_t, size_t)>& body, const StopToken& stop) const {
  if (count == 0) return true;
  if (grain == 0) grain = 1;
  const size_t pieces = (count + grain - 1) / grain;
  std::atomic<bool> complete{true};
  const RightOfWay::Taken taken(impl_->has);
  char begun = 0, ended = 0;
  passedOn(&begun);
  impl_->arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, pieces, 1),
        [&](const tbb::blocked_range<size_t>& range) {
          takenOver(&begun);
          for (size_t i = range.begin(); i != range.end(); ++i) {
            if (impl_->gives) impl_->gives->stepAside(stop);
            if (stop.stopRequested()) {
              complete.store(false, std::memory_order_relaxed);
              break;
            }
            body(i * grain, std::min(count, (i + 1) * grain));
          }
          passedOn(&ended);
        },
        tbb::simple_partitioner{});
  });
  takenOver(&ended);
  return complete.load();
}

void TaskArena::execute(const std::function<void()>& work) const {
  const RightOfWay::Taken taken(impl_->has);
  char begun = 0, ended = 0;
  passedOn(&begun);
  impl_->arena.execute([&] {  // may run on another thread of the arena
    takenOver(&begun);
    work();
    passedOn(&ended);
  });
  takenOver(&ended);
}

}  // namespace base
}  // namespace gobo
