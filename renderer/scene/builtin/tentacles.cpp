// SPDX-License-Identifier: Apache-2.0
// tentacles: 24 bent, tapered tubes that rise from a floor and curl over it: curved, self-shadowing occluders of every
// width and distance. Light "key": a rectangle above. Camera "front".
#include "base/sobol.h"
#include "scene/builtin/build.h"

namespace gobo::builtin {

Result<ScenePtr> tentacles(const StopToken& stop) {
  SceneBuilder b("tentacles", stop);
  const int floor = b.material("floor", Vec3(0.6f, 0.57f, 0.52f));
  const int skin[] = {b.material("violet", Vec3(0.42f, 0.22f, 0.4f)), b.material("teal", Vec3(0.16f, 0.42f, 0.4f)),
                      b.material("ochre", Vec3(0.6f, 0.4f, 0.15f))};
  MeshBuilder m;
  m.quad(Vec3(-9, 0, 9), Vec3(18, 0, 0), Vec3(0, 0, -18));
  b.add("floor", m, floor);
  constexpr int count = 24, rows = 161, slices = 16;
  for (int i = 0; i < count; ++i) {
    const Vec3 r = random3(101, i), q = random3(102, i);
    const float ring = i < 8 ? 0.55f : 1.5f, angle = 2.0f * kPi * (i < 8 ? i / 8.0f : (i - 8) / 16.0f) + 0.3f * r.x;
    Vec3 p(ring * std::cos(angle), -0.02f, ring * std::sin(angle));
    const Vec3 out(std::cos(angle), 0, std::sin(angle)), side(-out.z, 0, out.x);
    const float length = (i < 8 ? 2.9f : 2.3f) * (0.85f + 0.3f * r.y), base = 0.16f + 0.05f * r.z;
    std::vector<Vec3> path;
    std::vector<float> radii;
    for (int k = 0; k < rows; ++k) {
      const float t = float(k) / (rows - 1);
      path.push_back(p);
      radii.push_back(base * (k + 1 == rows ? 0.0f : std::pow(1.0f - t, 0.8f) * (1.0f + 0.06f * std::sin(60.0f * t))));
      // Heading: upright at the foot, then leaning outwards and curling, more the nearer the tip.
      const float lean = (1.5f + 1.6f * q.x) * t * t + 0.15f, sway = 0.7f * std::sin(4.0f * t + 6.28f * q.y);
      Vec3 heading = Vec3(0, 1, 0) * std::cos(lean) + out * std::sin(lean) + side * sway * t;
      p += glm::normalize(heading) * (length / (rows - 1));
      if (t > 0.4f) p.y = std::fmax(p.y, radii.back() + 0.02f);  // a tip that comes down lies on the floor
    }
    m.tube(path, radii, slices);
    b.add("tentacle" + std::to_string(i), m, skin[i % 3]);
  }
  b.rect("key", Vec3(2.5f, 6.5f, 2.5f), Vec3(0, 0.5f, 0), 1.0f, 1.0f, Vec3(58.0f, 55.0f, 50.0f));
  b.camera("front", Vec3(0.8f, 3.6f, 6.6f), Vec3(0, 0.85f, 0), 40.0f);
  return b.finish();
}

}  // namespace gobo::builtin
