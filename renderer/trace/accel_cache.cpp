// SPDX-License-Identifier: Apache-2.0
#include "trace/accel.h"

#include <chrono>

namespace gobo {

namespace {
// Alpha look-ups read texture coordinates and vertex alpha, which are Shading facets: they join the key of alpha meshes.
Hash128 cacheKey(const SceneView& view) {
  Hasher h("accel");
  h.add(view.geometryHash());
  for (const MeshPtr& mesh : view.meshes(Facet::Coverage))
    if (view.coverage(mesh->material).mode != AlphaMode::Opaque) h.add(mesh->shadingHash);
  return h.digest();
}
bool ready(const std::shared_future<AccelPtr>& f) { return f.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }
}  // namespace

AccelPtr AccelCache::get(const SceneView& view, const TaskArena& arena) {
  const Hash128 key = cacheKey(view);
  std::promise<AccelPtr> promise;
  std::shared_future<AccelPtr> known;
  {
    std::lock_guard lock(mutex_);
    for (auto it = entries_.begin(); it != entries_.end(); ++it) {
      if (it->key != key) continue;
      entries_.splice(entries_.begin(), entries_, it);
      known = it->accel;
      break;
    }
    if (!known.valid()) {
      entries_.push_front({key, promise.get_future().share()});
      ++builds_;
    }
  }
  if (known.valid()) return known.get();                            // waits when another thread is building it
  const auto start = std::chrono::steady_clock::now();
  AccelPtr made = Accel::build(view, arena);
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  promise.set_value(made);
  std::lock_guard lock(mutex_);
  for (Entry& e : entries_) if (e.key == key) e.ms = ms;
  size_t total = 0;
  for (auto it = entries_.begin(); it != entries_.end();) {
    if (ready(it->accel)) {
      const size_t b = it->accel.get()->bytes();
      if (it != entries_.begin() && total + b > maxBytes_) { it = entries_.erase(it); continue; }
      total += b;
    }
    ++it;
  }
  return made;
}

size_t AccelCache::bytes() const {
  std::lock_guard lock(mutex_);
  size_t total = 0;
  for (const Entry& e : entries_) if (ready(e.accel)) total += e.accel.get()->bytes();
  return total;
}

double AccelCache::buildMs(const SceneView& view) const {
  const Hash128 key = cacheKey(view);
  std::lock_guard lock(mutex_);
  for (const Entry& e : entries_) if (e.key == key) return e.ms;
  return 0.0;
}

uint64_t AccelCache::builds() const { std::lock_guard lock(mutex_); return builds_; }

}  // namespace gobo
