// SPDX-License-Identifier: Apache-2.0
// camera.cull_back_faces through the whole plan: a closed room seen from outside is the room seen from inside, by every technique, with
// photons, in every output that the G-buffer makes; certificates measure the culled picture; keys know what culling reads.
#include <gtest/gtest.h>

#include <cmath>

#include "scene/edit.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace {

using namespace tests;

constexpr float kFar = 4.0f, kNear = 0.99f;  // distances of an orthographic camera: the same rays from outside and from inside

/// A closed single-sided room that shows its inside, with a box, a glass ball and a small mirror in it.
ScenePtr room(float cameraAt) {
  SceneMaker m;
  const auto frontOnly = [](Material& x) { x.coverage.doubleSided = false; };
  m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f), true), m.material(Vec3(0.6f, 0.5f, 0.4f), frontOnly)));
  m.instance(m.mesh(box(Vec3(-0.6f, -1.0f, -0.5f), Vec3(-0.2f, -0.3f, 0.0f)), m.material(Vec3(0.3f, 0.6f, 0.7f), frontOnly)));
  m.instance(m.mesh(sphere(Vec3(0.3f, -0.4f, 0.1f), 0.3f, 12, true), m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.transmission = 1;
    x.bsdf.roughness = 0;
    x.bsdf.thickness = 1;
    x.coverage.doubleSided = false;
  })));
  LightShape lamp;
  lamp.kind = LightKind::Rect;
  lamp.position = Vec3(0.1f, 0.95f, -0.2f);
  lamp.axis = Vec3(0, -1, 0);
  lamp.u = Vec3(0.25f, 0, 0);
  lamp.v = Vec3(0, 0, 0.25f);
  m.light(lamp, Vec3(8.0f));
  LightShape point;
  point.position = Vec3(-0.3f, 0.6f, 0.3f);
  m.light(point, Vec3(0.6f, 0.5f, 0.3f));
  m.camera(Vec3(0, 0, cameraAt), Vec3(0.0f));
  m.scene.cameras[0].perspective = false;
  m.scene.cameras[0].yheight = 1.8f;
  return m.finish();
}

v1::RenderRequest request(bool cull, std::initializer_list<const char*> edits, int size = 24, int spp = 16) {
  v1::RenderRequest r = smallRequest("room", size, size, spp);
  set(r, std::string("camera.cull_back_faces=") + (cull ? "true" : "false"));
  for (const char* e : edits) set(r, e);
  return r;
}
RenderResult render(Engine& engine, const v1::RenderRequest& r, const ScenePtr& scene) {
  RenderControl control;
  control.scene = scene;
  Result<RenderResult> out = engine.render(r, control);
  EXPECT_TRUE(out.ok()) << out.status().toString();
  return out.ok() ? std::move(*out) : RenderResult{};
}
double mean(const Image& image) {
  double s = 0;
  for (float v : image.data) s += v / double(image.data.size());
  return s;
}
double rms(const Image& a, const Image& b) {
  double s = 0;
  for (size_t i = 0; i < a.data.size(); ++i) s += (double(a.data[i]) - b.data[i]) * (double(a.data[i]) - b.data[i]) / double(a.data.size());
  return std::sqrt(s);
}
std::vector<std::string> labels(const RenderResult& r) {
  std::vector<std::string> out;
  for (const auto& n : r.reply.plan()) out.push_back(n.node());
  return out;
}

TEST(BackFacesPlans, ByEveryTechniqueARoomFromOutsideIsTheRoomFromInside) {
  const auto engine = makeEngine();
  for (const char* technique : {"shadows.path_traced=", "shadows.ray_traced.samples=4", "shadows.axis_aligned.max_samples=32",
                                "shadows.percentage_closer_soft.filter_taps=32", "shadows.auto.error=0.05"}) {
    SCOPED_TRACE(technique);
    const auto edits = {technique, "integrator.caustic_photons=20000"};
    const RenderResult inside = render(*engine, request(false, edits), room(kNear)), outside = render(*engine, request(true, edits), room(kFar));
    ASSERT_FALSE(inside.images.empty() || outside.images.empty());
    const Image &a = inside.images[0].image(), &b = outside.images[0].image();
    EXPECT_GT(mean(a), 0.05);
    EXPECT_NEAR(mean(b), mean(a), 0.01 * mean(a));
    EXPECT_LT(rms(a, b), 0.05 * mean(a));
    EXPECT_EQ(labels(outside), labels(inside)) << "what is chosen while planning looks from the same camera";
  }
}

