// SPDX-License-Identifier: Apache-2.0
// Small scenes by hand, and a way to run the path tracer on them with honest error bars: the mean over pixels and
// blocks and the standard error of that mean.
#pragma once

#include <gtest/gtest.h>

#include <numeric>

#include "scene/environment.h"
#include "scene/scene.h"
#include "trace/path_tracer.h"

namespace gobo::tests {

struct SceneMaker {
  Scene scene;
  int instances = 0;

  int material(const Vec3& albedo, const std::function<void(Material&)>& change = {}) {
    Material m;
    m.name = "m" + std::to_string(scene.materials.size());
    m.albedo.factor = albedo;
    m.bsdf.specular = 0.0f;  // exact Lambert unless `change` says otherwise
    if (change) change(m);
    scene.materials.push_back(m);
    return int(scene.materials.size()) - 1;
  }
  int mesh(Mesh m, int material) {
    m.material = material;
    m.name = "mesh" + std::to_string(scene.meshes.size());
    auto sealed = std::make_shared<Mesh>(std::move(m));
    sealMesh(*sealed);
    scene.meshes.push_back(sealed);
    return int(scene.meshes.size()) - 1;
  }
  int instance(int mesh, const Mat4& toWorld = Mat4(1.0f)) {
    scene.instances.push_back({"i" + std::to_string(instances++), mesh, toWorld});
    return int(scene.instances.size()) - 1;
  }
  int light(const LightShape& shape, const Vec3& power = Vec3(1.0f), bool visible = true) {
    Light l;
    l.name = "l" + std::to_string(scene.lights.size());
    l.shape = shape;
    l.power = power;
    l.cameraVisible = visible;
    scene.lights.push_back(l);
    return int(scene.lights.size()) - 1;
  }
  void environment(EnvironmentPtr map, float scale = 1.0f) {
    scene.environment = std::move(map);
    LightShape s;
    s.kind = LightKind::Environment;
    light(s, Vec3(scale));
  }
  /// Camera at `from` that looks at `to` with a full vertical angle in radians.
  void camera(const Vec3& from, const Vec3& to, float yfov = 0.01f) {
    Camera c;
    c.yfov = yfov;
    const Vec3 back = glm::normalize(from - to);
    const Vec3 right = glm::normalize(glm::cross(std::fabs(back.y) > 0.99f ? Vec3(0, 0, -1) : Vec3(0, 1, 0), back));
    c.toWorld = Mat4(Vec4(right, 0), Vec4(glm::cross(back, right), 0), Vec4(back, 0), Vec4(from, 1));
    scene.cameras.assign(1, c);
  }
  ScenePtr finish() {
    auto sealed = std::make_shared<Scene>(scene);
    const Status status = sealed->seal();
    EXPECT_TRUE(status.ok()) << status.toString();
    return sealed;
  }
};

/// Materials for SceneMaker::material: smooth glass whose colours part, and a scattering volume without a surface of its own.
inline void dispersingGlass(Material& m) {
  m.bsdf = {};
  m.bsdf.roughness = 0.0f;
  m.bsdf.transmission = 1;
  m.bsdf.thickness = 1;
  m.bsdf.ior = 1.6f;
  m.bsdf.dispersion = 2.0f;
}
inline void fog(Material& m) {
  m.bsdf = {};
  m.bsdf.roughness = 0.0f;
  m.bsdf.transmission = 1;
  m.bsdf.thickness = 1;
  m.bsdf.ior = 1.0f;
  m.bsdf.attenuationColor = Vec3(0.6f, 0.5f, 0.4f);
  m.bsdf.attenuationDistance = 0.5f;
  m.bsdf.scatterAlbedo = Vec3(0.8f);
}

/// Parallelogram corner, corner + a, corner + a + b, corner + b; outside is cross(a, b).
inline Mesh quad(const Vec3& corner, const Vec3& a, const Vec3& b) {
  Mesh m;
  m.positions = {corner, corner + a, corner + a + b, corner + b};
  m.uv[0] = {Vec2(0, 0), Vec2(1, 0), Vec2(1, 1), Vec2(0, 1)};
  m.indices = {0, 1, 2, 0, 2, 3};
  return m;
}
/// Large square in the plane y = height, outside up.
inline Mesh ground(float half, float height = 0.0f) { return quad(Vec3(-half, height, half), Vec3(2 * half, 0, 0), Vec3(0, 0, -2 * half)); }
/// Box [lo, hi]; `inward` turns its outside to the inside.
inline Mesh box(const Vec3& lo, const Vec3& hi, bool inward = false) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.positions.push_back(Vec3(i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z));
  m.indices = {0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6};
  if (inward)
    for (size_t t = 0; t < m.indices.size(); t += 3) std::swap(m.indices[t + 1], m.indices[t + 2]);
  return m;
}
/// Sphere of 2 * n * n * 2 triangles or so, outside outwards; smooth: with vertex normals.
inline Mesh sphere(const Vec3& centre, float radius, int n, bool smooth) {
  Mesh m;
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x < 2 * n; ++x) {
      const double theta = M_PI * y / n, phi = M_PI * x / n;
      const Vec3 d(float(std::sin(theta) * std::cos(phi)), float(std::cos(theta)), float(-std::sin(theta) * std::sin(phi)));
      m.positions.push_back(centre + radius * d);
      if (smooth) m.normals.push_back(d);
    }
  const auto at = [n](int x, int y) { return uint32_t(y * 2 * n + x % (2 * n)); };
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < 2 * n; ++x) {
      if (y > 0)
        for (uint32_t i : {at(x, y), at(x, y + 1), at(x + 1, y)}) m.indices.push_back(i);
      if (y + 1 < n)
        for (uint32_t i : {at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)}) m.indices.push_back(i);
    }
  return m;
}
inline Mat4 translate(const Vec3& t) {
  Mat4 m(1.0f);
  m[3] = Vec4(t, 1.0f);
  return m;
}
inline Mat4 scaling(const Vec3& s) {
  Mat4 m(1.0f);
  m[0][0] = s.x;
  m[1][1] = s.y;
  m[2][2] = s.z;
  return m;
}

