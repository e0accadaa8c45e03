// SPDX-License-Identifier: Apache-2.0
// Small edits that make a new sealed Scene sharing every unchanged mesh, texture and map with the old one.
#pragma once

#include "scene/scene.h"

namespace gobo {
inline namespace scene {

/// Copies (shallow: meshes and textures are shared), lets `edit` change it, seals. The edit must not touch shared meshes.
template <typename Edit>
Result<ScenePtr> editScene(const Scene& base, Edit&& edit) {
  auto copy = std::make_shared<Scene>(base);
  GOBO_TRY(edit(*copy));
  GOBO_TRY(copy->seal());
  return ScenePtr(copy);
}

}  // namespace scene
}  // namespace gobo
