// SPDX-License-Identifier: Apache-2.0
// Reading scene files in this process. Programs link it that parse files themselves: gobo-ingest in its sandbox, `gobo --local` for files that
// the user trusts, tests. The daemon does not (tests/protocol/server/parsers_test.cpp).
#pragma once

#include <memory>
#include <string>

#include "scene/load.h"
#include "scene/loader.h"

namespace gobo {
inline namespace imports {

/// glTF 2.0 (.gltf with files beside it, or .glb). Errors name file, JSON pointer and value. The result is sealed.
Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions& options = {});

/// A path ending in .gltf/.glb, or the name of a built-in scene.
Result<ScenePtr> loadScene(const std::string& nameOrPath, const LoadOptions& options = {});

/// For EngineOptions.loader.
std::shared_ptr<SceneLoader> inProcessLoader(const LoadOptions& options = {});

}  // namespace imports
}  // namespace gobo