// Photons alone: what they add of a point lamp in front of the glass ball on the wall behind it, gathered by their own rays from the camera.
TEST(BackFacesPlans, CausticsAreSeenThroughTheWall) {
  const auto engine = makeEngine();
  const auto caustics = [&](bool cull, float at) {
    const auto edits = {"lights.l0.enabled=false", "lights.l1.position=0.3,-0.1,0.9", "lights.l1.intensity=4", "integrator.caustic_photons=20000",
                        "outputs=indirect"};
    v1::RenderRequest r = request(cull, edits);
    const double with = mean(render(*engine, r, room(at)).images.at(0).image());
    set(r, "integrator.caustic_photons=0");
    return with - mean(render(*engine, r, room(at)).images.at(0).image());
  };
  const double inside = caustics(false, kNear), outside = caustics(true, kFar);
  EXPECT_GT(inside, 0.01);
  EXPECT_NEAR(outside, inside, 0.05 * inside);
}

TEST(BackFacesPlans, WhatTheGBufferShowsIsTheInside) {
  const auto engine = makeEngine();
  const auto edits = {"outputs=albedo,normal,position,alpha,object_id,material_id,depth", "view_samples=4"};
  const RenderResult inside = render(*engine, request(false, edits), room(kNear)), outside = render(*engine, request(true, edits), room(kFar));
  ASSERT_EQ(inside.images.size(), 7u);
  ASSERT_EQ(outside.images.size(), 7u);
  for (size_t k = 0; k < 7; ++k) {
    const Image &a = inside.images[k].image(), &b = outside.images[k].image();
    ASSERT_EQ(a.data.size(), b.data.size());
    const double off = k == 6 ? double(kFar) - kNear : 0.0;
    int different = 0;
    for (size_t i = 0; i < a.data.size(); ++i) different += !(std::fabs(double(b.data[i]) - off - a.data[i]) <= 1e-3);
    EXPECT_LE(different, int(a.data.size()) / 100) << inside.images[k].output << ": a silhouette may fall to the other side by rounding";
  }
}

// The reference looks as the picture does: the certificate is as small as for the same picture taken inside, and of the picture that does
// not look through the wall it is the whole room. A picture with the option that its certificate did not have would be wrong by as much.
TEST(BackFacesPlans, CertificatesMeasureTheCulledPicture) {
  const auto engine = makeEngine();
  const auto edits = {"certificate.pixel_fraction=1", "certificate.spp=32", "integrator.max_bounces=8", "integrator.caustic_photons=20000"};
  const RenderResult outside = render(*engine, request(true, edits, 16, 128), room(kFar)),
                     inside = render(*engine, request(false, edits, 16, 128), room(kNear));
  const v1::Certificate a = outside.reply.certificate(), b = inside.reply.certificate();
  EXPECT_GT(a.pixels(), 0u);
  EXPECT_LT(a.rmse(), 0.2 * mean(outside.images[0].image()));
  EXPECT_NEAR(a.rmse(), b.rmse(), 0.5 * b.rmse());
  const RenderResult wall = render(*engine, request(false, edits, 16, 16), room(kFar));
  EXPECT_EQ(mean(wall.images[0].image()), 0.0);
  EXPECT_LT(wall.reply.certificate().rmse(), 1e-6);
}

TEST(BackFacesPlans, ColdIsWarmWhateverCullingReads) {
  // Scenes that differ in what decides whether the wall is passed, one after the other in one engine.
  const auto warm = makeEngine();
  const ScenePtr base = room(kFar);
  std::vector<ScenePtr> scenes{base};
  const std::vector<std::function<void(Material&)>> edits{[](Material& x) { x.coverage.doubleSided = true; }, [](Material& x) { x.bsdf.transmission = 0.5f; },
                                                          [](Material& x) { x.bsdf.diffuseTransmission = 0.5f; },
                                                          [](Material& x) {
                                                            x.bsdf.transmission = 1.0f;
                                                            x.bsdf.thickness = 0.5f;
                                                          },
                                                          [](Material& x) { x.bsdf.unlit = true; }};
  for (const auto& edit : edits) {
    const auto next = editScene(*base, [&](Scene& s) -> Status {
      edit(s.materials[0]);
      return {};
    });
    ASSERT_TRUE(next.ok()) << next.status().toString();
    scenes.push_back(*next);
  }
  int different = 0;
  for (const bool cull : {true, false})
    for (const char* technique : {"shadows.path_traced=", "shadows.ray_traced.samples=2", "shadows.auto.error=0.1"}) {
      std::vector<RenderResult> all;
      for (const ScenePtr& scene : scenes) {
        const v1::RenderRequest r = request(cull, {technique, "outputs=beauty,depth,albedo"}, 12, 2);
        const RenderResult here = render(*warm, r, scene), fresh = render(*makeEngine(), r, scene);
        EXPECT_EQ(firstDifference(here, fresh), "") << technique << " culling " << cull;
        all.push_back(fresh);
        different += cull && !firstDifference(fresh, all[0]).empty();
      }
    }
  EXPECT_GE(different, 12) << "most of the changes are invisible: the test says little";
}

}  // namespace
}  // namespace gobo::testing
