// SPDX-License-Identifier: Apache-2.0
// SceneLibrary: the scenes and environments that an engine holds, by id and by path, the rule which files may be opened, and whose a
// scene is (scene_access.h). Both kinds are bounded in bytes: beyond the bound the least recently used scene of the owner that has most goes,
// unless somebody renders it. Thread-safe; scenes handed out stay valid after unload (shared, immutable).
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "base/memory_ledger.h"
#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/service.pb.h"
#include "plan/scene_access.h"
#include "scene/loader.h"
#include "scene/scene.h"

namespace gobo {
inline namespace plan {

struct SceneLimits {
  uint64_t sceneBytes = UINT64_MAX, environmentBytes = UINT64_MAX;
};

class SceneLibrary {
 public:
  /// Files are read by `loader`; null: none are.
  SceneLibrary(std::vector<std::string> roots, bool anyPath, std::shared_ptr<SceneLoader> loader = nullptr, const SceneLimits& limits = {})
      : roots_(std::move(roots)), anyPath_(anyPath), loader_(loader ? std::move(loader) : noLoader()), limits_(limits) {}

  /// Built-in name or path. The id is made from the source if empty. Opening the same source again under the same id
  /// reloads it. Errors: NotFound, PermissionDenied (outside the roots, an id that is another's), ResourceExhausted (no room although all
  /// that could go has gone), what the loader says.
  /// `stop` is looked at between the phases of a load: Cancelled, and the library is as before.
  /// It belongs to access.caller and is shared with `share`.
  Result<v1::SceneInfo> open(const std::string& source, std::string id, const StopToken& stop = {}, const SceneAccess& access = {},
                             const std::vector<std::string>& share = {});
  Result<v1::SceneInfo> openFile(const std::string& path, const std::string& source, std::string id, const StopToken& stop = {}, const SceneAccess& access = {},
                                 const std::vector<std::string>& share = {}, std::shared_ptr<const void> holds = nullptr);
  /// A built-in or a file, without an id; `trusted`: wherever the file is.
  Result<ScenePtr> load(const std::string& source, bool trusted) const;
  Result<std::string> allowedPath(const std::string& path, const std::string& field) const;
  /// By id; a built-in name that is not loaded yet is opened, unless something else had that name (a patched one, another source) and was unloaded without
  /// being asked to: nobody gets another scene than he left. Errors: NotFound that lists what there is, also for what the caller may not use; Cancelled.
  Result<ScenePtr> find(const std::string& id, const StopToken& stop = {}, const SceneAccess& access = {}) { return find(id, stop, access, false); }
  Result<v1::SceneInfo> inspect(const std::string& id, const SceneAccess& access = {});
  std::vector<v1::SceneInfo> list(const SceneAccess& access = {}) const;
  /// On top of whatever the id stands for when it is done: of patches at the same time none is lost. An id that was unloaded
  /// meanwhile stays unloaded (NotFound). PermissionDenied for a scene that the caller may use, but not change.
  Result<v1::SceneInfo> patch(const v1::PatchSceneRequest& patch, const StopToken& stop = {}, const SceneAccess& access = {});
  Status unload(const std::string& id, const SceneAccess& access = {});
  /// Unloads scenes and environment maps whose mapped file is not intact, and has the loader discard those files and `broken`.
  void dropBroken(std::vector<std::shared_ptr<const MappedFile>> broken);
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken& stop = {});
  /// Of a file whose bytes have that SHA-256 (64 hex digits), wherever it is.
  Result<EnvironmentPtr> environmentOf(const std::string& sha256, const std::string& file, const StopToken& stop = {});
  size_t count() const;
  uint64_t sceneBytes() const;  ///< of all loaded scenes; what several share counts for each
  BytesOfCallers sceneBytesOfOwners() const;
  uint64_t environmentBytes() const;
  const SceneLimits& limits() const { return limits_; }
  /// Scenes that nobody renders go, the least recently used of the owner that has most first.
  void shrinkScenes(uint64_t most);
  void shrinkEnvironments(uint64_t most);
  /// Asked for room before a scene or an environment is taken in, never under the library's lock. Before the first call.
  void setLedger(MemoryLedger* ledger) { ledger_ = ledger; }
  void setRoots(std::vector<std::string> roots);

 private:
  struct Entry {
    ScenePtr scene;
    std::string source;
    double loadMs = 0;
    LoadReport report = {};
    std::string owner = {};
    std::vector<std::string> share = {};
    uint64_t used = 0;                       ///< clock_ of the last use
    uint64_t bytes = 0;                      ///< of the scene
    std::shared_ptr<const void> holds = {};  ///< what must stay as long as it is loaded
    bool patched = false;
  };
  struct Map {
    EnvironmentPtr map;
    uint64_t used;
    uint64_t bytes() const { return uint64_t(map->texels.size()) * sizeof(Vec3); }
  };
  using Entries = std::map<std::string, Entry>;
  Result<v1::SceneInfo> insert(std::string id, const std::string& source, Result<LoadedScene> scene, double ms, const StopToken& stop,
                               const SceneAccess& access, const std::vector<std::string>& share, std::shared_ptr<const void> holds = nullptr);
  /// `again`: whoever asks opens it, whatever it was before.
  Result<ScenePtr> find(const std::string& id, const StopToken& stop, const SceneAccess& access, bool again);
  /// Of memory, or nothing; and what was loaded into it.
  EnvironmentPtr keptEnvironment(const std::string& key);
  Status keepEnvironment(const std::string& key, const EnvironmentPtr& loaded);
  Status room(uint64_t bytes, const char* what);
  // Under mutex_. What goes is in `freed`, until after the lock.
  using Freed = std::vector<std::shared_ptr<const void>>;
  uint64_t sceneBytesHeld() const;
  Status makeRoom(uint64_t bytes, const std::string& keep, Freed& freed);
  bool evict(const std::string& keep, const char* why, Freed& freed);
  void trimEnvironments(uint64_t most, std::vector<EnvironmentPtr>& gone);
  Status unknown(const std::string& id, const SceneAccess& access) const;
  v1::SceneInfo info(const std::string& id, const Entry& entry) const;

  std::vector<std::string> roots_;  // under mutex_
  bool anyPath_;
  std::shared_ptr<SceneLoader> loader_;
  mutable std::mutex mutex_;
  const SceneLimits limits_;
  MemoryLedger* ledger_ = nullptr;
  Entries scenes_;
  struct Gone {
    std::string id, why, owner;
    std::vector<std::string> share;  // to whom else it was there
    bool changedBuiltin = false;     // a built-in of this name is another scene
  };
  void noteGone(const std::string& id, const Entry& entry, const char* why);  ///< under mutex_, as the next two
  bool isGoneForGood(const std::string& id) const;                            ///< a built-in name that is not made again unless it is opened
  void forgetGone(const std::string& id);
  std::deque<Gone> gone_;  ///< ids that were unloaded without being asked to and not opened since, the latest last
  uint64_t clock_ = 0;
  std::map<std::string, Map> environments_;  ///< by canonical path + settled file stamp, or "sha256:" + digest
};

}  // namespace plan
}  // namespace gobo
