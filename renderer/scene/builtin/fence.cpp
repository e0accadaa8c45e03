// SPDX-License-Identifier: Apache-2.0
// fence: a picket fence on a lawn-sized floor, lit by the low rectangle "key" (wide penumbras that sharpen towards the
// pickets' feet) and the directional light "sun" (hard shadows). Cameras "front" and "low".
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> fence(const StopToken& stop) {
  SceneBuilder b("fence", stop);
  const int floor = b.material("floor", Vec3(0.5f, 0.48f, 0.42f)), paint = b.material("paint", Vec3(0.75f, 0.74f, 0.7f));
  const int post = b.material("post", Vec3(0.45f, 0.3f, 0.18f));
  MeshBuilder m;
  m.quad(Vec3(-8, 0, 8), Vec3(16, 0, 0), Vec3(0, 0, -16), 8, 8, Vec2(8));
  b.add("floor", m, floor);
  for (int i = 0; i < 25; ++i) {
    const float x = -3.0f + 0.25f * i, w = 0.07f, d = 0.015f, h = 1.0f, tip = 1.14f;
    m.box(Vec3(x, 0.5f * h + 0.04f, 0), Vec3(w, 0.5f * h - 0.04f, d));
    // The pointed top: a prism whose front and back are triangles.
    const Vec3 l0(x - w, h, d), r0(x + w, h, d), t0(x, tip, d), l1(x - w, h, -d), r1(x + w, h, -d), t1(x, tip, -d);
    auto flat = [&](const Vec3& p, const Vec3& q, const Vec3& r) {
      const Vec3 n = glm::normalize(glm::cross(q - p, r - p));
      const uint32_t a = m.vertex(p, n, Vec2(0, 1)), c = m.vertex(q, n, Vec2(1, 1)), e = m.vertex(r, n, Vec2(0.5f, 0));
      m.triangle(a, c, e);
    };
    flat(l0, r0, t0);
    flat(r1, l1, t1);
    m.quad(r0, r1 - r0, t0 - r0);
    m.quad(l1, l0 - l1, t1 - l1);
  }
  b.add("pickets", m, paint, false);
  for (float y : {0.3f, 0.8f}) m.box(Vec3(0, y, -0.04f), Vec3(3.2f, 0.045f, 0.02f));
  b.add("rails", m, paint, false);
  for (float x : {-3.25f, 3.25f}) m.box(Vec3(x, 0.65f, -0.02f), Vec3(0.08f, 0.65f, 0.08f));
  b.add("posts", m, post, false);
  b.rect("key", Vec3(-2.5f, 3.2f, -4.5f), Vec3(0, 0.4f, 0), 0.9f, 0.6f, Vec3(45.0f, 39.0f, 31.0f));
  b.sun("sun", Vec3(0.75f, 0.9f, -0.8f), Vec3(2.6f, 2.4f, 2.1f));
  b.camera("front", Vec3(1.4f, 2.1f, 5.2f), Vec3(0, 0.45f, 0.6f), 42.0f);
  b.camera("low", Vec3(-2.2f, 0.5f, 2.6f), Vec3(0.4f, 0.45f, 0), 50.0f);
  return b.finish();
}

}  // namespace gobo::builtin
