// SPDX-License-Identifier: Apache-2.0
// spheres: 6 x 5 spheres on a floor; columns go from diffuse over glossy plastic, rough and smooth metal to glass. Rectangle
// light "key", clear sky environment without its sun disk. Camera "front".
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> spheres(const StopToken& stop) {
  SceneBuilder b("spheres", stop);
  const int floor = b.material("floor", Vec3(1.0f));
  b.at(floor).albedo.texture = b.texture("checker", 64, 64, true, [](float u, float v) { return Vec4(Vec3((u < 0.5f) == (v < 0.5f) ? 0.55f : 0.22f), 1.0f); });
  b.at(floor).albedo.texture.scale = Vec2(8.0f);
  MeshBuilder m;
  m.quad(Vec3(-8, 0, 8), Vec3(16, 0, 0), Vec3(0, 0, -16));
  b.add("floor", m, floor);
  m.sphere(Vec3(0), 0.45f, 48, 26);
  const Vec3 tints[] = {Vec3(0.75f, 0.3f, 0.22f), Vec3(0.75f, 0.62f, 0.25f), Vec3(0.3f, 0.55f, 0.3f), Vec3(0.25f, 0.4f, 0.7f), Vec3(0.7f)};
  int first = -1;
  for (int row = 0; row < 5; ++row)
    for (int column = 0; column < 6; ++column) {
      const std::string name = "sphere" + std::to_string(row) + std::to_string(column);
      int k = 0;
      switch (column) {
        case 0: k = b.material(name, tints[row]); break;
        case 1: k = b.material(name, tints[row], 0.4f, 0.0f, 1.0f); break;
        case 2: k = b.material(name, tints[row], 0.12f, 0.0f, 1.0f); break;
        case 3: k = b.material(name, tints[row] * 0.5f + Vec3(0.45f), 0.5f, 1.0f, 1.0f); break;
        case 4: k = b.material(name, tints[row] * 0.3f + Vec3(0.65f), 0.08f + 0.05f * row, 1.0f, 1.0f); break;
        default:
          k = b.material(name, Vec3(0.97f), 0.0f, 0.0f, 1.0f);
          b.at(k).bsdf.transmission = 1.0f;
          b.at(k).bsdf.thickness = 0.9f;  // solid
      }
      // A mesh carries its material, so each sphere is its own mesh; the arrays are copies of the first.
      int mesh;
      if (first < 0) mesh = first = b.mesh(m, name, k);
      else {
        auto copy = std::make_shared<Mesh>(*b.scene().meshes[first]);
        copy->name = name;
        copy->material = k;
        b.scene().meshes.push_back(copy);
        mesh = int(b.scene().meshes.size() - 1);
      }
      b.instance(name, mesh, translate(Vec3(-2.75f + 1.1f * column, 0.45f, -2.6f + 1.1f * row)));
    }
  SkyParameters sky;
  sky.sunScale = 0.0f;
  sky.sunDirection = Vec3(0.3f, 0.5f, 0.6f);
  b.environment(skyEnvironment(sky, 128), Vec3(0.4f));
  b.rect("key", Vec3(-3.5f, 5.0f, 2.5f), Vec3(0, 0.3f, -0.4f), 0.8f, 0.8f, Vec3(26.0f, 24.0f, 20.0f));
  b.camera("front", Vec3(1.0f, 4.2f, 6.6f), Vec3(0, 0.15f, -0.35f), 36.0f);
  return b.finish();
}

}  // namespace gobo::builtin
