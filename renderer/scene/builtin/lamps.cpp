// SPDX-License-Identifier: Apache-2.0
// lamps: a columned hall, 28 x 12 x 6 m, with 1000 small lights "lamp0000" .. "lamp0999" and nothing else: strings of lamps
// between the columns, a field under the ceiling, and candles along the walls. Two of three are points, every third is a
// ball of 3 cm; colours run from amber to cool white. Camera "nave".
#include <cstdio>

#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> lamps(const StopToken& stop) {
  SceneBuilder b("lamps", stop);
  const int floor = b.material("floor", Vec3(1.0f), 0.35f, 0.0f, 0.6f), wall = b.material("wall", Vec3(1.0f)),
            stone = b.material("stone", Vec3(0.62f, 0.58f, 0.5f));
  b.at(floor).albedo.texture = b.texture("tiles", 256, 256, true, [](float u, float v) {
    const float fu = 2 * u - std::floor(2 * u), fv = 2 * v - std::floor(2 * v);
    if (fu < 0.02f || fv < 0.02f) return Vec4(0.12f, 0.11f, 0.1f, 1.0f);
    const bool dark = (int(2 * u) + int(2 * v)) % 2;
    return Vec4((dark ? Vec3(0.2f, 0.15f, 0.13f) : Vec3(0.55f, 0.5f, 0.42f)) * (0.75f + 0.5f * fractalNoise(u, v, 8, 4, dark ? 3 : 4)), 1.0f);
  });
  b.at(floor).albedo.texture.scale = Vec2(14.0f, 6.0f);
  b.at(wall).albedo.texture = b.texture("plaster", 256, 256, true,
                                        [](float u, float v) { return Vec4(Vec3(0.62f, 0.54f, 0.43f) * (0.7f + 0.5f * fractalNoise(u, v, 6, 5, 7)), 1.0f); });
  b.at(wall).albedo.texture.scale = Vec2(7.0f, 2.0f);
  MeshBuilder m;
  const float X = 6.0f, Z = 14.0f, H = 6.0f;
  m.quad(Vec3(-X, 0, Z), Vec3(2 * X, 0, 0), Vec3(0, 0, -2 * Z), 6, 14);
  b.add("floor", m, floor);
  m.quad(Vec3(-X, H, -Z), Vec3(2 * X, 0, 0), Vec3(0, 0, 2 * Z), 6, 14);
  m.quad(Vec3(-X, 0, -Z), Vec3(2 * X, 0, 0), Vec3(0, H, 0));
  m.quad(Vec3(X, 0, Z), Vec3(-2 * X, 0, 0), Vec3(0, H, 0));
  m.quad(Vec3(-X, 0, Z), Vec3(0, 0, -2 * Z), Vec3(0, H, 0));
  m.quad(Vec3(X, 0, -Z), Vec3(0, 0, 2 * Z), Vec3(0, H, 0));
  b.add("walls", m, wall);
  std::vector<Vec2> shaft = {{0.5f, 0.0f}, {0.5f, 0.25f}, {0.42f, 0.3f}, {0.46f, 0.4f}, {0.36f, 0.48f}};
  for (int i = 0; i <= 20; ++i) shaft.push_back(Vec2(0.34f - 0.05f * i / 20.0f + 0.015f * std::sin(kPi * i / 20.0f), 0.55f + 4.6f * i / 20.0f));
  for (const Vec2& p : {Vec2(0.36f, 5.2f), Vec2(0.34f, 5.3f), Vec2(0.5f, 5.55f), Vec2(0.55f, 5.6f), Vec2(0.55f, 5.8f)}) shaft.push_back(p);
  m.lathe(Vec3(0), shaft, 40);
  const int column = b.mesh(m, "column", stone);
  for (int side = 0; side < 2; ++side)
    for (int i = 0; i < 8; ++i) b.instance("column" + std::to_string(side * 8 + i), column, translate(Vec3(side ? 3.4f : -3.4f, 0, -12.0f + 24.0f * i / 7.0f)));
  for (float x : {-3.4f, 3.4f}) m.box(Vec3(x, 5.9f, 0), Vec3(0.5f, 0.1f, Z));
  b.add("beams", m, stone, false);

  for (int i = 0; i < 1000; ++i) {
    char name[16];
    std::snprintf(name, sizeof name, "lamp%04d", i);
    const Vec3 r = random3(501, i), q = random3(502, i);
    Vec3 p;
    if (i % 10 < 4) {  // strings that sag between neighbouring columns on both sides
      const int bay = (i / 10) % 7;
      const float t = r.x, side = (i % 2) ? 1.0f : -1.0f;
      p = Vec3(side * (3.4f - 0.9f + 0.02f * q.x), 4.6f - 1.1f * 4.0f * t * (1.0f - t) - 0.05f * q.y, -12.0f + 24.0f / 7.0f * (bay + t));
    } else if (i % 10 < 8) {  // a field under the ceiling
      p = Vec3(2.4f * (2 * r.x - 1), 4.9f + 0.7f * r.y, 13.0f * (2 * r.z - 1));
    } else {  // candles along the walls
      p = Vec3((i % 2 ? 1.0f : -1.0f) * 5.75f, 0.5f + 2.0f * r.y, 13.5f * (2 * r.z - 1));
    }
    const Vec3 colour = glm::mix(Vec3(1.0f, 0.55f, 0.2f), Vec3(0.75f, 0.9f, 1.15f), q.z * q.z);
    const float strength = 0.4f + 1.2f * q.x * q.x;
    if (i % 3 == 2) b.ball(name, p, 0.03f, colour * (42.0f * strength));
    else b.point(name, p, colour * (0.12f * strength));
  }
  b.camera("nave", Vec3(0.9f, 1.7f, 12.6f), Vec3(-0.3f, 2.3f, -4.0f), 52.0f);
  return b.finish();
}

}  // namespace gobo::builtin
