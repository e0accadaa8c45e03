// SPDX-License-Identifier: Apache-2.0
// The scene that a request's variant, animation, time and edits of meshes make of a loaded one, before its other edits.
#pragma once

#include <list>
#include <mutex>
#include <tuple>

#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

/// Variant first, then the pose, then the meshes (mesh_edits.h). Where nothing changes: `base` itself. Errors (NotFound, with the names there are) name
/// the request's field; Cancelled soon after `stop`.
Result<ScenePtr> requestedScene(const ScenePtr& base, const v1::RenderRequest& request, const StopToken& stop = {});

/// The last few results of requestedScene, by base scene's hash, the mapped file under its arrays and the four fields. Thread-safe.
class PosedScenes {
 public:
  /// At most `keep` of them, and `bytes` together (the latest always).
  explicit PosedScenes(size_t keep = 8, uint64_t bytes = 1ull << 30) : keep_(keep), bytes_(bytes) {}
  uint64_t bytes() const;
  uint64_t limit() const { return bytes_; }
  void shrink(uint64_t most);
  /// One that `stop` ended is not kept.
  Result<ScenePtr> get(const ScenePtr& base, const v1::RenderRequest& request, const StopToken& stop = {});

 private:
  using Key = std::tuple<Hash128, uint64_t, std::string, bool, double, std::string, Hash128>;
  uint64_t held() const;  ///< under mutex_
  size_t keep_;
  uint64_t bytes_;
  mutable std::mutex mutex_;
  std::list<std::pair<Key, ScenePtr>> recent_;  ///< latest first
};

}  // namespace request
}  // namespace gobo
