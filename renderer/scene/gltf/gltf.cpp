// SPDX-License-Identifier: Apache-2.0
#include "scene/load.h"

namespace gobo {
Result<ScenePtr> loadGltf(const std::string& path, const LoadOptions&) { return Status(Code::Unimplemented, "glTF is not read yet", path); }
}  // namespace gobo
