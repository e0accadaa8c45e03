// SPDX-License-Identifier: Apache-2.0
// Small sealed scenes holding a few lights, for tests of samplers.
#pragma once

#include <gtest/gtest.h>

#include <numeric>

#include "base/sobol.h"
#include "scene/scene.h"
#include "trace/light_sampling.h"

namespace gobo::test {

inline constexpr Facet kLightFacets =
    Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission | Facet::LightShape | Facet::Environment;

/// Keeps what a LightSampler's view refers to alive.
struct LitScene {
  std::shared_ptr<Scene> scene = std::make_shared<Scene>();
  std::vector<int> subset;
  std::shared_ptr<const LightSampler> sampler;

  void add(const LightShape& shape, bool cameraVisible = true) {
    Light light;
    light.name = "light" + std::to_string(scene->lights.size());
    light.shape = shape;
    light.cameraVisible = cameraVisible;
    scene->lights.push_back(light);
  }
  /// Seals and builds a sampler over all lights.
  const LightSampler& build() {
    const Status status = scene->seal();
    EXPECT_TRUE(status.ok()) << status.toString();
    subset.resize(scene->lights.size());
    std::iota(subset.begin(), subset.end(), 0);
    sampler = LightSampler::build(SceneView(*scene, kLightFacets, subset));
    return *sampler;
  }
};

inline LightShape rectLight(Vec3 position, Vec3 u, Vec3 v, bool twoSided = false) {
  LightShape s;
  s.kind = LightKind::Rect;
  s.position = position;
  s.u = u;
  s.v = v;
  s.axis = glm::normalize(glm::cross(u, v));
  s.twoSided = twoSided;
  return s;
}
inline LightShape diskLight(Vec3 position, Vec3 axis, float radius) {
  LightShape s;
  s.kind = LightKind::Disk;
  s.position = position;
  s.axis = glm::normalize(axis);
  s.radius = radius;
  return s;
}
inline LightShape sphereLight(Vec3 position, float radius) {
  LightShape s;
  s.kind = LightKind::Sphere;
  s.position = position;
  s.radius = radius;
  return s;
}
inline LightShape environmentLight() {
  LightShape s;
  s.kind = LightKind::Environment;
  return s;
}

/// A mesh of loose triangles with uv0 = (x, z), one emissive material; gets instance 0 and a Mesh light at seal().
inline void addEmissiveMesh(Scene& scene, const std::vector<Vec3>& corners, const Mat4& toWorld, bool doubleSided,
                            std::shared_ptr<const Texture> texture = nullptr) {
  auto mesh = std::make_shared<Mesh>();
  mesh->name = "lamp";
  mesh->positions = corners;
  for (uint32_t i = 0; i < corners.size(); ++i) {
    mesh->indices.push_back(i);
    mesh->uv[0].push_back(Vec2(corners[i].x, corners[i].z));
  }
  mesh->material = int(scene.materials.size());
  Material m;
  m.name = "glow";
  m.emission.radiance = Vec3(3.0f);  // strength belongs to the light's power and must not show in samples
  m.coverage.doubleSided = doubleSided;
  if (texture) {
    m.emission.texture.texture = int(scene.textures.size());
    scene.textures.push_back(texture);
  }
  scene.materials.push_back(m);
  sealMesh(*mesh);
  scene.meshes.push_back(mesh);
  scene.instances.push_back({"lamp" + std::to_string(scene.instances.size()), int(scene.meshes.size()) - 1, toWorld});
}

/// Mean and relative deviation of the irradiance estimator radiance cos / pdf over scrambled Sobol points.
struct Irradiance {
  double mean = 0, deviation = 0;
};
inline Irradiance irradiance(const LightSampler& sampler, int light, const Vec3& p, const Vec3& n, int samples = 4096) {
  double sum = 0, sum2 = 0;
  for (int i = 0; i < samples; ++i) {
    SobolSampler u(1, uint32_t(i));
    LightSample s;
    if (!sampler.sample(light, p, u.next2D(), s)) continue;
    EXPECT_TRUE(isFinite(s.direction) && isFinite(s.radiance) && std::isfinite(s.pdf) && s.pdf > 0 && s.distance > 0);
    const double e = double(s.radiance.x) * std::max(glm::dot(s.direction, n), 0.0f) / s.pdf;
    sum += e;
    sum2 += e * e;
  }
  const double mean = sum / samples;
  return {mean, std::sqrt(std::max(sum2 / samples - mean * mean, 0.0))};
}

}  // namespace gobo::test
