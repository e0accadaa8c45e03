// SPDX-License-Identifier: Apache-2.0
// SceneLibrary: the scenes and environments that an engine holds, by id and by path, and the rule which files may be
// opened. Thread-safe; scenes handed out stay valid after unload (shared, immutable).
#pragma once

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/service.pb.h"
#include "scene/loader.h"
#include "scene/scene.h"

namespace gobo {

class SceneLibrary {
 public:
  /// Files are read by `loader`; null: in this process.
  SceneLibrary(std::vector<std::string> roots, bool anyPath, std::shared_ptr<SceneLoader> loader = nullptr)
      : roots_(std::move(roots)), anyPath_(anyPath), loader_(loader ? std::move(loader) : inProcessLoader()) {}

  /// Built-in name or path. The id is made from the source if empty. Opening the same source again under the same id
  /// reloads it. Errors: NotFound, PermissionDenied (outside the roots), what the loader says.
  /// `stop` is looked at between the phases of a load: Cancelled, and the library is as before.
  Result<v1::SceneInfo> open(const std::string& source, std::string id, const StopToken& stop = {});
  Result<v1::SceneInfo> openFile(const std::string& path, const std::string& source, std::string id, const StopToken& stop = {});
  /// A built-in or a file, without an id; `trusted`: wherever the file is.
  Result<ScenePtr> load(const std::string& source, bool trusted) const;
  Result<std::string> allowedPath(const std::string& path, const std::string& field) const;
  /// By id; a built-in name that is not loaded yet is opened. Errors: NotFound that lists what there is; Cancelled.
  Result<ScenePtr> find(const std::string& id, const StopToken& stop = {});
  Result<v1::SceneInfo> inspect(const std::string& id);
  std::vector<v1::SceneInfo> list() const;
  /// On top of whatever the id stands for when it is done: of patches at the same time none is lost. An id that was unloaded
  /// meanwhile stays unloaded (NotFound).
  Result<v1::SceneInfo> patch(const v1::PatchSceneRequest& patch, const StopToken& stop = {});
  Status unload(const std::string& id);
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken& stop = {});
  size_t count() const;
  void setRoots(std::vector<std::string> roots);

 private:
  struct Entry { ScenePtr scene; std::string source; double loadMs = 0; LoadReport report; };
  Result<v1::SceneInfo> insert(std::string id, const std::string& source, Result<LoadedScene> scene, double ms, const StopToken& stop);
  v1::SceneInfo info(const std::string& id, const Entry& entry) const;

  std::vector<std::string> roots_;   // under mutex_
  bool anyPath_;
  std::shared_ptr<SceneLoader> loader_;
  mutable std::mutex mutex_;
  std::map<std::string, Entry> scenes_;
  std::map<std::string, EnvironmentPtr> environments_;   ///< by canonical path + settled file stamp; a few are kept
};

}  // namespace gobo
