// SPDX-License-Identifier: Apache-2.0
// atrium: a two-storey colonnade around a court open to the sky; 24 x 14 m. About 430 000 triangles, most of them in
// instanced columns and balusters. Procedural textures give base colour, normals and roughness. Lights: clear sky, "sun"
// (directional), spots "spot0".."spot3" in the corners, points "lantern0".."lantern5" in the galleries. Cameras "court" (from
// the ground) and "gallery" (from the upper floor).
#include "scene/builtin/build.h"

namespace gobo::builtin {
namespace {

constexpr float kX = 7.0f, kZ = 12.0f;           // half size of the whole
constexpr float kInnerX = 4.2f, kInnerZ = 9.2f;  // half size of the court, where the columns stand
constexpr float kStorey = 4.0f;

int columnMesh(SceneBuilder& b, MeshBuilder& m, const std::string& name, int material, float height, float radius) {
  std::vector<Vec2> p = {{1.5f, 0.0f}, {1.5f, 0.10f}, {1.3f, 0.13f}};
  for (int i = 0; i <= 8; ++i) p.push_back(Vec2(1.25f + 0.17f * std::sin(kPi * i / 8.0f), 0.14f + 0.012f * i));
  for (int i = 0; i <= 32; ++i) {
    const float t = i / 32.0f;
    p.push_back(Vec2(1.05f - 0.2f * t * t + 0.12f * std::exp(-40.0f * t), 0.27f + (height - 0.8f) * t));
  }
  for (int i = 0; i <= 14; ++i) {
    const float t = i / 14.0f;
    p.push_back(Vec2(0.86f + 0.08f * std::sin(2.0f * kPi * std::fmin(2.0f * t, 1.0f)) + 0.6f * t * t, height - 0.5f + 0.4f * t));
  }
  p.push_back({1.6f, height - 0.08f});
  p.push_back({1.6f, height});
  for (Vec2& v : p) v.x *= radius;
  m.lathe(Vec3(0), p, 56, 0.8f);
  return b.mesh(m, name, material);
}

/// Half-round arch between two columns `span` apart: front, back and soffit of a wall with a round opening, in the x-y plane.
int archMesh(SceneBuilder& b, MeshBuilder& m, int material, float span, float rise, float top) {
  constexpr int n = 24;
  const float depth = 0.22f, r = 0.5f * span;
  auto at = [&](int i) {
    const float a = kPi * i / n;
    return Vec2(-r * std::cos(a), rise * std::sin(a));
  };
  for (int i = 0; i < n; ++i) {
    const Vec2 p = at(i), q = at(i + 1);
    for (float side : {1.0f, -1.0f}) {
      const float z = side * depth;
      const Vec3 nrm(0, 0, side);
      auto v = [&](const Vec2& s) { return m.vertex(Vec3(s.x, s.y, z), nrm, s * 0.5f); };
      const uint32_t a = v(p), c = v(q), d = v(Vec2(q.x, top)), e = v(Vec2(p.x, top));
      if (side > 0) {
        m.triangle(a, c, d);
        m.triangle(a, d, e);
      } else {
        m.triangle(a, d, c);
        m.triangle(a, e, d);
      }
    }
    const Vec3 np = -glm::normalize(Vec3(p.x / (r * r), p.y / (rise * rise), 0)), nq = -glm::normalize(Vec3(q.x / (r * r), q.y / (rise * rise), 0));
    const float s = float(i) / n, t = float(i + 1) / n;
    const uint32_t a = m.vertex(Vec3(p, depth), np, Vec2(2 * s, 0)), c = m.vertex(Vec3(q, depth), nq, Vec2(2 * t, 0));
    const uint32_t d = m.vertex(Vec3(q, -depth), nq, Vec2(2 * t, 0.22f)), e = m.vertex(Vec3(p, -depth), np, Vec2(2 * s, 0.22f));
    m.triangle(a, d, c);
    m.triangle(a, e, d);
  }
  return b.mesh(m, "arch" + std::to_string(b.scene().meshes.size()), material);
}

struct Stones {
  int floor, plaster, marble, brick, wood;
};

Stones makeMaterials(SceneBuilder& b) {
  Stones s{b.material("floor", Vec3(1.0f), 1.0f, 0.0f, 1.0f), b.material("plaster", Vec3(1.0f), 1.0f, 0.0f, 0.4f),
           b.material("marble", Vec3(1.0f), 1.0f, 0.0f, 0.8f), b.material("brick", Vec3(1.0f), 1.0f, 0.0f, 0.3f), b.material("wood", Vec3(0.3f, 0.18f, 0.1f))};
  auto tile = [](float u, float v) { return std::fmin(std::fmin(u, 1 - u), std::fmin(v, 1 - v)); };  // distance to the joint
  b.at(s.floor).albedo.texture = b.texture("floor-colour", 512, 512, true, [&](float u, float v) {
    const float x = 4 * u, y = 4 * v, joint = tile(x - std::floor(x), y - std::floor(y));
    const uint32_t id = uint32_t(int(x) + 4 * int(y));
    const Vec3 tint = glm::mix(Vec3(0.58f, 0.5f, 0.4f), Vec3(0.42f, 0.3f, 0.24f), ((int(x) + int(y)) & 1) ? 1.0f : 0.15f * random3(1, id).x);
    return Vec4(joint < 0.02f ? Vec3(0.16f) : tint * (0.75f + 0.5f * fractalNoise(u, v, 12, 5, id)), 1.0f);
  });
  b.at(s.floor).bsdf.metallicRoughness = b.texture("floor-roughness", 256, 256, false, [&](float u, float v) {
    const float x = 4 * u, y = 4 * v;
    return Vec4(0.0f, tile(x - std::floor(x), y - std::floor(y)) < 0.02f ? 0.95f : 0.25f + 0.4f * fractalNoise(u, v, 10, 4, 31), 0.0f, 1.0f);
  });
  b.at(s.floor).bsdf.normal = b.normalMap("floor-normal", 256, 2.0f, [&](float u, float v) {
    const float x = 4 * u, y = 4 * v;
    return 0.006f * clamp01(tile(x - std::floor(x), y - std::floor(y)) / 0.04f) + 0.003f * fractalNoise(u, v, 16, 3, 32);
  });
  b.at(s.plaster).albedo.texture = b.texture("plaster-colour", 256, 256, true, [](float u, float v) {
    const float stain = fractalNoise(u, v, 4, 5, 41);
    return Vec4(glm::mix(Vec3(0.7f, 0.6f, 0.46f), Vec3(0.55f, 0.42f, 0.3f), clamp01(3.0f * stain - 1.3f)), 1.0f);
  });
  b.at(s.plaster).bsdf.normal = b.normalMap("plaster-normal", 256, 2.0f, [](float u, float v) { return 0.02f * fractalNoise(u, v, 10, 5, 42); });
  b.at(s.plaster).bsdf.metallicRoughness =
      b.texture("plaster-roughness", 64, 64, false, [](float u, float v) { return Vec4(0.0f, 0.75f + 0.25f * fractalNoise(u, v, 8, 2, 43), 0.0f, 1.0f); });
  b.at(s.marble).albedo.texture = b.texture("marble-colour", 256, 256, true, [](float u, float v) {
    const float warp = fractalNoise(u, v, 4, 5, 51), vein = std::fabs(std::sin(2.0f * kPi * (2.0f * u + v + 2.2f * warp)));
    return Vec4(glm::mix(Vec3(0.4f, 0.37f, 0.36f), Vec3(0.76f, 0.73f, 0.68f), std::pow(vein, 0.35f)), 1.0f);
  });
  b.at(s.marble).bsdf.metallicRoughness =
      b.texture("marble-roughness", 64, 64, false, [](float u, float v) { return Vec4(0.0f, 0.3f + 0.3f * fractalNoise(u, v, 6, 3, 52), 0.0f, 1.0f); });
  auto brick = [&](float u, float v) {  // 4 x 8 bricks in running bond: distance to the joint in brick heights
    const float y = 8 * v, x = 4 * u + ((int(y) & 1) ? 0.5f : 0.0f), fx = x - std::floor(x), fy = y - std::floor(y);
    return std::fmin(2.0f * std::fmin(fx, 1 - fx), std::fmin(fy, 1 - fy));
  };
  b.at(s.brick).albedo.texture = b.texture("brick-colour", 256, 256, true, [&](float u, float v) {
    const int row = int(8 * v), column = int(4 * u + ((row & 1) ? 0.5f : 0.0f)) % 4;
    const Vec3 r = random3(61, row * 4 + column), clay = glm::mix(Vec3(0.5f, 0.24f, 0.16f), Vec3(0.62f, 0.38f, 0.25f), r.x);
    return Vec4((brick(u, v) < 0.09f ? Vec3(0.5f, 0.47f, 0.42f) : clay) * (0.75f + 0.5f * fractalNoise(u, v, 16, 3, 62)), 1.0f);
  });
  b.at(s.brick).bsdf.normal =
      b.normalMap("brick-normal", 256, 1.0f, [&](float u, float v) { return 0.012f * clamp01(brick(u, v) / 0.15f) + 0.006f * fractalNoise(u, v, 24, 3, 63); });
  return s;
}

void addShell(SceneBuilder& b, MeshBuilder& m, const Stones& s) {
  m.quad(Vec3(-kX, 0, kZ), Vec3(2 * kX, 0, 0), Vec3(0, 0, -2 * kZ), 14, 24, Vec2(kX, kZ));
  b.add("floor", m, s.floor);
  const float h = 2 * kStorey;
  m.quad(Vec3(-kX, 0, -kZ), Vec3(2 * kX, 0, 0), Vec3(0, h, 0), 1, 1, Vec2(2 * kX, h) * 0.5f);
  m.quad(Vec3(kX, 0, kZ), Vec3(-2 * kX, 0, 0), Vec3(0, h, 0), 1, 1, Vec2(2 * kX, h) * 0.5f);
  b.add("end-walls", m, s.plaster);
  m.quad(Vec3(-kX, 0, kZ), Vec3(0, 0, -2 * kZ), Vec3(0, h, 0), 1, 1, Vec2(2 * kZ, h));
  m.quad(Vec3(kX, 0, -kZ), Vec3(0, 0, 2 * kZ), Vec3(0, h, 0), 1, 1, Vec2(2 * kZ, h));
  b.add("side-walls", m, s.brick);
  // Gallery slabs and roof of the walk: frames around the court.
  for (int storey = 1; storey <= 2; ++storey) {
    const float y = storey * kStorey, inX = kInnerX - 0.35f, inZ = kInnerZ - 0.35f, midX = 0.5f * (kX + inX), midZ = 0.5f * (kZ + inZ), t = 0.12f;
    for (float side : {-1.0f, 1.0f}) {
      m.box(Vec3(side * midX, y + t, 0), Vec3(kX - midX, t, kZ), Mat4(1.0f), 0.5f);
      m.box(Vec3(0, y + t, side * midZ), Vec3(inX, t, kZ - midZ), Mat4(1.0f), 0.5f);
    }
    b.add(storey == 1 ? "gallery" : "roof", m, s.plaster);
  }
}

}  // namespace

Result<ScenePtr> atrium(const StopToken& stop) {
  SceneBuilder b("atrium", stop);
  const Stones s = makeMaterials(b);
  MeshBuilder m;
  addShell(b, m, s);
  const float deck = kStorey + 0.24f, spring = 2.7f, upperSpring = 2.55f;
  const int lower = columnMesh(b, m, "column-lower", s.marble, spring, 0.24f), upper = columnMesh(b, m, "column-upper", s.marble, upperSpring, 0.17f);
  // Columns at equal spacing along both sides of the court; corners belong to the long sides.
  constexpr int alongZ = 8, alongX = 4;
  const float stepZ = 2 * kInnerZ / (alongZ - 1), stepX = 2 * kInnerX / (alongX - 1);
  const int archZ = archMesh(b, m, s.plaster, stepZ - 0.3f, 1.0f, kStorey - spring), archX = archMesh(b, m, s.plaster, stepX - 0.3f, 1.0f, kStorey - spring);
  const int archZ2 = archMesh(b, m, s.plaster, stepZ - 0.3f, 0.95f, kStorey - 0.24f - upperSpring),
            archX2 = archMesh(b, m, s.plaster, stepX - 0.3f, 0.95f, kStorey - 0.24f - upperSpring);
  std::vector<Vec2> turned;
  for (int i = 0; i <= 22; ++i) {
    const float t = i / 22.0f;
    turned.push_back(Vec2(0.025f + 0.04f * sqr(std::sin(kPi * std::pow(t, 0.6f))) + 0.012f * std::cos(12.0f * t), 0.82f * t));
  }
  m.lathe(Vec3(0), turned, 20, 2.0f);
  const int baluster = b.mesh(m, "baluster", s.marble);
  for (float side : {-1.0f, 1.0f}) {
    m.box(Vec3(side * kInnerX, deck + 0.86f, 0), Vec3(0.08f, 0.05f, kInnerZ), Mat4(1.0f));
    m.box(Vec3(0, deck + 0.86f, side * kInnerZ), Vec3(kInnerX, 0.05f, 0.08f), Mat4(1.0f));
  }
  b.add("handrails", m, s.wood);
  int columns = 0, arches = 0, posts = 0;
  auto column = [&](float x, float z) {
    const std::string k = std::to_string(columns++);
    b.instance("column-lower" + k, lower, translate(Vec3(x, 0, z)));
    b.instance("column-upper" + k, upper, translate(Vec3(x, deck, z)));
  };
  auto bay = [&](const Vec3& middle, float turn, int low, int high, float step) {
    const std::string k = std::to_string(arches++);
    b.instance("arch-lower" + k, low, translate(middle + Vec3(0, spring, 0)) * rotateY(turn));
    b.instance("arch-upper" + k, high, translate(middle + Vec3(0, deck + upperSpring, 0)) * rotateY(turn));
    const int n = int(step / 0.28f);
    for (int i = 1; i < n; ++i)
      b.instance("baluster" + std::to_string(posts++), baluster,
                 translate(middle + Vec3(0, deck, 0)) * rotateY(turn) * translate(Vec3(step * (float(i) / n - 0.5f), 0, 0)));
  };
  for (float side : {-1.0f, 1.0f}) {
    for (int i = 0; i < alongZ; ++i) column(side * kInnerX, -kInnerZ + stepZ * i);
    for (int i = 0; i + 1 < alongZ; ++i) bay(Vec3(side * kInnerX, 0, -kInnerZ + stepZ * (i + 0.5f)), 0.5f * kPi, archZ, archZ2, stepZ);
    for (int i = 1; i + 1 < alongX; ++i) column(-kInnerX + stepX * i, side * kInnerZ);
    for (int i = 0; i + 1 < alongX; ++i) bay(Vec3(-kInnerX + stepX * (i + 0.5f), 0, side * kInnerZ), 0.0f, archX, archX2, stepX);
  }
  SkyParameters sky;
  sky.sunDirection = Vec3(0.5f, 1.0f, 0.28f);
  sky.sunScale = 0.0f;
  b.environment(skyEnvironment(sky, 256), Vec3(0.5f));
  b.sun("sun", sky.sunDirection, Vec3(8.0f, 7.3f, 6.2f));
  for (int i = 0; i < 4; ++i) {
    const float x = (i & 1) ? 1.0f : -1.0f, z = (i & 2) ? 1.0f : -1.0f;
    b.spot("spot" + std::to_string(i), Vec3(x * 5.6f, 3.7f, z * 10.4f), Vec3(x * 5.0f, 0, z * 8.0f), 38.0f, Vec3(5.0f, 3.8f, 2.2f));
  }
  for (int i = 0; i < 6; ++i)
    b.point("lantern" + std::to_string(i), Vec3((i & 1 ? 1.0f : -1.0f) * 5.6f, i < 2 ? 6.9f : 2.8f, -6.0f + 6.0f * (i / 2)), Vec3(1.5f, 1.0f, 0.5f));
  b.camera("court", Vec3(-2.9f, 1.6f, 8.4f), Vec3(0.9f, 3.3f, -5.0f), 66.0f);
  b.camera("gallery", Vec3(-5.9f, deck + 1.65f, 8.0f), Vec3(2.0f, 2.6f, -4.0f), 65.0f);
  return b.finish();
}

}  // namespace gobo::builtin
