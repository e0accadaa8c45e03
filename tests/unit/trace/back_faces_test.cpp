// SPDX-License-Identifier: Apache-2.0
// What a camera that culls back faces passes and what it meets, and that light knows nothing of it.
#include "trace/back_faces.h"

#include <random>

#include "support/tiny_scenes.h"

namespace gobo::back_faces_test {
namespace {

using namespace tests;

constexpr Facet kFacets = kAccelFacets | kBackFaceFacets;
const std::vector<int> kNoLights;

struct Cast {
  ScenePtr scene;
  TaskArena arena{2};
  SceneView view;
  AccelPtr accel;
  BackFaces passed;
  explicit Cast(SceneMaker& m)
      : scene((m.camera(Vec3(0, 0, 9), Vec3(0.0f)), m.finish())), view(*scene, kFacets, kNoLights), accel(Accel::build(view, arena)), passed(view, *accel) {}
};
int singleSided(SceneMaker& m, const std::function<void(Material&)>& change = {}) {
  return m.material(Vec3(0.5f), [&](Material& x) {
    x.coverage.doubleSided = false;
    if (change) change(x);
  });
}
Vec3 randomDirection(std::mt19937& g) {
  std::normal_distribution<float> n;
  return glm::normalize(Vec3(n(g), n(g), n(g)));
}

/// The nearest triangle in double, back faces of instances in `frontOnly` left out. Outside by the winding, turned over by mirroring.
double nearest(const Scene& s, const Ray& ray, const std::vector<bool>& frontOnly, uint32_t& instance) {
  double best = 1e300;
  for (size_t i = 0; i < s.instances.size(); ++i) {
    const Mesh& m = *s.meshes[size_t(s.instances[i].mesh)];
    const glm::dmat4 w(s.instances[i].toWorld);
    const double turned = glm::determinant(glm::dmat3(w)) < 0 ? -1 : 1;
    for (size_t t = 0; t < m.triangles(); ++t) {
      DVec3 v[3];
      for (int c = 0; c < 3; ++c) v[c] = DVec3(w * glm::dvec4(DVec3(m.positions[m.indices[3 * t + size_t(c)]]), 1.0));
      const DVec3 e1 = v[1] - v[0], e2 = v[2] - v[0], d(ray.direction), p = glm::cross(d, e2);
      const double det = glm::dot(e1, p);
      if (det == 0 || (frontOnly[i] && turned * glm::dot(glm::cross(e1, e2), d) > 0)) continue;
      const DVec3 o = DVec3(ray.origin) - v[0], q = glm::cross(o, e1);
      const double u = glm::dot(o, p) / det, k = glm::dot(d, q) / det, at = glm::dot(e2, q) / det;
      if (u < 0 || k < 0 || u + k > 1 || at <= 0 || at >= best) continue;
      best = at;
      instance = uint32_t(i);
    }
  }
  return best;
}

TEST(BackFaces, RaysPassThemOverMovedScaledAndMirroredInstances) {
  SceneMaker m;
  const int one = singleSided(m), both = m.material(Vec3(0.5f)), masked = singleSided(m, [](Material&x) {
                                                                   x.coverage.mode = AlphaMode::Mask;
                                                                   x.coverage.factor = 0.9f;
                                                                 });
  std::vector<bool> frontOnly;
  const auto add = [&](Mesh mesh, int material, const Mat4& where, bool front) {
    m.instance(m.mesh(std::move(mesh), material), where);
    frontOnly.push_back(front);
  };
  add(box(Vec3(-1.0f), Vec3(1.0f), true), one, translate(Vec3(0, 0, 0)), true);  // a room seen from outside
  add(sphere(Vec3(0.0f), 1.0f, 6, false), one, translate(Vec3(2, 0, 0)) * scaling(Vec3(0.5f, 1.5f, 1.0f)), true);
  add(sphere(Vec3(0.0f), 1.0f, 6, false), one, translate(Vec3(-2, 0.5f, 0)) * scaling(Vec3(-1.0f, 0.7f, 0.4f)), true);
  add(box(Vec3(-1.0f), Vec3(1.0f), true), masked, translate(Vec3(0, -2, 1)) * scaling(Vec3(0.3f, -0.3f, 0.6f)), true);
  add(box(Vec3(-1.0f), Vec3(1.0f), true), both, translate(Vec3(0, 2, 0)) * scaling(Vec3(0.7f)), false);
  Cast c(m);
  ASSERT_TRUE(c.passed.any());
  std::mt19937 g(1);
  std::vector<Ray> rays;
  for (int i = 0; i < 4000; ++i) {
    const Vec3 origin = randomDirection(g) * (i % 4 ? 5.0f : 0.5f);
    rays.push_back({origin, glm::normalize(2.5f * randomDirection(g) - origin)});
  }
  int hits = 0, changed = 0, wrong = 0, backs = 0;
  for (size_t first = 0; first < rays.size(); first += 16) {
    Hit packet[16];
    c.accel->intersect16(&rays[first], 16, packet, &c.passed);
    for (size_t i = 0; i < 16; ++i) {
      const Ray& ray = rays[first + i];
      uint32_t instance = kNoHit;
      const double t = nearest(*c.scene, ray, frontOnly, instance);
      Hit one, plain;
      c.accel->intersect(ray, one, &c.passed);
      c.accel->intersect(ray, plain);
      for (const Hit& hit : {one, packet[i]}) {
        const bool same = hit.instance == instance && (!hit.valid() || std::fabs(double(hit.t) - t) < 1e-4 * t + 1e-4);
        wrong += !same;
        backs += hit.valid() && frontOnly[hit.instance] && !(glm::dot(hit.Ng, ray.direction) < 0.0f);
      }
      hits += one.valid();
      changed += one.instance != plain.instance || one.t != plain.t;
    }
  }
  EXPECT_GT(hits, 1000);
  EXPECT_GT(changed, 500);
  EXPECT_EQ(backs, 0);
  EXPECT_LE(wrong, 8) << "rays along an edge may differ between float and double";
}

TEST(BackFaces, OfSharedBigMeshesTooWhichAreInstanced) {
  SceneMaker m;
  const int ball = m.mesh(sphere(Vec3(0.0f), 1.0f, 240, false), singleSided(m));  // 229 k triangles
  m.instance(ball, translate(Vec3(3, 0, 0)));
  m.instance(ball, translate(Vec3(-3, 0, 0)) * scaling(Vec3(-1.0f, 1.0f, 0.5f)));
  Cast c(m);
  std::mt19937 g(3);
  for (int i = 0; i < 500; ++i) {
    const Vec3 centre(i % 2 ? -3.0f : 3.0f, 0, 0), d = randomDirection(g);
    Hit inside, out;
    ASSERT_TRUE(c.accel->intersect({centre, d}, inside));
    ASSERT_FALSE(c.accel->intersect({centre, d, 0.0f, 1.5f}, inside, &c.passed));
    ASSERT_TRUE(c.accel->intersect({centre + 1.5f * d, -d, 0.0f, 2.0f}, out, &c.passed));
    EXPECT_LT(out.t, 1.5f);  // the near side
    EXPECT_LT(glm::dot(out.Ng, -d), 0.0f);
  }
}

TEST(BackFaces, WhatLightGoesThroughIsNeverPassed) {
  const std::pair<const char*, std::function<void(Material&)>> kinds[] = {
      {"transmission", [](Material& x) { x.bsdf.transmission = 0.1f; }},
      {"diffuse transmission", [](Material& x) { x.bsdf.diffuseTransmission = 0.1f; }},
      {"volume",
       [](Material& x) {
         x.bsdf.transmission = 1;
         x.bsdf.thickness = 1;
         x.bsdf.attenuationDistance = 1;
         x.bsdf.attenuationColor = Vec3(0.5f);
       }},
      {"double-sided", [](Material& x) { x.coverage.doubleSided = true; }},
  };
  for (const auto& [name, change] : kinds) {
    SceneMaker m;
    m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(0, 2, 0), Vec3(2, 0, 0)), singleSided(m, change)));  // its back to +z
    Cast c(m);
    Hit hit;
    EXPECT_FALSE(c.passed.any()) << name;
    EXPECT_TRUE(c.accel->intersect({Vec3(0, 0, 3), Vec3(0, 0, -1)}, hit, &c.passed)) << name;
  }
}

