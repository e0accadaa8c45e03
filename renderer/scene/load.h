// SPDX-License-Identifier: Apache-2.0
// Getting scenes in: glTF/GLB files and built-in procedural scenes.
#pragma once

#include <string>
#include <vector>

#include "base/stop.h"
#include "scene/scene.h"

namespace gobo {

struct LoadOptions {
  uint64_t maxTriangles = 64ull << 20;
  uint64_t maxBytes = 8ull << 30;
  StopToken stop;                          ///< looked at between the phases: Cancelled
};

/// glTF 2.0 (.gltf with files beside it, or .glb). Errors name file, JSON pointer and value. The result is sealed.
Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions& options = {});

/// "cornell", "grids", ... (builtinSceneNames).
/// Errors: NotFound that lists the names.
Result<ScenePtr> makeBuiltinScene(const std::string& name);
const std::vector<std::string>& builtinSceneNames();

/// A path ending in .gltf/.glb, or the name of a built-in scene.
Result<ScenePtr> loadScene(const std::string& nameOrPath, const LoadOptions& options = {});

}  // namespace gobo
