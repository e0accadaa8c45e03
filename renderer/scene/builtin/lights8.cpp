// SPDX-License-Identifier: Apache-2.0
// lights8: a plain room with a plinth, ball, blocks and vase, under eight lamps of every finite kind, for relighting: "key"
// and "fill" (rectangles), "rim" (disk), "a" (point), "b" (spot), "c" (sphere), "d" (disk), "e" (point). Camera "front".
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> lights8(const StopToken& stop) {
  SceneBuilder b("lights8", stop);
  const int wall = b.material("wall", Vec3(0.68f, 0.66f, 0.62f)), floor = b.material("floor", Vec3(0.45f, 0.36f, 0.28f), 0.5f, 0.0f, 0.5f);
  const int clay = b.material("clay", Vec3(0.6f, 0.28f, 0.18f)), plastic = b.material("plastic", Vec3(0.12f, 0.28f, 0.5f), 0.25f, 0.0f, 1.0f);
  const int brass = b.material("brass", Vec3(0.85f, 0.65f, 0.3f), 0.3f, 1.0f, 1.0f), white = b.material("white", Vec3(0.78f));
  MeshBuilder m;
  m.quad(Vec3(-3, 0, 2.5f), Vec3(6, 0, 0), Vec3(0, 0, -5));
  b.add("floor", m, floor);
  m.quad(Vec3(-3, 3, -2.5f), Vec3(6, 0, 0), Vec3(0, 0, 5));
  b.add("ceiling", m, wall);
  m.quad(Vec3(-3, 0, -2.5f), Vec3(6, 0, 0), Vec3(0, 3, 0));
  m.quad(Vec3(-3, 0, 2.5f), Vec3(0, 0, -5), Vec3(0, 3, 0));
  m.quad(Vec3(3, 0, -2.5f), Vec3(0, 0, 5), Vec3(0, 3, 0));
  b.add("walls", m, wall);
  m.box(Vec3(0, 0.35f, -0.3f), Vec3(0.45f, 0.35f, 0.45f));
  b.add("plinth", m, white);
  m.sphere(Vec3(0, 1.1f, -0.3f), 0.4f, 64, 32);
  b.add("ball", m, plastic);
  m.box(Vec3(-1.5f, 0.3f, -0.9f), Vec3(0.3f), rotateY(0.5f));
  b.add("block", m, clay);
  m.box(Vec3(-1.45f, 0.75f, -0.95f), Vec3(0.15f), rotateY(0.1f));
  b.add("small-block", m, brass);
  std::vector<Vec2> vase;
  for (int i = 0; i <= 40; ++i) {
    const float t = i / 40.0f;
    vase.push_back(Vec2(0.14f + 0.2f * std::sin(kPi * std::pow(t, 0.7f)) * (1.0f - 0.3f * t) - 0.02f * std::sin(2.0f * kPi * t), 0.9f * t));
  }
  vase.front().y = 0.001f;
  m.lathe(Vec3(1.5f, 0, -0.7f), vase, 48);
  b.add("vase", m, clay);
  b.rect("key", Vec3(-1.8f, 2.7f, 1.2f), Vec3(0, 0.8f, -0.3f), 0.35f, 0.35f, Vec3(24.0f, 21.5f, 18.0f));
  b.rect("fill", Vec3(2.4f, 2.2f, 1.6f), Vec3(0, 0.9f, -0.3f), 0.5f, 0.4f, Vec3(4.0f, 4.6f, 5.6f));
  b.disk("rim", Vec3(0.9f, 2.6f, -2.1f), Vec3(0, 1.1f, -0.3f), 0.2f, Vec3(13.0f, 12.0f, 11.0f));
  b.point("a", Vec3(-2.5f, 0.6f, -1.9f), Vec3(0.5f, 0.22f, 0.08f));
  b.spot("b", Vec3(2.4f, 2.8f, -0.2f), Vec3(1.5f, 0.2f, -0.8f), 22.0f, Vec3(3.2f, 2.9f, 2.2f));
  b.ball("c", Vec3(2.3f, 1.1f, -2.0f), 0.08f, Vec3(9.0f, 14.0f, 18.0f));
  b.disk("d", Vec3(-2.0f, 2.95f, -1.6f), Vec3(-2.0f, 0.0f, -1.6f), 0.12f, Vec3(18.0f, 13.0f, 9.0f));
  b.point("e", Vec3(0.9f, 0.35f, 1.0f), Vec3(0.12f, 0.1f, 0.3f));
  b.camera("front", Vec3(0.5f, 1.55f, 4.3f), Vec3(0, 0.85f, -0.4f), 42.0f);
  return b.finish();
}

}  // namespace gobo::builtin
