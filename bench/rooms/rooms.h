// SPDX-License-Identifier: Apache-2.0
// Scenes with fireflies, made for measurements of what takes them out.
#pragma once

#include <string>

#include "scene/builtin/build.h"

namespace gobo::bench {

/// Walls of the Cornell box, closed towards the camera.
inline void walls(builtin::SceneBuilder& b) {
  const int white = b.material("white", Vec3(0.725f, 0.71f, 0.68f)), red = b.material("red", Vec3(0.63f, 0.065f, 0.05f)),
            green = b.material("green", Vec3(0.14f, 0.45f, 0.091f));
  builtin::MeshBuilder m;
  m.quad(Vec3(-1, 0, 1), Vec3(2, 0, 0), Vec3(0, 0, -2));
  b.add("floor", m, white);
  m.quad(Vec3(-1, 2, -1), Vec3(2, 0, 0), Vec3(0, 0, 2));
  b.add("ceiling", m, white);
  m.quad(Vec3(-1, 0, -1), Vec3(2, 0, 0), Vec3(0, 2, 0));
  b.add("back", m, white);
  m.quad(Vec3(-1, 0, 1), Vec3(0, 0, -2), Vec3(0, 2, 0));
  b.add("left", m, red);
  m.quad(Vec3(1, 0, -1), Vec3(0, 0, 2), Vec3(0, 2, 0));
  b.add("right", m, green);
  b.camera("front", Vec3(0, 1, 3.85f), Vec3(0, 1, 0), 39.3f);
}
/// After the source's first scene: a diffuse room, specular things in it, a small lamp.
inline Result<ScenePtr> specularRoom() {
  builtin::SceneBuilder b("specular_room");
  walls(b);
  const int metal = b.material("metal", Vec3(0.95f), 0.05f, 1.0f, 1.0f), glossy = b.material("glossy", Vec3(0.9f, 0.75f, 0.5f), 0.25f, 1.0f, 1.0f),
            glass = b.material("glass", Vec3(0.97f), 0.0f, 0.0f, 1.0f);
  b.at(glass).bsdf.transmission = 1.0f;
  b.at(glass).bsdf.thickness = 0.9f;
  builtin::MeshBuilder m;
  m.sphere(Vec3(-0.45f, 0.4f, -0.35f), 0.4f, 48, 26);
  b.add("metal", m, metal);
  m.sphere(Vec3(0.45f, 0.35f, 0.25f), 0.35f, 48, 26);
  b.add("glass", m, glass);
  m.box(Vec3(0.4f, 0.5f, -0.55f), Vec3(0.25f, 0.5f, 0.2f), builtin::rotateY(0.4f));
  b.add("glossy", m, glossy);
  b.ball("lamp", Vec3(0, 1.7f, 0), 0.05f, Vec3(400.0f, 330.0f, 240.0f));
  return b.finish();
}
/// Most light comes from a lamp behind a screen, by way of the back wall.
inline Result<ScenePtr> hiddenLamp() {
  builtin::SceneBuilder b("hidden_lamp");
  walls(b);
  const int screen = b.material("screen", Vec3(0.4f)), plastic = b.material("plastic", Vec3(0.3f, 0.4f, 0.7f), 0.15f, 0.0f, 1.0f);
  builtin::MeshBuilder m;
  m.box(Vec3(0, 1.0f, -0.75f), Vec3(0.7f, 0.9f, 0.02f));
  b.add("screen", m, screen);
  m.sphere(Vec3(0.3f, 0.3f, 0.2f), 0.3f, 48, 26);
  b.add("ball", m, plastic);
  b.rect("lamp", Vec3(0, 0.8f, -0.85f), Vec3(0, 0.9f, -1.0f), 0.05f, 0.05f, Vec3(900.0f, 800.0f, 650.0f));
  b.rect("dim", Vec3(0, 1.99f, 0.4f), Vec3(0, 0, 0.4f), 0.3f, 0.3f, Vec3(1.0f, 1.1f, 1.3f));
  return b.finish();
}

/// The one of that name, or none.
inline Result<ScenePtr> roomOf(const std::string& name) {
  if (name == "specular_room") return specularRoom();
  if (name == "hidden_lamp") return hiddenLamp();
  return ScenePtr();
}

}  // namespace gobo::bench