TEST(BackFaces, OfTwoSheetsBackToBackTheOneThatFacesTheCameraIsSeen) {
  SceneMaker m;
  const int material = singleSided(m);
  m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(2, 0, 0), Vec3(0, 2, 0)), material));  // to +z
  m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(0, 2, 0), Vec3(2, 0, 0)), material));  // to -z, in the same place
  Cast c(m);
  std::mt19937 g(5);
  std::uniform_real_distribution<float> u(-0.9f, 0.9f);
  for (int i = 0; i < 200; ++i) {
    const float side = i % 2 ? 1.0f : -1.0f;
    const Vec3 from(u(g), u(g), 3 * side), to(u(g), u(g), 0);
    Hit hit;
    ASSERT_TRUE(c.accel->intersect({from, glm::normalize(to - from)}, hit, &c.passed));
    EXPECT_EQ(hit.instance, side > 0 ? 0u : 1u);
  }
}

/// A lamp of radiance 1, seen along -z past a single-sided black sheet whose back is to the camera, and `between` in front of both.
Estimate seen(bool cull, const std::function<void(SceneMaker&)>& between, const Vec3& from = Vec3(0, 0, 6), const Vec3& to = Vec3(0.0f)) {
  SceneMaker m;
  m.instance(m.mesh(quad(Vec3(-2, -2, -1), Vec3(4, 0, 0), Vec3(0, 4, 0)), m.material(Vec3(0.0f), [](Material& x) { x.emission.radiance = Vec3(1.0f); })));
  m.instance(m.mesh(quad(Vec3(-2, -2, 0), Vec3(0, 4, 0), Vec3(4, 0, 0)), m.material(Vec3(0.0f), [](Material& x) { x.coverage.doubleSided = false; })));
  between(m);
  m.camera(from, to, 0.02f);
  m.scene.cameras[0].cullBackFaces = cull;
  return estimate(Traced(m.finish()), 4)[0];
}
void pane(SceneMaker& m, float ior, float thickness) {
  const int glass = m.material(Vec3(1.0f), [=](Material& x) {
    x.bsdf = {};
    x.bsdf.transmission = 1;
    x.bsdf.roughness = 0;
    x.bsdf.ior = ior;
    x.bsdf.thickness = thickness;
  });
  if (thickness > 0) m.instance(m.mesh(box(Vec3(-2, -2, 2), Vec3(2, 2, 2.5f)), glass));
  else m.instance(m.mesh(quad(Vec3(-2, -2, 2), Vec3(4, 0, 0), Vec3(0, 4, 0)), glass));
}

