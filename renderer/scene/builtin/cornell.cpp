// SPDX-License-Identifier: Apache-2.0
// cornell: the Cornell box scaled to 2 m a side (x and z in -1..1, y in 0..2), open towards the camera "front"; a short
// and a tall block; exact Lambert reflectances; the ceiling quad "light" emits (a Mesh light). 36 triangles.
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> cornell(const StopToken& stop) {
  SceneBuilder b("cornell", stop);
  const int white = b.material("white", Vec3(0.725f, 0.71f, 0.68f));
  const int red = b.material("red", Vec3(0.63f, 0.065f, 0.05f));
  const int green = b.material("green", Vec3(0.14f, 0.45f, 0.091f));
  const int lamp = b.material("lamp", Vec3(0.78f));
  b.at(lamp).emission.radiance = Vec3(30.0f, 23.0f, 13.0f);
  MeshBuilder m;
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
  m.box(Vec3(0.33f, 0.3f, 0.35f), Vec3(0.3f), rotateY(-0.29f));
  b.add("short", m, white);
  m.box(Vec3(-0.34f, 0.6f, -0.3f), Vec3(0.3f, 0.6f, 0.3f), rotateY(0.31f));
  b.add("tall", m, white);
  m.quad(Vec3(-0.25f, 1.995f, -0.2f), Vec3(0.5f, 0, 0), Vec3(0, 0, 0.4f));
  b.add("light", m, lamp);
  b.camera("front", Vec3(0, 1, 3.85f), Vec3(0, 1, 0), 39.3f);
  return b.finish();
}

}  // namespace gobo::builtin
