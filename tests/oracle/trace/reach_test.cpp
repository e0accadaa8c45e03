// SPDX-License-Identifier: Apache-2.0
// Every kind of light x everything that light may have to come through x visibility: the path tracer against light tracing (support/light_tracer.h).
// They agree, or the certificate names the class (trace/reach.h, plan/material_kinds.h), and then the tracer has no more than the truth.
#include <gtest/gtest.h>

#include <cmath>

#include "plan/planner.h"
#include "request/material_kinds.h"
#include "support/light_tracer.h"
#include "support/thorough.h"
#include "trace/photon_tracer.h"
#include "trace/reach.h"

namespace gobo::reach_test {
namespace {

using namespace tests;

const Vec3 kLampAt(0.0f, 1.6f, 0.0f);
constexpr float kLampSize = 0.45f;

/// What stands between lamp and floor: the geometry, and the passages that direct light must take.
struct Barrier {
  const char* name;
  Passage passage;                                                         ///< of light from the lamp to the floor; Open too where some has another way
  bool scatters = false;                                                   ///< there are receivers inside a volume
  bool alsoSpecular = false;                                               ///< a second class beside `passage`: named, but little or none of the light
  bool around = false;                                                     ///< encloses lamps that have a place
  int effort = 1;                                                          ///< samples, relative to an empty stage
  std::function<int(SceneMaker&)> build = [](SceneMaker&) { return -1; };  ///< returns the material around such lamps
};

std::function<void(Material&)> clear(float ior, float roughness, float thickness, const std::function<void(Bsdf&)>& change = {}) {
  return [=](Material& x) {
    x.bsdf = {};
    x.bsdf.transmission = 1;
    x.bsdf.ior = ior;
    x.bsdf.roughness = roughness;
    x.bsdf.thickness = thickness;
    if (change) change(x.bsdf);
  };
}
std::function<void(Material&)> filled(float ior, float roughness, float left, float way, float scatter) {
  return clear(ior, roughness, 1.0f, [=](Bsdf& b) {
    b.attenuationColor = Vec3(left);
    b.attenuationDistance = way;
    b.scatterAlbedo = Vec3(scatter);
    b.scatterAnisotropy = scatter > 0.0f ? 0.3f : 0.0f;
  });
}
int slab(SceneMaker& m, const std::function<void(Material&)>& material) {
  m.instance(m.mesh(box(Vec3(-1.1f, 0.8f, -1.1f), Vec3(1.1f, 1.0f, 2.0f)), m.material(Vec3(1.0f), material)));
  return -1;
}
int block(SceneMaker& m, const std::function<void(Material&)>& material) {
  const int k = m.material(Vec3(1.0f), material);
  m.instance(m.mesh(box(kLampAt - 0.55f, kLampAt + 0.55f), k));
  return k;
}

const Barrier kBarriers[] = {
    {"nothing", Passage::Open},
    {"thin_glass", Passage::Pane, false, true, false, 2,
     [](SceneMaker& m) {
       m.instance(m.mesh(quad(Vec3(-1.1f, 0.9f, 2.0f), Vec3(2.2f, 0, 0), Vec3(0, 0, -3.1f)), m.material(Vec3(0.8f), clear(1.5f, 0.0f, 0.0f))));
       return -1;
     }},
    {"solid_glass", Passage::Specular, false, false, false, 2, [](SceneMaker& m) { return slab(m, filled(1.5f, 0.0f, 0.8f, 0.2f, 0.0f)); }},
    {"index_one", Passage::Boundary, false, false, false, 2, [](SceneMaker& m) { return slab(m, filled(1.0f, 0.0f, 0.6f, 0.2f, 0.0f)); }},
    {"thin_index_one", Passage::Pane, false, false, false, 2,
     [](SceneMaker& m) {
       m.instance(m.mesh(quad(Vec3(-1.1f, 0.9f, 2.0f), Vec3(2.2f, 0, 0), Vec3(0, 0, -3.1f)), m.material(Vec3(0.7f), clear(1.0f, 0.3f, 0.0f))));
       return -1;
     }},
    {"mirror", Passage::Specular, false, false, false, 3,
     [](SceneMaker& m) {
       m.instance(m.mesh(quad(Vec3(-1.0f, 0, -1.0f), Vec3(2.0f, 0, 0), Vec3(0, 1.6f, 0)), m.material(Vec3(0.9f), [](Material& x) {
         x.bsdf.metallic = 1;
         x.bsdf.roughness = 0;
         x.bsdf.specular = 1;
       })));
       m.instance(m.mesh(quad(Vec3(-1.1f, 0.9f, 2.0f), Vec3(2.2f, 0, 0), Vec3(0, 0, -2.6f)), m.material(Vec3(0.0f))));  // the direct way is closed
       return -1;
     }},
    {"rough_glass", Passage::Open, false, false, false, 3, [](SceneMaker& m) { return slab(m, filled(1.5f, 0.8f, 0.8f, 0.2f, 0.0f)); }},
    {"rough_thin_glass", Passage::Open, false, false, false, 2,
     [](SceneMaker& m) {
       m.instance(m.mesh(quad(Vec3(-1.1f, 0.9f, 2.0f), Vec3(2.2f, 0, 0), Vec3(0, 0, -3.1f)), m.material(Vec3(0.8f), clear(1.5f, 0.5f, 0.0f))));
       return -1;
     }},
    {"fog", Passage::Boundary, true, false, false, 2, [](SceneMaker& m) { return slab(m, filled(1.0f, 1.0f, 0.25f, 0.2f, 0.8f)); }},
    {"milk", Passage::Specular, true, false, false, 3, [](SceneMaker& m) { return slab(m, filled(1.4f, 0.0f, 0.25f, 0.2f, 0.8f)); }},
    {"rough_milk", Passage::Open, true, false, false, 4, [](SceneMaker& m) { return slab(m, filled(1.4f, 0.8f, 0.25f, 0.2f, 0.8f)); }},
    {"fog_around", Passage::Boundary, true, false, true, 2, [](SceneMaker& m) { return block(m, filled(1.0f, 1.0f, 0.6f, 0.4f, 0.8f)); }},
    {"glass_around", Passage::Specular, false, false, true, 2, [](SceneMaker& m) { return block(m, filled(1.5f, 0.0f, 0.8f, 0.5f, 0.0f)); }},
    {"normal_map", Passage::Open},
};

struct Lamp {
  const char* name;
  LightKind kind;
  float angularSize = 0.0f;
  operator LightKind() const { return kind; }
  LightShape shape() const {
    LightShape s;
    s.kind = kind;
    s.angularSize = angularSize;
    return s;
  }
};
constexpr Lamp kKinds[] = {{"point", LightKind::Point},
                           {"spot", LightKind::Spot},
                           {"directional", LightKind::Directional},
                           {"rect", LightKind::Rect},
                           {"disk", LightKind::Disk},
                           {"sphere", LightKind::Sphere},
                           {"mesh", LightKind::Mesh},
                           {"environment", LightKind::Environment},
                           {"sun", LightKind::Directional, 0.8f}};
bool hasPlace(LightKind k) { return k != LightKind::Directional && k != LightKind::Environment; }
bool canHide(LightKind k) { return k == LightKind::Rect || k == LightKind::Disk || k == LightKind::Sphere; }

void addLamp(SceneMaker& m, const Lamp& kind, bool visible = true) {
  LightShape s = kind.shape();
  s.position = kLampAt;
  s.axis = Vec3(0, -1, 0);
  s.u = Vec3(kLampSize, 0, 0);
  s.v = Vec3(0, 0, kLampSize);
  s.radius = kLampSize;
  if (kind == LightKind::Directional) s.axis = glm::normalize(Vec3(0, -1, -1.2f));
  if (kind == LightKind::Spot) {
    s.axis = glm::normalize(Vec3(0, -1, -0.4f));
    s.cosOuter = 0.4f;
    s.cosInner = 0.6f;
  }
  if (kind == LightKind::Environment) {
    m.environment(constantEnvironment(Vec3(1.0f)));
    return;
  }
  if (kind == LightKind::Mesh) {
    m.instance(
        m.mesh(quad(kLampAt + Vec3(-kLampSize, 0, -kLampSize), Vec3(2 * kLampSize, 0, 0), Vec3(0, 0, 2 * kLampSize)), m.material(Vec3(0.0f), [](Material& x) {
          x.emission.radiance = Vec3(1.0f);
          x.coverage.doubleSided = false;
        })));
    return;  // seal() makes the light
  }
  m.light(s, Vec3(1.0f), visible);
}

/// The camera looks at the floor from the side, below what hangs over it, and sees nothing else.
struct Stage {
  static constexpr int kWidth = 12, kHeight = 4;
  std::unique_ptr<Traced> traced;
  LightReceiver floor;
  int around = -1;  ///< material around a lamp with a place

