// SPDX-License-Identifier: Apache-2.0
// Built-in procedural scenes, and what readers of files (import/load.h) are told and tell.
#pragma once

#include <string>
#include <vector>

#include "base/stop.h"
#include "scene/file_source.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {

/// Where the time of a load went.
struct LoadTimes {
  double parseMs = 0, textureMs = 0;
};  ///< everything but textures; decoding, mip levels and tiles

struct LoadOptions {
  uint64_t maxTriangles = 64ull << 20;
  uint64_t maxBytes = 8ull << 30;
  uint64_t textureBytes = 4ull << 30;  ///< all textures with their mip levels; finest levels are left out above it (mipmap.h)
  FileSource* files = nullptr;         ///< null: the disk
  LoadTimes* times = nullptr;          ///< filled in when set
  StopToken stop;                      ///< looked at between the phases: Cancelled
};

/// "cornell", "grids", ... (builtinSceneNames).
/// Errors: NotFound that lists the names, Cancelled soon after `stop`.
Result<ScenePtr> makeBuiltinScene(const std::string& name, const StopToken& stop = {});
const std::vector<std::string>& builtinSceneNames();

}  // namespace scene
}  // namespace gobo
