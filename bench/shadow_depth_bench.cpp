// SPDX-License-Identifier: Apache-2.0
// A light's depth map by Embree rays against scan conversion: processor milliseconds (median of 5, two threads), texels/s of one thread, and the triangles per
// texel at which they meet (LightDepthMapNode::kTrianglesPerTexel). Also single rays, to say what packets bring. The acceleration structure is
// built before the clock starts: the G-buffer needs it anyway.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "filters/shadow_map/shadow_map.h"
#include "scene/load.h"
#include "trace/accel.h"

using namespace gobo;

namespace {

/// Processor time of all threads: a busy machine changes it little.
double now() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// A wavy sheet over a floor: 2 n^2 triangles.
ScenePtr sheet(int n) {
  auto mesh = std::make_shared<Mesh>();
  mesh->name = "sheet";
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x <= n; ++x) {
      const float u = float(x) / float(n), v = float(y) / float(n);
      mesh->positions.push_back(Vec3(4 * u - 2, 0.3f * std::sin(25 * u) * std::cos(19 * v) + 0.02f * std::sin(311 * u + 200 * v), 4 * v - 2));
    }
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const uint32_t a = uint32_t(y * (n + 1) + x), b = a + 1, c = a + uint32_t(n) + 1, d = c + 1;
      for (uint32_t i : {a, c, b, b, c, d}) mesh->indices.push_back(i);
    }
  sealMesh(*mesh);
  auto scene = std::make_shared<Scene>();
  scene->name = "sheet" + std::to_string(2 * n * n);
  scene->materials.emplace_back();
  scene->meshes = {mesh};
  scene->instances.push_back({.name = "sheet", .mesh = 0});
  if (!scene->seal().ok()) std::abort();
  return scene;
}

template <typename Work>
double median(const Work& work) {
  std::vector<double> t;
  for (int i = 0; i < 5; ++i) {
    const double begin = now();
    work();
    t.push_back(now() - begin);
  }
  std::sort(t.begin(), t.end());
  return t[2];
}

}  // namespace

int main() {
  const TaskArena arena(2);
  AccelCache accels;
  std::vector<ScenePtr> scenes;
  for (const char* name : {"cornell", "fence", "trees"}) scenes.push_back(*makeBuiltinScene(name));
  scenes.push_back(sheet(422));
  scenes.push_back(sheet(1000));
  std::printf("%-14s %9s %-12s %5s | %8s %8s %8s ms | %6s %6s Mrays/s | %7s Mtexels/s | tri/texel | raster wins by\n", "scene", "triangles", "light", "side",
              "single", "packets", "raster", "single", "packets", "raster");
  for (const ScenePtr& scene : scenes)
    for (const LightKind kind : {LightKind::Directional, LightKind::Spot}) {
      LightShape light;
      light.kind = kind;
      Vec3 lo, hi;
      scene->bounds(lo, hi);
      const Vec3 centre = 0.5f * (lo + hi);
      light.axis = glm::normalize(Vec3(0.35f, -1.0f, 0.25f));
      light.position = centre - light.axis * glm::length(hi - lo);
      light.cosOuter = std::cos(0.7f);
      for (int side : {256, 512, 1024, 2048}) {
        const LightFrames frames = *fitLightFrames(light, lo, hi, side, 2);
        const Facet facets = Facet::Topology | Facet::Pose | Facet::Coverage;
        const std::vector<int> none;
        const SceneView view(*scene, facets, none);
        const AccelPtr accel = accels.get(view, arena);
        RunContext ctx;
        ctx.scene = &view;
        ctx.arena = &arena;
        ctx.accels = &accels;
        const auto time = [&](DepthMethod method) {
          const NodePtr node = makeLightDepthMapNode(frames, side, method);
          return median([&] {
            if (!runNode(*node, ctx).ok()) std::abort();
          });
        };
        const double packets = time(DepthMethod::Rays), raster = time(DepthMethod::Raster);
        std::vector<float> z(size_t(side) * size_t(side));
        const double single = median([&] {
          arena.parallelFor(size_t(side), 4, [&](size_t begin, size_t end) {
            for (size_t y = begin; y < end; ++y)
              for (int x = 0; x < side; ++x) {
                float start, cosine;
                Hit hit;
                const Ray ray = frames.face[0].ray((float(x) + 0.5f) / float(side), (float(y) + 0.5f) / float(side), start, cosine);
                z[y * size_t(side) + size_t(x)] = accel->intersect(ray, hit) ? start + hit.t * cosine : 1.0f;
              }
          });
        });
        const double texels = double(side) * side;
        std::printf("%-14s %9zu %-12s %5d | %8.2f %8.2f %8.2f    | %6.1f %6.1f         | %7.1f           | %8.3f  | %.2f\n", scene->name.c_str(),
                    scene->triangleCount(), kind == LightKind::Spot ? "spot" : "directional", side, single * 1e3, packets * 1e3, raster * 1e3,
                    texels / single * 1e-6, texels / packets * 1e-6, texels / raster * 1e-6, double(scene->triangleCount()) / texels, packets / raster);
        std::fflush(stdout);
      }
    }
  return 0;
}
