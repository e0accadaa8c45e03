// SPDX-License-Identifier: Apache-2.0
// grids: receiver plane y = 0, rectangle light "key" of half side 1 at y = 10, two grids of bars between them, at
// distances 6 and 8 from the light (y = 4 and y = 2), so d1 = 10 and d2 in {6, 8} under the centre. The bars are those of
// the penumbra study of Mehta et al. 2012 that docs and tests quote: layer 6: period 1.2, bar 0.4, half extent 2.4; layer 8:
// period 0.9, bar 0.3, half extent 2.7; bars start at whole multiples of the period. Camera "receiver": orthographic, 8 x 8 m
// straight down from just below the grids, +Z down in the picture; at 256 pixels a pixel is 1/32 m. "front": the whole thing.
#include "scene/builtin/build.h"

namespace gobo::builtin {
namespace {

/// Bars along both axes without overlapping triangles: whole strips along z, and the pieces between them along x.
void addGrid(MeshBuilder& m, float y, float period, float bar, float extent) {
  std::vector<Vec2> strips;
  for (int k = int(std::floor(-extent / period)) - 1; k * period < extent; ++k) {
    const float a = std::fmax(k * period, -extent), z = std::fmin(k * period + bar, extent);
    if (z > a) strips.push_back(Vec2(a, z));
  }
  auto cell = [&](float x0, float x1, float z0, float z1) { m.quad(Vec3(x0, y, z1), Vec3(x1 - x0, 0, 0), Vec3(0, 0, z0 - z1)); };
  for (const Vec2& s : strips) cell(s.x, s.y, -extent, extent);
  for (const Vec2& s : strips) {
    float from = -extent;
    for (const Vec2& t : strips) {
      if (t.x > from + 1e-5f) cell(from, t.x, s.x, s.y);
      from = t.y;
    }
    if (extent > from + 1e-5f) cell(from, extent, s.x, s.y);
  }
}

}  // namespace

Result<ScenePtr> grids(const StopToken& stop) {
  SceneBuilder b("grids", stop);
  const int floor = b.material("floor", Vec3(0.7f)), metal = b.material("bars", Vec3(0.35f, 0.2f, 0.12f));
  MeshBuilder m;
  m.quad(Vec3(-8, 0, 8), Vec3(16, 0, 0), Vec3(0, 0, -16));
  b.add("floor", m, floor);
  addGrid(m, 4.0f, 1.2f, 0.4f, 2.4f);
  b.add("grid6", m, metal);
  addGrid(m, 2.0f, 0.9f, 0.3f, 2.7f);
  b.add("grid8", m, metal);
  b.rect("key", Vec3(0, 10, 0), Vec3(0), 1.0f, 1.0f, Vec3(90.0f));
  b.camera("receiver", Vec3(0, 1.5f, 0), Vec3(0), 40.0f);
  Camera& receiver = b.scene().cameras.back();
  receiver.perspective = false;
  receiver.yheight = 8.0f;
  b.camera("front", Vec3(3.5f, 7.5f, 11.0f), Vec3(0, 0.9f, 0), 38.0f);
  return b.finish();
}

}  // namespace gobo::builtin