TEST(BackFaces, TheCameraLooksThroughThemWhileItLooksStraightOn) {
  const auto nothing = [](SceneMaker&) {};
  expectNear(seen(false, nothing), DVec3(0.0));
  expectNear(seen(true, nothing), DVec3(1.0));
  expectNear(seen(true, [](SceneMaker& m) { pane(m, 1.5f, 0); }), DVec3(0.96), 1e-3);  // (1 - F) at normal incidence
  expectNear(seen(true, [](SceneMaker& m) { pane(m, 1.0f, 0.5f); }), DVec3(1.0));      // two boundaries of index 1
  expectNear(seen(true, [](SceneMaker& m) { pane(m, 1.5f, 0.5f); }), DVec3(0.0));      // refraction ends the look
  // A mirror shows the sheet's back: the camera's own ray meets the mirror.
  const auto mirror = [](SceneMaker& m) {
    m.instance(m.mesh(quad(Vec3(-3, -3, 3), Vec3(0, 6, 0), Vec3(6, 0, 0)), m.material(Vec3(1.0f), [](Material& x) {
      x.bsdf.metallic = 1;
      x.bsdf.roughness = 0;
      x.bsdf.specular = 1;
    })));
  };
  const auto behind = [&](bool cull) { return seen(cull, mirror, Vec3(0, 0, 2), Vec3(0, 0, 3)); };
  expectNear(behind(true), DVec3(0.0));
  expectNear(behind(false), DVec3(0.0));
}

TEST(BackFaces, LightMeetsThemAllTheSame) {
  // From above, past a sheet that faces down: the floor below lies in its shadow, lit by a sun from above or not at all.
  const auto floorSeen = [](bool cull, bool sheet) {
    SceneMaker m;
    m.instance(m.mesh(ground(20.0f), m.material(Vec3(0.5f))));
    if (sheet)
      m.instance(m.mesh(quad(Vec3(-1, 1, -1), Vec3(2, 0, 0), Vec3(0, 0, 2)), m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
    LightShape sun;
    sun.kind = LightKind::Directional;
    sun.axis = Vec3(0, -1, 0);
    m.light(sun, Vec3(2.0f));
    m.camera(Vec3(0, 5, 0), Vec3(0.0f), 0.02f);
    m.scene.cameras[0].cullBackFaces = cull;
    Traced t(m.finish());
    t.settings.maxBounces = 0;
    return estimate(t, 4)[0];
  };
  expectNear(floorSeen(true, false), DVec3(2.0 * 0.5 / M_PI), 1e-5);
  expectNear(floorSeen(true, true), DVec3(0.0));
  expectNear(floorSeen(false, true), DVec3(2.0 * 0.5 / M_PI), 1e-5);  // the lit sheet itself
}

TEST(BackFaces, ARoomFromOutsideIsTheRoomFromInside) {
  // An orthographic camera moved along its view: the same rays, so the same picture, whatever the near wall does for the light.
  const auto room = [](float z, bool cull) {
    SceneMaker m;
    m.instance(m.mesh(box(Vec3(-1.0f), Vec3(1.0f), true), m.material(Vec3(0.6f), [](Material& x) { x.coverage.doubleSided = false; })));
    m.instance(m.mesh(quad(Vec3(-0.4f, 0.9f, -0.4f), Vec3(0.8f, 0, 0), Vec3(0, 0, 0.8f)), m.material(Vec3(0.2f), [](Material& x) {
      x.emission.radiance = Vec3(3.0f);
      x.coverage.doubleSided = false;
    })));
    m.camera(Vec3(0, 0, z), Vec3(0.0f));
    m.scene.cameras[0].perspective = false;
    m.scene.cameras[0].yheight = 1.6f;
    m.scene.cameras[0].cullBackFaces = cull;
    return estimate(Traced(m.finish()), 8)[0];
  };
  const Estimate inside = room(0.99f, false), outside = room(4.0f, true), closed = room(4.0f, false);
  expectSame(outside, inside);
  EXPECT_GT(inside.mean.x, 0.1);
  expectNear(closed, DVec3(0.0));
}

}  // namespace
}  // namespace gobo::back_faces_test
