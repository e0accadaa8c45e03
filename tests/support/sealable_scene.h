// SPDX-License-Identifier: Apache-2.0
// A small scene that seal() accepts: one triangle, one material, one point light.
#pragma once

#include "scene/scene.h"

namespace gobo::tests {

inline std::shared_ptr<Scene> sealableScene() {
  auto s = std::make_shared<Scene>();
  s->name = "s";
  auto m = std::make_shared<Mesh>();
  m->positions = {Vec3(-1, 0, 0), Vec3(3, 0, 0), Vec3(0, 2, 0)};
  m->indices = {0, 1, 2};
  sealMesh(*m);
  s->meshes = {m};
  s->instances = {{"a", 0, Mat4(1.0f)}};
  s->materials.resize(1);
  Light l;
  l.name = "l";
  s->lights = {l};
  return s;
}

}  // namespace gobo::tests
