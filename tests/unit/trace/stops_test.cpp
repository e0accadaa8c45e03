// SPDX-License-Identifier: Apache-2.0
// Whatever a tracer makes before it traces (light tables, distributions, volumes around the camera) looks at the stop token all along,
// and a tracer made after stopped ones is the same bit for bit.
#include <gtest/gtest.h>

#include "support/instrumented.h"
#include "support/stopping.h"
#include "support/tiny_scenes.h"
#include "trace/camera_media.h"
#include "trace/environment_distribution.h"
#include "trace/light_selector.h"
#include "trace/mesh_light.h"
#include "trace/photon_tracer.h"

namespace gobo::tests {
namespace {

constexpr int kRows = 96, kSphere = 96;  // about 4 * kSphere^2 triangles
constexpr int kTriangles = 4 * kSphere * kSphere - 4 * kSphere;

EnvironmentPtr gradient() {
  Image image(2 * kRows, kRows, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = 0.1f + float(i % 7);
  return makeEnvironment("gradient", std::move(image));
}

/// Every kind of light, a finely divided one with a texture among them, a map, many lamps, and a volume that the camera is in.
ScenePtr everything() {
  SceneMaker m;
  auto texture = std::make_shared<Texture>();
  texture->width = texture->height = 8;
  texture->texels8 = std::vector<uint8_t>(8 * 8 * 4, 200);
  sealTexture(*texture);
  m.scene.textures.push_back(texture);
  m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.5f))));
  m.instance(m.mesh(sphere(Vec3(0, 1, 0), 0.3f, kSphere, false), m.material(Vec3(0.2f), [](Material& x) {
    x.emission.radiance = Vec3(2.0f);
    x.emission.texture.texture = 0;
  })));
  Mesh lens = sphere(Vec3(0, 1, 4), 0.5f, kSphere, false);
  m.instance(m.mesh(lens, m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf.transmission = 1.0f;
    x.bsdf.roughness = 0.0f;
    x.bsdf.thickness = 1.0f;
    x.bsdf.ior = 1.5f;
  })));
  for (int i = 0; i < 300; ++i) {
    LightShape s;
    s.kind = i % 3 == 0 ? LightKind::Point : i % 3 == 1 ? LightKind::Rect : LightKind::Spot;
    s.position = Vec3(float(i % 17) - 8.0f, 2.0f + float(i % 5), float(i % 13) - 6.0f);
    m.light(s);
  }
  m.environment(gradient());
  m.camera(Vec3(0, 1, 4), Vec3(0, 1, 0), 0.6f);
  return m.finish();
}

TEST(Stops, ATracersTablesPollTheirTokenAllAlong) {
  const EnvironmentPtr map = gradient();
  EXPECT_GE(pollsOf([&](const StopToken& s) { EnvironmentDistribution d(map, s); }), kRows);
  EXPECT_GE(pollsOf([&](const StopToken& s) { environmentFlux(map.get(), s); }), kRows);
  const Traced t(everything());
  int lamp = -1;
  for (const Light& l : t.scene->lights)
    if (l.shape.kind == LightKind::Mesh) lamp = int(l.shape.instance);
  EXPECT_GE(pollsOf([&](const StopToken& s) { MeshLight light(t.view(), uint32_t(lamp), s); }), kTriangles / 512);
  EXPECT_GE(pollsOf([&](const StopToken& s) { (void)LightSampler::build(t.view(), s); }), kRows + kTriangles / 512);
  std::vector<LightBounds> bounds(300);
  for (size_t i = 0; i < bounds.size(); ++i) {
    bounds[i].lo = bounds[i].hi = Vec3(float(i));
    bounds[i].power = 1.0f;
  }
  EXPECT_GE(pollsOf([&](const StopToken& s) {
              LightTree tree;
              tree.build(bounds, s);
            }),
            3);
  // The mesh light's bounds, the map's flux, the size of the scene, the lights one by one, the tree.
  EXPECT_GE(pollsOf([&](const StopToken& s) {
              LightSelector x;
              x.build(t.view(), t.settings.nominal, LightSelection::Tree, s);
            }),
            kTriangles / 4096 + kRows + kTriangles / 16384 + 300 + 3);
  const Vec3 inside(0, 1, 4);
  EXPECT_EQ(volumesAround(t.view(), inside).size(), 1u);
  EXPECT_GE(pollsOf([&](const StopToken& s) { (void)volumesAround(t.view(), inside, s); }), 1 + kTriangles / 4096);
}

TEST(Stops, ATracerIsNotMadeWhateverThePoll) {
  const Traced t(everything());
  const auto make = [&](const StopToken& stop) { return PathTracer::create(t.view(), t.accel, t.settings, stop); };
  const int polls = pollsOf([&](const StopToken& s) { ASSERT_NE(make(s), nullptr); });
  EXPECT_GE(polls, 2 * kRows + 300);
  for (int k = 1; k <= polls; k += 1 + polls / (gobo::testing::kInstrumented ? 7 : 23)) EXPECT_EQ(make(stopAt(k)), nullptr) << k << " of " << polls;
  EXPECT_EQ(make(stopAt(polls)), nullptr);
  EXPECT_EQ(make(stoppedAlready()), nullptr);
  const auto traced = [](const PathTracer& tracer) {
    std::vector<double> sums(3, 0.0);
    uint64_t rays = 0, dropped = 0;
    for (int x = 0; x < 8; ++x) tracer.traceBlock(x, 4, 0, sums.data(), rays, dropped);
    return sums;
  };
  EXPECT_EQ(traced(*make({})), traced(*t.tracer()));
}

TEST(Stops, APhotonTracerIsNotMadeWhateverThePoll) {
  const Traced t(everything());
  CausticSettings settings;
  settings.path = t.settings;
  settings.photons = 16;
  settings.radius = 0.1f;
  const auto make = [&](const StopToken& stop) { return CausticTracer::create(t.view(), t.accel, settings, stop); };
  const int polls = pollsOf([&](const StopToken& s) { ASSERT_NE(make(s), nullptr); });
  EXPECT_GE(polls, 2 * kRows + 300 + 200);  // and the volumes around each of 200 punctual lights
  for (int k = 1; k <= polls; k += 1 + polls / (gobo::testing::kInstrumented ? 3 : 11)) EXPECT_EQ(make(stopAt(k)), nullptr) << k << " of " << polls;
}

}  // namespace
}  // namespace gobo::tests