  Stage(const Barrier& barrier, const Lamp& kind, bool visible = true) {
    SceneMaker m;
    const bool mapped = std::string(barrier.name) == "normal_map";
    const int material = m.material(Vec3(0.6f));
    if (mapped) {
      auto map = std::make_shared<Texture>();
      map->name = "bumps";
      map->width = map->height = 2;
      const uint8_t texels[] = {190, 128, 230, 255, 128, 70, 230, 255, 60, 128, 220, 255, 128, 200, 215, 255};
      map->texels8 = std::vector<uint8_t>(std::begin(texels), std::end(texels));
      sealTexture(*map);
      m.scene.textures.push_back(map);
      m.scene.materials[size_t(material)].bsdf.normal.texture = 0;
      m.scene.materials[size_t(material)].bsdf.normal.scale = Vec2(3.0f);
    }
    floor.instance = uint32_t(m.instance(m.mesh(ground(0.95f), material)));
    around = barrier.build(m);
    addLamp(m, kind, visible);
    const float height = 1.6f * kHeight / kWidth, sine = 0.342f;
    Camera c;
    c.perspective = false;
    c.yheight = height;
    floor.towardsCamera = Vec3(std::sqrt(1 - sine * sine), sine, 0);
    floor.hi = Vec2(0.5f * height / sine, 0.8f);
    floor.lo = -floor.hi;
    const Vec3 right(0, 0, -1), up = glm::cross(floor.towardsCamera, right);
    c.toWorld = Mat4(Vec4(right, 0), Vec4(up, 0), Vec4(floor.towardsCamera, 0), Vec4(5.0f * floor.towardsCamera, 1));
    m.scene.cameras.assign(1, c);
    traced = std::make_unique<Traced>(m.finish(), kWidth, kHeight);
    traced->settings.maxBounces = 16;
    traced->settings.blockSize = 64;
  }
  Estimate forwards(const Lamp& kind, int particles) const {
    return LightTracer(*traced, 0, hasPlace(kind) ? around : -1, floor, Vec3(0, 0.8f, 0.4f), 2.0f).measure(particles, 11);
  }
};

class Reach : public ::testing::TestWithParam<Barrier> {};

TEST_P(Reach, PathTracingAgreesWithLightTracingOrTheClassIsNamed) {
  const Barrier& barrier = GetParam();
  for (const Lamp& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    const Stage stage(barrier, kind);
    const bool lost = outOfReach(kind.shape(), true, Receiver::Surface, barrier.passage, false);
    const bool lostInside = barrier.scatters && outOfReach(kind.shape(), true, Receiver::Volume, barrier.passage, false);
    const bool lostToo = barrier.alsoSpecular && outOfReach(kind.shape(), true, Receiver::Surface, Passage::Specular, false);
    const int spread = kind == LightKind::Sphere || kind == LightKind::Environment ? 2 : 1;  // most of their particles go elsewhere
    // Of the dear ones half of the samples will do where both have all of the light; where little is lost it takes more to see it.
    const int part = testing::thoroughOr(1, barrier.effort > 2 && !lost && !lostInside ? 2 : 1);
    const Estimate truth = stage.forwards(kind, 512 * spread * (barrier.effort > 2 ? 4 : 2) / part),
                   picture = estimate(*stage.traced, 8 * barrier.effort / part)[0];
    const double t = truth.mean.x, p = picture.mean.x, error = std::hypot(truth.error.x, picture.error.x);
    const std::vector<std::string> missing = classesNotCovered(*stage.traced->scene);
    EXPECT_GT(t, 0.0);
    EXPECT_LT(error, 0.04 * std::sqrt(double(part)) * t) << "too noisy to be a test";
    EXPECT_EQ(!missing.empty(), lost || lostInside || lostToo);
    if (!lost && !lostInside) EXPECT_NEAR(p, t, 5 * error);
    else EXPECT_LT(p, barrier.around && !hasPlace(kind) ? t + 5 * error : t - 5 * error) << "named, but found";
  }
}

// The floor cannot tell whether the camera may see the lamp: to the last bit, whatever is in between.
TEST_P(Reach, HiddenLampsLightAsVisibleOnesDo) {
  for (const Lamp& kind : kKinds) {
    if (!canHide(kind)) continue;
    SCOPED_TRACE(kind.name);
    const Stage hidden(GetParam(), kind, false), visible(GetParam(), kind, true);
    const Measured a = estimate(*hidden.traced, 2), b = estimate(*visible.traced, 2);
    EXPECT_GT(b[0].mean.x, 0.0);
    EXPECT_EQ(a[0].mean, b[0].mean);
    EXPECT_EQ(a.rays, b.rays);
    EXPECT_EQ(classesNotCovered(*hidden.traced->scene), classesNotCovered(*visible.traced->scene));
  }
}

// The third column of the table: photons have what neither rays nor shadow rays find, and nothing else.
TEST_P(Reach, PhotonsBringWhatIsLeftToThem) {
  const Barrier& barrier = GetParam();
  for (const Lamp& kind : kKinds) {
    if (barrier.scatters || !isDeltaLight(kind.shape())) continue;
    SCOPED_TRACE(kind.name);
    const Stage stage(barrier, kind);
    EXPECT_TRUE(classesNotCovered(*stage.traced->scene, true).empty());
    const Estimate truth = stage.forwards(kind, 1024), rays = estimate(*stage.traced, 4 * barrier.effort)[0];
    CausticSettings s;
    s.path = stage.traced->settings;
    s.path.blockSize = 2;
    s.photons = 100000;
    s.radius = 0.05f;  // the floor goes on for three times as much around what is seen
    const auto caustics = CausticTracer::create(stage.traced->view(), stage.traced->accel, s);
    uint64_t count = 0, dropped = 0;
    const auto map = caustics->emitPass(0, stage.traced->arena, count, {});
    double photons[3] = {};
    for (int y = 0; y < Stage::kHeight; ++y)
      for (int x = 0; x < Stage::kWidth; ++x) caustics->traceSamples(x, y, {0, 0, 2}, *map, photons, count, dropped);
    photons[0] /= 2.0 * Stage::kWidth * Stage::kHeight;
    const bool fromPhotons = photonReaches(kind.shape(), Receiver::Surface, barrier.passage) && (hasPlace(kind) || !barrier.around);
    if (fromPhotons) {
      EXPECT_GT(photons[0], 0.5 * truth.mean.x);
    } else if (!barrier.around) {
      EXPECT_LT(photons[0], 0.02 * truth.mean.x);
    }
    EXPECT_NEAR(rays.mean.x + photons[0], truth.mean.x, 5 * std::hypot(truth.error.x, rays.error.x) + 0.03 * truth.mean.x);
  }
}

INSTANTIATE_TEST_SUITE_P(Barriers, Reach, ::testing::ValuesIn(kBarriers), [](const auto& i) { return std::string(i.param.name); });

}  // namespace
}  // namespace gobo::reach_test
