// SPDX-License-Identifier: Apache-2.0
// trees: a grove of 40 trees. Leaves are alpha-masked cards; a crown is some instances of two clump meshes and every tree
// shares one trunk mesh, so 3 meshes make about 640 instances. Lights: "sun" (directional) and a clear sky. Cameras "front"
// and "under".
#include "scene/builtin/build.h"

namespace gobo::builtin {
namespace {

/// Two pointed leaves on a stalk: alpha is 1 inside a leaf outline, 0 outside; colour varies along the veins.
Vec4 leafTexel(float u, float v) {
  float inside = 0.0f, vein = 0.0f;
  for (int k = 0; k < 2; ++k) {
    // Leaf frame: t along the leaf, s across it.
    const float cx = k ? 0.72f : 0.28f, cy = 0.42f, lean = k ? 0.5f : -0.5f;
    const float x = u - cx, y = v - cy, c = std::cos(lean), s = std::sin(lean);
    const float across = c * x + s * y, along = (-s * x + c * y) / 0.42f;
    const float half = 0.17f * std::sqrt(std::fmax(0.0f, 1.0f - along * along)) * (1.0f - 0.35f * along);
    if (std::fabs(along) < 1.0f && std::fabs(across) < half) {
      inside = 1.0f;
      vein = std::fmax(std::exp(-sqr(across / 0.012f)), 0.5f * std::exp(-sqr(std::sin(9.0f * along + 20.0f * std::fabs(across)) / 0.3f)));
    }
  }
  if (std::fabs(u - 0.5f) < 0.015f && v > 0.4f) inside = 1.0f;
  const float shade = 0.8f + 0.4f * fractalNoise(u, v, 6, 3, 11);
  return Vec4((Vec3(0.09f, 0.22f, 0.045f) * shade + Vec3(0.09f, 0.12f, 0.04f) * vein), inside);
}

void addClump(MeshBuilder& m, int cards, uint32_t seed) {
  for (int i = 0; i < cards; ++i) {
    const Vec3 r = random3(seed, 3 * i), q = random3(seed, 3 * i + 1), w = random3(seed, 3 * i + 2);
    const float z = 2.0f * r.x - 1.0f, azimuth = 2.0f * kPi * r.y, radius = 0.85f * std::cbrt(0.25f + 0.75f * r.z);
    const float s = std::sqrt(1.0f - z * z);
    const Vec3 outward(s * std::cos(azimuth), z, s * std::sin(azimuth));
    // Cards hang: they face roughly outwards and up, turned at random about that direction.
    const Frame f(glm::normalize(outward + Vec3(0, 0.7f, 0) + (q - Vec3(0.5f)) * 1.2f));
    const float turn = 2.0f * kPi * w.x, size = 0.13f + 0.06f * w.y;
    const Vec3 u = (f.x * std::cos(turn) + f.y * std::sin(turn)) * size, v = glm::cross(f.z, u);
    m.quad(outward * radius * Vec3(1, 0.8f, 1) - u - v, u * 2.0f, v * 2.0f);
  }
}

}  // namespace

Result<ScenePtr> trees(const StopToken& stop) {
  SceneBuilder b("trees", stop);
  const int ground = b.material("ground", Vec3(1.0f)), bark = b.material("bark", Vec3(1.0f)), leaf = b.material("leaf", Vec3(1.0f));
  b.at(ground).albedo.texture = b.texture("grass", 256, 256, true, [](float u, float v) {
    const float a = fractalNoise(u, v, 8, 5, 1), c = fractalNoise(u, v, 32, 3, 9);
    return Vec4(glm::mix(Vec3(0.2f, 0.26f, 0.09f), Vec3(0.34f, 0.3f, 0.17f), clamp01(2.2f * a - 0.7f)) * (0.6f + 0.8f * c), 1.0f);
  });
  b.at(ground).albedo.texture.scale = Vec2(12.0f);
  b.at(bark).albedo.texture = b.texture(
      "bark", 128, 128, true, [](float u, float v) { return Vec4(Vec3(0.24f, 0.17f, 0.11f) * (0.45f + 1.1f * fractalNoise(u, 0.25f * v, 12, 4, 5)), 1.0f); });
  const TextureRef card = b.texture("leaf", 128, 128, true, leafTexel);
  b.at(leaf).albedo.texture = card;
  b.at(leaf).coverage.texture = card;
  b.at(leaf).coverage.mode = AlphaMode::Mask;

  MeshBuilder m;
  m.quad(Vec3(-40, 0, 40), Vec3(80, 0, 0), Vec3(0, 0, -80), 4, 4);
  b.add("ground", m, ground);
  auto limb = [&](const Vec3& from, const Vec3& to, float r0, float r1, float bend, uint32_t seed) {
    std::vector<Vec3> path;
    std::vector<float> radii;
    for (int i = 0; i <= 10; ++i) {
      const float t = i / 10.0f;
      const Vec3 wobble = (random3(seed, 1) - Vec3(0.5f)) * bend * std::sin(kPi * t);
      path.push_back(glm::mix(from, to, t) + Vec3(wobble.x, 0.3f * wobble.y, wobble.z));
      radii.push_back(glm::mix(r0, r1, t) * (1.0f + 0.6f * std::exp(-12.0f * t) * (from.y <= 0.0f ? 1.0f : 0.0f)));
    }
    m.tube(path, radii, 10);
  };
  limb(Vec3(0, -0.05f, 0), Vec3(0.1f, 3.4f, -0.1f), 0.17f, 0.07f, 0.5f, 1);
  for (int i = 0; i < 6; ++i) {
    const float a = 2.0f * kPi * i / 6.0f + 0.4f, y = 1.5f + 0.25f * i;
    limb(Vec3(0.02f * y, y, -0.02f * y), Vec3(1.15f * std::cos(a), y + 0.9f, 1.15f * std::sin(a)), 0.07f, 0.02f, 0.4f, 10 + i);
  }
  const int trunk = b.mesh(m, "trunk", bark);
  addClump(m, 150, 21);
  const int clumpA = b.mesh(m, "clump-a", leaf);
  addClump(m, 180, 22);
  const int clumpB = b.mesh(m, "clump-b", leaf);

  int tree = 0;
  for (int row = 0; row < 5; ++row)
    for (int column = 0; column < 8; ++column, ++tree) {
      const Vec3 r = random3(301, tree), q = random3(302, tree);
      const Vec3 place((column - 3.5f) * 3.6f + 1.6f * (r.x - 0.5f), 0, -3.6f * row + 1.6f * (r.y - 0.5f) + 1.0f);
      const Mat4 frame = translate(place) * rotateY(2.0f * kPi * r.z) * scale(Vec3(0.85f + 0.4f * q.x));
      const std::string name = "tree" + std::to_string(tree);
      b.instance(name + "-trunk", trunk, frame);
      for (int i = 0; i < 15; ++i) {
        const Vec3 w = random3(303, 100 * tree + i), s = random3(304, 100 * tree + i);
        const float a = 2.0f * kPi * (i < 6 ? i / 6.0f + 0.064f : w.x), out = i < 6 ? 1.05f : 0.85f * std::sqrt(w.y);
        const Vec3 at(out * std::cos(a), i < 6 ? 2.45f + 0.25f * i : 2.7f + 1.5f * w.z, out * std::sin(a));
        b.instance(name + "-clump" + std::to_string(i), s.x < 0.5f ? clumpA : clumpB,
                   frame * translate(at) * rotate(glm::normalize(s + Vec3(0.01f)), 6.0f * s.y) * scale(Vec3(0.6f + 0.3f * s.z)));
      }
    }
  SkyParameters sky;
  sky.sunDirection = Vec3(0.45f, 0.75f, 0.5f);
  sky.sunScale = 0.0f;
  b.environment(skyEnvironment(sky, 256), Vec3(0.5f));
  b.sun("sun", sky.sunDirection, Vec3(7.0f, 6.5f, 5.5f));
  b.camera("front", Vec3(4.0f, 2.2f, 12.0f), Vec3(-0.5f, 2.3f, -3.0f), 40.0f);
  b.camera("under", Vec3(0.3f, 1.5f, 3.2f), Vec3(-1.5f, 1.9f, -6.0f), 60.0f);
  return b.finish();
}

}  // namespace gobo::builtin
