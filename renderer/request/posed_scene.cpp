// SPDX-License-Identifier: Apache-2.0
#include "request/posed_scene.h"

#include <algorithm>

#include "base/mapped_file.h"
#include "request/mesh_edits.h"

namespace gobo {
inline namespace request {

Result<ScenePtr> requestedScene(const ScenePtr& base, const v1::RenderRequest& request, const StopToken& stop) {
  auto placed = [](Result<ScenePtr> r, const char* field) -> Result<ScenePtr> {
    return r.ok() ? std::move(r) : Result<ScenePtr>(Status(r.status().code(), r.status().message(), field));
  };
  GOBO_ASSIGN(const ScenePtr dressed, placed(withVariant(base, request.variant()), "request.variant"));
  // Unknown names are refused even without a time, which alone poses: a pose may cost much, or be refused.
  if (const Status known = chosenAnimations(*dressed, request.animation()).status(); !known.ok())
    return Status(known.code(), known.message(), "request.animation");
  if (!request.has_time_s()) return withMeshEdits(dressed, request, stop);
  GOBO_ASSIGN(const ScenePtr posed, placed(posedScene(dressed, request.animation(), request.time_s(), stop), "request.time_s"));
  return withMeshEdits(posed, request, stop);
}

Result<ScenePtr> PosedScenes::get(const ScenePtr& base, const v1::RenderRequest& request, const StopToken& stop) {
  if (!request.has_time_s() && request.animation().empty() && request.variant().empty() && request.meshes().empty()) return base;
  const Key key{base->hash(),          base->file ? base->file->id() : 0, request.animation(), request.has_time_s(), request.time_s(), request.variant(),
                meshEditsHash(request)};
  {
    std::lock_guard lock(mutex_);
    for (auto it = recent_.begin(); it != recent_.end(); ++it)
      if (it->first == key) {
        recent_.splice(recent_.begin(), recent_, it);
        return recent_.front().second;
      }
  }
  GOBO_ASSIGN(ScenePtr made, requestedScene(base, request, stop));
  if (made == base) return made;  // there anyway, and may go when nobody else has it
  std::lock_guard lock(mutex_);
  recent_.emplace_front(key, made);
  while (recent_.size() > 1 && (recent_.size() > keep_ || held() > bytes_)) recent_.pop_back();
  return made;
}

void PosedScenes::shrink(uint64_t most) {
  std::list<std::pair<Key, ScenePtr>> gone;  // freed after the lock
  std::lock_guard lock(mutex_);
  while (!recent_.empty() && held() > most) gone.splice(gone.begin(), recent_, std::prev(recent_.end()));
}

uint64_t PosedScenes::held() const {
  uint64_t total = 0;
  for (const auto& [key, scene] : recent_) total += scene->bytes();
  return total;
}

uint64_t PosedScenes::bytes() const {
  std::lock_guard lock(mutex_);
  return held();
}

}  // namespace request
}  // namespace gobo
