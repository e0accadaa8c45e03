// SPDX-License-Identifier: Apache-2.0
// SceneLoader: how an engine turns files into scenes and environment maps. In this process for input that the user trusts
// (`gobo --local`: import/load.h); in a sandboxed child with a cache of blobs for daemons (server/ingest_loader.h). Thread-safe.
#pragma once

#include <memory>
#include <string>

#include "base/stop.h"
#include "scene/load.h"

namespace gobo {
inline namespace scene {

/// Milliseconds and bytes of one load. Zero: not known, or not done.
struct LoadReport {
  double parseMs = 0, textureMs = 0;  ///< in the reader (LoadTimes); 0 when `cached`
  double ingestMs = 0;                ///< the child from start to end
  double mapMs = 0;                   ///< mapping and checking the blob
  uint64_t blobBytes = 0;
  bool cached = false;  ///< the blob was there already
};

struct LoadedScene {
  ScenePtr scene;
  LoadReport report;
};

class SceneLoader {
 public:
  virtual ~SceneLoader() = default;
  /// `path` is real and allowed. Cancelled soon after `stop`; otherwise errors name the file, JSON pointer and value.
  virtual Result<LoadedScene> scene(const std::string& path, const StopToken& stop) = 0;
  virtual Result<EnvironmentPtr> environment(const std::string& path, const StopToken& stop) = 0;
  /// `file`, which an earlier result looks into, is not intact: whatever is kept of it goes, so that the next load makes it anew.
  virtual void discard(const MappedFile& file) { (void)file; }
};

/// Refuses every file (Unimplemented): built-in scenes are all there is.
std::shared_ptr<SceneLoader> noLoader();

}  // namespace scene
}  // namespace gobo
