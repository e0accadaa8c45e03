// SPDX-License-Identifier: Apache-2.0
#include "shadow/scenes.h"

#include <cmath>
#include <filesystem>

#include "import/load.h"
#include "scene/builtin/build.h"
#include "scene/edit.h"

namespace gobo::shadowbench {
namespace {

using namespace builtin;

struct Box {
  Vec3 centre, half;
};
/// Casters of the two closed-form scenes. The plate's edge at x = 0 is a half plane as far as the light and the camera are concerned.
const Box kPlate{Vec3(-6.0f, 2.0f, 0.0f), Vec3(6.0f, 0.01f, 12.0f)};
const Box kBoxes[] = {{Vec3(0.0f, 0.5f, 0.0f), Vec3(0.5f)},
                      {Vec3(1.6f, 0.15f, 0.6f), Vec3(0.25f, 0.15f, 0.4f)},
                      {Vec3(-1.5f, 1.0f, -0.8f), Vec3(0.2f, 1.0f, 0.2f)},
                      {Vec3(0.4f, 1.6f, 0.2f), Vec3(0.6f, 0.03f, 0.1f)}};

void lights(SceneBuilder& b, const Vec3& at, const Vec3& target, float half) {
  b.rect("key", at, target, half, half, Vec3(60.0f));
  b.sun("sun", at - target, Vec3(3.0f));
}

Result<ScenePtr> planes() {
  SceneBuilder b("planes");
  const int floor = b.material("floor", Vec3(0.6f)), plate = b.material("plate", Vec3(0.3f));
  MeshBuilder m;
  m.quad(Vec3(-4, 0, 4), Vec3(8, 0, 0), Vec3(0, 0, -8));
  b.add("floor", m, floor);
  m.box(kPlate.centre, kPlate.half);
  b.add("plate", m, plate, false);
  b.rect("key", Vec3(0, 6, 0), Vec3(0), 0.5f, 0.5f, Vec3(60.0f));
  b.sun("sun", Vec3(0.2f, 1.0f, 0.1f), Vec3(3.0f));
  b.camera("front", Vec3(2.5f, 1.6f, 2.5f), Vec3(0.2f, 0.0f, 0.0f), 45.0f);
  return b.finish();
}

Result<ScenePtr> boxes() {
  SceneBuilder b("boxes");
  const int floor = b.material("floor", Vec3(0.6f)), paint = b.material("paint", Vec3(0.7f, 0.4f, 0.2f));
  MeshBuilder m;
  m.quad(Vec3(-5, 0, 5), Vec3(10, 0, 0), Vec3(0, 0, -10));
  b.add("floor", m, floor);
  for (const Box& x : kBoxes) m.box(x.centre, x.half);
  b.add("boxes", m, paint, false);
  lights(b, Vec3(2.5f, 5.0f, 2.0f), Vec3(0, 0.3f, 0), 0.4f);
  b.camera("front", Vec3(-2.0f, 3.2f, 5.5f), Vec3(-0.2f, 0.5f, 0), 42.0f);
  return b.finish();
}

/// Two of the built-in grove's trees alone, as in the thesis's Figure 6.6.
Result<ScenePtr> twoTrees() {
  GOBO_ASSIGN(const ScenePtr grove, makeBuiltinScene("trees"));
  return editScene(*grove, [](Scene& s) -> Status {
    std::erase_if(s.instances,
                  [](const Instance& i) { return i.name.rfind("tree", 0) == 0 && i.name.rfind("tree3-", 0) != 0 && i.name.rfind("tree4-", 0) != 0; });
    s.name = "two-trees";
    for (Instance& i : s.instances)
      if (i.name == "ground") i.toWorld = i.toWorld * scale(Vec3(0.25f, 1.0f, 0.25f));  // 20 m: the map is the trees', not the meadow's
    Light key;
    key.name = "key";
    key.shape.kind = LightKind::Rect;
    key.shape.position = Vec3(5.0f, 9.0f, 6.0f);
    key.shape.axis = glm::normalize(Vec3(0, 1.5f, 0) - key.shape.position);
    const Frame f(key.shape.axis);
    key.shape.u = f.x * 0.6f;
    key.shape.v = f.y * 0.6f;
    key.power = Vec3(80.0f);
    s.lights.push_back(key);
    Camera c = s.cameras[0];
    c.name = "close";
    const Vec3 eye(3.2f, 3.0f, 9.0f), back = glm::normalize(eye - Vec3(-0.2f, 1.0f, 0.0f)), right = glm::normalize(glm::cross(Vec3(0, 1, 0), back));
    c.toWorld = Mat4(Vec4(right, 0), Vec4(glm::cross(back, right), 0), Vec4(back, 0), Vec4(eye, 1));
    s.cameras.push_back(c);
    return {};
  });
}

/// Twenty-five balls of 16 000 triangles with bumps, above and on a floor: 400 000 triangles that neither map nor tracer can cull.
Result<ScenePtr> blobs() {
  SceneBuilder b("blobs");
  const int floor = b.material("floor", Vec3(0.55f)), clay = b.material("clay", Vec3(0.6f, 0.45f, 0.35f));
  MeshBuilder m;
  m.quad(Vec3(-6, 0, 6), Vec3(12, 0, 0), Vec3(0, 0, -12));
  b.add("floor", m, floor);
  constexpr int kSlices = 128, kStacks = 64;
  for (int k = 0; k < 25; ++k) {
    const Vec3 r = random3(7, uint64_t(k)), place((k % 5 - 2) * 1.3f + 0.5f * (r.x - 0.5f), 0.45f + 1.6f * r.y * r.y, (k / 5 - 2) * 1.3f + 0.5f * (r.z - 0.5f));
    const float radius = 0.28f + 0.2f * r.z;
    std::vector<uint32_t> id;
    for (int j = 0; j <= kStacks; ++j)
      for (int i = 0; i <= kSlices; ++i) {
        const float phi = 2.0f * kPi * float(i % kSlices) / kSlices, theta = kPi * float(j) / kStacks;
        const Vec3 n(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
        // Bumps that vanish at the poles, so that the fan closes.
        const float bump = 0.22f * std::sin(theta) * std::sin(5.0f * phi + 6.0f * r.x) * std::sin(6.0f * theta + 3.0f * r.y) +
                           0.05f * std::sin(theta) * std::sin(17.0f * phi) * std::sin(19.0f * theta);
        id.push_back(m.vertex(place + n * (radius * (1.0f + bump)), n, Vec2(0)));
      }
    for (int j = 0; j < kStacks; ++j)
      for (int i = 0; i < kSlices; ++i) {
        const size_t a = size_t(j) * (kSlices + 1) + size_t(i), c = a + kSlices + 1;
        m.triangle(id[a], id[a + 1], id[c]);
        m.triangle(id[c], id[a + 1], id[c + 1]);
      }
  }
  b.add("blobs", m, clay, false);
  lights(b, Vec3(3.0f, 7.0f, 2.5f), Vec3(0), 0.5f);
  b.camera("front", Vec3(3.5f, 4.5f, 7.0f), Vec3(0, 0.4f, 0), 42.0f);
  return b.finish();
}

/// A park bench of 310 000 vertices: round slats on bent legs.
Result<ScenePtr> bench() {
  SceneBuilder b("bench");
  const int floor = b.material("floor", Vec3(0.6f)), wood = b.material("wood", Vec3(0.5f, 0.33f, 0.2f)), iron = b.material("iron", Vec3(0.2f));
  MeshBuilder m;
  m.quad(Vec3(-5, 0, 5), Vec3(10, 0, 0), Vec3(0, 0, -10));
  b.add("floor", m, floor);
  const auto seat = [](float t) {  // across the bench: the seat, then the rest of the back
    return t < 0.55f ? Vec3(0, 0.46f - 0.05f * std::sin(kPi * t / 0.55f), 0.55f - t) : Vec3(0, 0.46f + 1.0f * (t - 0.55f), -0.25f * (t - 0.55f));
  };
  for (int i = 0; i < 14; ++i) {
    std::vector<Vec3> path;
    std::vector<float> radii;
    for (int k = 0; k <= 240; ++k) {
      const float t = float(k) / 240.0f;
      path.push_back(seat(1.05f * float(i) / 13.0f) + Vec3(1.7f * (t - 0.5f), 0, 0));
      radii.push_back(k == 240 ? 0.0f : 0.022f + 0.001f * std::sin(40.0f * t + float(i)));
    }
    m.tube(path, radii, 88);
    b.add("slat" + std::to_string(i), m, wood);
  }
  for (int i = 0; i < 3; ++i) {
    std::vector<Vec3> path;
    std::vector<float> radii;
    for (int k = 0; k <= 120; ++k) {
      const float t = float(k) / 120.0f, a = kPi * t;
      path.push_back(Vec3(0.75f * float(i - 1), 0.42f * std::sin(a) * (1.0f - 0.1f * std::sin(3.0f * a)), 0.3f + 0.34f * std::cos(a)));
      radii.push_back(k == 120 ? 0.0f : 0.025f);
    }
    m.tube(path, radii, 32);
    b.add("leg" + std::to_string(i), m, iron);
  }
  b.rect("key", Vec3(2.2f, 4.0f, 2.6f), Vec3(0, 0.4f, 0), 0.5f, 0.5f, Vec3(60.0f));
  b.camera("front", Vec3(1.3f, 1.6f, 3.0f), Vec3(0, 0.35f, -0.1f), 38.0f);
  return b.finish();
}

/// The built-in fence below slats that lie across it, so that kernels in its shadow hold depths of both (the thesis's Figure 6.9).
Result<ScenePtr> pergola() {
  GOBO_ASSIGN(const ScenePtr fence, makeBuiltinScene("fence"));
  return editScene(*fence, [](Scene& s) -> Status {
    MeshBuilder m;
    for (int i = 0; i < 24; ++i) m.box(Vec3(0.4f + 0.22f * float(i - 12), 2.2f, 0.0f), Vec3(0.055f, 0.02f, 3.0f), rotateY(0.5f));
    s.meshes.push_back(m.finish("slats", 0, false));
    s.instances.push_back({"slats", int(s.meshes.size()) - 1, Mat4(1.0f)});
    s.name = "pergola";
    return {};
  });
}

const char* kSponza = "../shared/data/derived/sponza.glb";  // from the root of the repository, as bench/run calls
std::string sponzaPath() { return std::filesystem::exists(kSponza) ? kSponza : ""; }

bool hitsBox(const DVec3& p, const DVec3& d, double length, const Box& box) {
  double from = 1e-9, to = length;
  for (int k = 0; k < 3; ++k) {
    const double lo = double(box.centre[k]) - double(box.half[k]) - p[k], hi = double(box.centre[k]) + double(box.half[k]) - p[k];
    if (d[k] == 0.0) {
      if (lo > 0 || hi < 0) return false;
      continue;
    }
    double a = lo / d[k], b = hi / d[k];
    if (a > b) std::swap(a, b);
    from = std::max(from, a);
    to = std::min(to, b);
  }
  return from < to;
}

}  // namespace

std::vector<SceneEntry> sceneEntries() {
  std::vector<SceneEntry> list{{"planes", "sun", "key", "front", "a plate over a floor: half plane, closed form"},
                               {"boxes", "sun", "key", "front", "four boxes on a floor: contact, closed form"},
                               {"fence", "sun", "key", "front", "pickets before depth complexity: where variance maps bleed"},
                               {"two-trees", "sun", "key", "close", "alpha-tested leaves"},
                               {"grids", "key", "key", "receiver", "two layers of bars under an area light"},
                               {"blobs", "sun", "key", "front", "400 000 triangles"}};
  if (!sponzaPath().empty()) list.push_back({"sponza", "sun", "key", "atrium", "glTF: Sponza (M. Dabrovic), 66 445 triangles"});
  return list;
}

Result<ScenePtr> benchScene(const std::string& name) {
  if (name == "planes") return planes();
  if (name == "boxes") return boxes();
  if (name == "two-trees") return twoTrees();
  if (name == "blobs") return blobs();
  if (name == "pergola") return pergola();
  if (name == "bench") return bench();
  if (name == "sponza" && sponzaPath().empty()) return notFound(std::string("scene 'sponza': there is no ") + kSponza);
  GOBO_ASSIGN(const ScenePtr scene, loadScene(name == "sponza" ? sponzaPath() : name));
  if (name != "sponza" || scene->findLight("key") >= 0) return scene;
  return editScene(*scene, [](Scene& s) -> Status {  // a square lamp above the open court: inside it walls would lie beyond a map's 75 degrees
    Vec3 lo, hi;
    s.bounds(lo, hi);
    Light key;
    key.name = "key";
    key.shape.kind = LightKind::Rect;
    key.shape.position = Vec3(0.5f * (lo.x + hi.x), lo.y + 1.5f * (hi.y - lo.y), 0.5f * (lo.z + hi.z));
    key.shape.axis = Vec3(0, -1, 0);
    const float half = 0.04f * (hi.x - lo.x);
    key.shape.u = Vec3(half, 0, 0);
    key.shape.v = Vec3(0, 0, half);
    key.power = Vec3(50.0f);
    s.lights.push_back(key);
    return {};
  });
}

Result<ScenePtr> withHardLight(const Scene& scene, int light) {
  return editScene(scene, [&](Scene& s) -> Status {
    LightShape& shape = s.lights[size_t(light)].shape;
    if (shape.kind == LightKind::Rect || shape.kind == LightKind::Disk) {
      shape.kind = LightKind::Spot;
      shape.cosOuter = std::cos(75.0f * kPi / 180.0f);  // as wide as an area light's map
      shape.cosInner = 1.0f;
    } else if (shape.kind == LightKind::Sphere) {
      shape.kind = LightKind::Point;
    }
    return {};
  });
}

Result<ScenePtr> withLightSize(const Scene& scene, int light, float scale) {
  return editScene(scene, [&](Scene& s) -> Status {
    LightShape& shape = s.lights[size_t(light)].shape;
    shape.u *= scale;
    shape.v *= scale;
    shape.radius *= scale;
    return {};
  });
}

Result<ScenePtr> withSunSize(const Scene& scene, int light, double degrees) {
  return editScene(scene, [&](Scene& s) -> Status {
    LightShape& shape = s.lights[size_t(light)].shape;
    if (shape.kind != LightKind::Directional) return invalidArgument("light '" + s.lights[size_t(light)].name + "' is no sun");
    shape.angularSize = float(degrees * M_PI / 180);
    return {};
  });
}

std::function<bool(const DVec3&, const DVec3&, bool)> closedForm(const std::string& scene) {
  std::vector<Box> casters;
  if (scene == "planes") casters = {kPlate};
  else if (scene == "boxes") casters.assign(std::begin(kBoxes), std::end(kBoxes));
  else return {};
  return [casters](const DVec3& p, const DVec3& q, bool direction) {
    const DVec3 d = direction ? q : q - p;
    for (const Box& b : casters)
      if (hitsBox(p, d, direction ? 1e9 : 1.0, b)) return false;
    return true;
  };
}

}  // namespace gobo::shadowbench