/// A scene ready to trace with every light in its subset.
struct Traced {
  ScenePtr scene;
  std::vector<int> subset;
  AccelPtr accel;
  PathTracerSettings settings;
  TaskArena arena{2};

  explicit Traced(ScenePtr s, int width = 8, int height = 8) : scene(std::move(s)), subset(scene->lights.size()) {
    std::iota(subset.begin(), subset.end(), 0);
    settings.camera = scene->cameras[0];
    settings.width = width;
    settings.height = height;
    settings.seed = 7;
    for (const Light& l : scene->lights) {
      settings.groupOf.push_back(0);
      settings.nominal.push_back(l.power);
    }
    accel = Accel::build(view(), arena);
  }
  SceneView view() const { return SceneView(*scene, kPathTracerFacets, subset); }
  std::shared_ptr<const PathTracer> tracer() const { return PathTracer::create(view(), accel, settings); }
};

struct Estimate {
  DVec3 mean{0.0}, error{0.0};
};  ///< error: standard error of the mean
struct Measured {
  std::vector<Estimate> slots;
  uint64_t rays = 0, dropped = 0;
  const Estimate& operator[](size_t i) const { return slots[i]; }
};

/// Mean radiance by slot over all pixels and `blocks` blocks of each. The error comes from the blocks of each pixel, each of
/// a stream of its own: independent whatever the picture shows.
inline Measured estimate(const Traced& t, int blocks) {
  const auto tracer = t.tracer();
  const size_t slots = size_t(tracer->slots()), n = slots * 3, rows = size_t(t.settings.height);
  std::vector<std::vector<double>> sum(rows, std::vector<double>(n, 0.0)), variance = sum;
  std::vector<uint64_t> rays(rows, 0), dropped(rows, 0);
  t.arena.parallelFor(rows, 1, [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end; ++y)
      for (int x = 0; x < t.settings.width; ++x) {
        std::vector<double> s(n, 0.0), q(n, 0.0);
        for (int b = 0; b < blocks; ++b) {
          std::vector<double> out(n, 0.0);
          tracer->traceBlock(x, int(y), uint32_t(b) * kBlocksPerStream, out.data(), rays[y], dropped[y]);
          for (size_t i = 0; i < n; ++i) {
            out[i] /= t.settings.blockSize;
            s[i] += out[i];
            q[i] += out[i] * out[i];
          }
        }
        for (size_t i = 0; i < n; ++i) {
          sum[y][i] += s[i] / blocks;
          variance[y][i] += std::max(0.0, q[i] / blocks - (s[i] / blocks) * (s[i] / blocks)) / (blocks - 1);
        }
      }
  });
  Measured m;
  const double pixels = double(rows) * t.settings.width;
  m.slots.resize(slots);
  for (size_t i = 0; i < n; ++i) {
    double s = 0, v = 0;
    for (size_t y = 0; y < rows; ++y) {
      s += sum[y][i];
      v += variance[y][i];
    }
    m.slots[i / 3].mean[int(i % 3)] = s / pixels;
    m.slots[i / 3].error[int(i % 3)] = std::sqrt(v) / pixels;
  }
  for (size_t y = 0; y < rows; ++y) {
    m.rays += rays[y];
    m.dropped += dropped[y];
  }
  return m;
}

/// |mean - truth| within 4.5 standard errors (one wrong alarm in 150 000 per channel) plus float rounding.
inline void expectNear(const Estimate& e, const DVec3& truth, double relative = 2e-5) {
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(e.mean[c], truth[c], 4.5 * e.error[c] + relative * std::fabs(truth[c]) + 1e-12) << "channel " << c << ", standard error " << e.error[c];
}
/// Two independent estimates of one value.
inline void expectSame(const Estimate& a, const Estimate& b, double relative = 2e-5) {
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(a.mean[c], b.mean[c], 4.5 * std::hypot(a.error[c], b.error[c]) + relative * std::fabs(a.mean[c]) + 1e-12) << "channel " << c;
}

}  // namespace gobo::tests
