// SPDX-License-Identifier: Apache-2.0
#include "trace/accel.h"

#include <chrono>

namespace gobo {
inline namespace trace {

namespace {
bool ready(const std::shared_future<AccelPtr>& f) { return f.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }
constexpr std::chrono::milliseconds kPoll{2};

// A structure looks into the arrays that it was built over. One over a mapping that breaks must not be found by the same scene in another.
Hash128 keyOf(const SceneView& view) {
  const Hash128 digest = view.digest(kAccelFacets);
  return view.mapping() == 0 ? digest : Hasher("accel").add(digest).add(view.mapping()).digest();
}
}  // namespace

AccelPtr AccelCache::get(const SceneView& view, const TaskArena& arena, const StopToken& stop) {
  const Hash128 key = keyOf(view);
  for (;;) {
    std::promise<AccelPtr> promise;
    std::shared_future<AccelPtr> known;
    uint64_t build = 0;
    {
      std::lock_guard lock(mutex_);
      for (auto it = entries_.begin(); it != entries_.end(); ++it) {
        if (it->key != key) continue;
        entries_.splice(entries_.begin(), entries_, it);
        known = it->accel;
        break;
      }
      if (!known.valid()) {
        build = ++builds_;
        entries_.push_front({key, build, promise.get_future().share()});
      }
    }
    if (known.valid()) {  // another thread built it or is about to
      while (known.wait_for(kPoll) != std::future_status::ready)
        if (stop.stopRequested()) return nullptr;
      if (AccelPtr made = known.get()) return made;
      if (stop.stopRequested()) return nullptr;
      continue;  // its builder was stopped: this thread builds
    }
    const auto start = std::chrono::steady_clock::now();
    AccelPtr made;
    try {
      made = build_(view, arena, stop);
    } catch (...) {
      drop(build);
      promise.set_exception(std::current_exception());  // for those who wait for this build; the next ask builds again
      throw;
    }
    const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    if (!made) drop(build);
    promise.set_value(made);
    if (!made) return nullptr;
    std::lock_guard lock(mutex_);
    for (Entry& e : entries_)
      if (e.build == build) e.ms = ms;
    trim(maxBytes_, true);
    return made;
  }
}

void AccelCache::drop(uint64_t build) {
  std::lock_guard lock(mutex_);
  entries_.remove_if([build](const Entry& e) { return e.build == build; });
}

void AccelCache::trim(size_t most, bool keepFirst) {
  size_t total = 0;
  for (auto it = entries_.begin(); it != entries_.end();) {
    if (ready(it->accel)) {
      const size_t b = it->accel.get()->bytes();
      if (!(keepFirst && it == entries_.begin()) && total + b > most) {
        it = entries_.erase(it);
        continue;
      }
      total += b;
    }
    ++it;
  }
}

void AccelCache::shrink(size_t most) {
  std::lock_guard lock(mutex_);
  trim(most, false);
}

size_t AccelCache::bytes() const {
  std::lock_guard lock(mutex_);
  size_t total = 0;
  for (const Entry& e : entries_)
    if (ready(e.accel)) total += e.accel.get()->bytes();
  return total;
}

double AccelCache::buildMs(const SceneView& view) const {
  const Hash128 key = keyOf(view);
  std::lock_guard lock(mutex_);
  for (const Entry& e : entries_)
    if (e.key == key) return e.ms;
  return 0.0;
}

uint64_t AccelCache::builds() const {
  std::lock_guard lock(mutex_);
  return builds_;
}

}  // namespace trace
}  // namespace gobo
