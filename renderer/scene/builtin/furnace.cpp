// SPDX-License-Identifier: Apache-2.0
// furnace: every surface of a closed box and of a ball inside it has Lambert albedo a = 0.5 and emits e = 1 in all three
// channels, towards the inside of the box and the outside of the ball. The radiance at every point in every direction is
// then the same: L = e + a L, so L = e / (1 - a) = 2, and after n bounces (emission seen directly = 0 bounces)
// L_n = e (1 - a^(n+1)) / (1 - a). No light outside: a ray that leaks is seen as a dark pixel. Flat shading.
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> furnace(const StopToken& stop) {
  SceneBuilder b("furnace", stop);
  const int grey = b.material("grey", Vec3(0.5f));
  b.at(grey).emission.radiance = Vec3(1.0f);
  MeshBuilder m;
  m.quad(Vec3(-1, -1, 1), Vec3(2, 0, 0), Vec3(0, 0, -2));
  m.quad(Vec3(-1, 1, -1), Vec3(2, 0, 0), Vec3(0, 0, 2));
  m.quad(Vec3(-1, -1, -1), Vec3(2, 0, 0), Vec3(0, 2, 0));
  m.quad(Vec3(1, -1, 1), Vec3(-2, 0, 0), Vec3(0, 2, 0));
  m.quad(Vec3(-1, -1, 1), Vec3(0, 0, -2), Vec3(0, 2, 0));
  m.quad(Vec3(1, -1, -1), Vec3(0, 0, 2), Vec3(0, 2, 0));
  b.add("box", m, grey, false);
  m.sphere(Vec3(0.1f, -0.3f, -0.3f), 0.35f, 24, 12);
  b.add("ball", m, grey, false);
  b.camera("inside", Vec3(-0.3f, 0.3f, 0.9f), Vec3(0.1f, -0.2f, -0.3f), 60.0f);
  return b.finish();
}

}  // namespace gobo::builtin
