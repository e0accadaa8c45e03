// SPDX-License-Identifier: Apache-2.0
// Getting scenes in: glTF/GLB files and built-in procedural scenes.
#pragma once

#include <string>
#include <vector>

#include "base/stop.h"
#include "scene/file_source.h"
#include "scene/scene.h"

namespace gobo {

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

/// glTF 2.0 (.gltf with files beside it, or .glb). Errors name file, JSON pointer and value. The result is sealed.
Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions& options = {});

/// "cornell", "grids", ... (builtinSceneNames).
/// Errors: NotFound that lists the names, Cancelled soon after `stop`.
Result<ScenePtr> makeBuiltinScene(const std::string& name, const StopToken& stop = {});
const std::vector<std::string>& builtinSceneNames();

/// A path ending in .gltf/.glb, or the name of a built-in scene.
Result<ScenePtr> loadScene(const std::string& nameOrPath, const LoadOptions& options = {});

}  // namespace gobo
