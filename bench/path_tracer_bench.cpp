// SPDX-License-Identifier: Apache-2.0
// How fast the reference is: Mpaths/s on the Cornell box (512 x 512, 64 spp, 8 bounces, box filter; rivals on this machine class:
// Cycles 1.45, Mitsuba 3 llvm 3.0, on 2 threads), and how far its rays are from a bare Embree loop over the same rays.
// Prints the wall clock and, because the cores may be shared, the CPU clock. Arguments: [scene] [size] [spp] [threads].
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <numeric>

#include "base/check.h"
#include "import/load.h"
#include "trace/path_kernel.h"

using namespace gobo;

namespace {

double wall() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }
double cpu() {
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

PathTracerSettings settingsFor(const Scene& scene, int size) {
  PathTracerSettings s;
  s.camera = scene.cameras[0];
  s.width = s.height = size;
  s.groups = 1;
  for (const Light& l : scene.lights) {
    s.groupOf.push_back(0);
    s.nominal.push_back(l.power);
  }
  return s;
}

struct BareSeconds {
  double single = 0, packets = 0;
};

// The same rays through nothing but Embree: 1 at a time, and in packets of 16 as they come.
BareSeconds bare(const char* name, const Accel& accel, const std::vector<Ray>& rays, bool shadow, bool coherent) {
  if (rays.empty()) return {};
  const RTCScene scene = accel.impl().scene;
  double best1 = 1e9, best16 = 1e9;
  size_t hits = 0;
  for (int repeat = 0; repeat < 3; ++repeat) {
    double t0 = cpu();
    embree::Context context;
    embree::initContext(context);
    for (const Ray& r : rays) {
      RTCRayHit h;
      h.ray = {r.origin.x, r.origin.y, r.origin.z, r.tmin, r.direction.x, r.direction.y, r.direction.z, 0.0f, r.tmax, ~0u, 0, 0};
      h.hit.geomID = h.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      if (shadow) embree::occluded1(scene, context, h.ray);
      else embree::intersect1(scene, context, h, coherent);
      hits += shadow ? h.ray.tfar < 0.0f : h.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    best1 = std::min(best1, cpu() - t0);
    t0 = cpu();
    for (size_t at = 0; at + 16 <= rays.size(); at += 16) {
      RTCRayHit16 h;
      alignas(64) int valid[16];
      for (int i = 0; i < 16; ++i) {
        const Ray& r = rays[at + i];
        valid[i] = -1;
        h.ray.org_x[i] = r.origin.x;
        h.ray.org_y[i] = r.origin.y;
        h.ray.org_z[i] = r.origin.z;
        h.ray.tnear[i] = r.tmin;
        h.ray.dir_x[i] = r.direction.x;
        h.ray.dir_y[i] = r.direction.y;
        h.ray.dir_z[i] = r.direction.z;
        h.ray.tfar[i] = r.tmax;
        h.ray.time[i] = 0;
        h.ray.mask[i] = ~0u;
        h.ray.id[i] = 0;
        h.ray.flags[i] = 0;
        h.hit.geomID[i] = h.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      }
      if (shadow) embree::occluded16(valid, scene, context, reinterpret_cast<RTCRay16&>(h.ray));
      else embree::intersect16(valid, scene, context, h, coherent);
      for (int i = 0; i < 16; ++i) hits += shadow ? h.ray.tfar[i] < 0.0f : h.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    }
    best16 = std::min(best16, cpu() - t0);
  }
  std::printf("  bare Embree, 1 thread, %-8s %8zu rays: intersect1 %6.2f Mray/s, intersect16 %6.2f Mray/s  (hit share %.3f)\n", name, rays.size(),
              rays.size() / best1 * 1e-6, rays.size() / best16 * 1e-6, double(hits) / (6.0 * double(rays.size())));
  return {best1, best16};
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "cornell";
  const int size = argc > 2 ? std::atoi(argv[2]) : 512, spp = argc > 3 ? std::atoi(argv[3]) : 64, threads = argc > 4 ? std::atoi(argv[4]) : 2;
  auto loaded = loadScene(name);
  if (!loaded) {
    std::fprintf(stderr, "%s\n", loaded.status().toString().c_str());
    return 1;
  }
  const Scene& scene = **loaded;
  std::vector<int> all(scene.lights.size());
  std::iota(all.begin(), all.end(), 0);
  const SceneView view(scene, kPathTracerFacets, all);
  TaskArena arena(threads);
  double t0 = wall();
  const AccelPtr accel = Accel::build(view, arena);
  std::printf("%s: %zu triangles, %zu lights; accel %.1f ms, %.1f MB\n", name.c_str(), scene.triangleCount(), scene.lights.size(), 1e3 * (wall() - t0),
              accel->bytes() * 1e-6);
  const PathTracerSettings settings = settingsFor(scene, size);
  const auto tracer = PathTracer::create(view, accel, settings);

  const int blocks = std::max(1, spp / settings.blockSize);
  const double paths = double(size) * size * blocks * settings.blockSize;
  std::vector<double> picture(size_t(size) * size * 3);
  std::vector<double> walls, cpus;
  uint64_t rays = 0, dropped = 0;
  for (int repeat = 0; repeat < 3; ++repeat) {
    std::fill(picture.begin(), picture.end(), 0.0);
    std::vector<uint64_t> rayRows(size, 0), droppedRows(size, 0);
    t0 = wall();
    const double c0 = cpu();
    arena.parallelFor(size, 1, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y)
        for (int x = 0; x < size; ++x)
          for (int b = 0; b < blocks; ++b) tracer->traceBlock(x, int(y), uint32_t(b), &picture[(y * size + x) * 3], rayRows[y], droppedRows[y]);
    });
    walls.push_back(wall() - t0);
    cpus.push_back(cpu() - c0);
    rays = std::accumulate(rayRows.begin(), rayRows.end(), uint64_t(0));
    dropped = std::accumulate(droppedRows.begin(), droppedRows.end(), uint64_t(0));
  }
  double mean[3] = {0, 0, 0};
  for (size_t i = 0; i < picture.size(); ++i) mean[i % 3] += picture[i];
  for (double& m : mean) m /= paths;
  const double w = *std::min_element(walls.begin(), walls.end()), c = *std::min_element(cpus.begin(), cpus.end());
  std::printf("%dx%d %d spp, %d threads: %.2f s wall = %.2f Mpaths/s, %.2f Mray/s; %.2f s CPU = %.2f Mpaths/s a core-second, x %d threads = %.2f\n", size, size,
              blocks * settings.blockSize, threads, w, paths / w * 1e-6, rays / w * 1e-6, c, paths / c * 1e-6, threads, threads * paths / c * 1e-6);
  std::printf("  %.2f rays a path, mean %.4f %.4f %.4f, dropped %llu\n", rays / paths, mean[0], mean[1], mean[2], (unsigned long long)dropped);

  RayRecorder recorder;
  tracer->impl().recorder = &recorder;
  std::vector<double> scratch(3);
  uint64_t ignored = 0;
  const int step = std::max(1, size / 96);
  for (int y = 0; y < size; y += step)
    for (int x = 0; x < size; x += step) tracer->traceBlock(x, y, 0, scratch.data(), ignored, ignored);
  tracer->impl().recorder = nullptr;
  const double recorded = double(recorder.primary.size()), tracing = c / paths;  // seconds of a core a path
  BareSeconds bareAll;
  for (const BareSeconds& part : {bare("primary", *accel, recorder.primary, false, true), bare("bounce", *accel, recorder.bounce, false, false),
                                  bare("shadow", *accel, recorder.shadow, true, false)}) {
    bareAll.single += part.single;
    bareAll.packets += part.packets;
  }
  std::printf("  of the speed of bare Embree on its rays: %.0f %% of packets, %.0f %% of one ray at a time\n", 100 * bareAll.packets / recorded / tracing,
              100 * bareAll.single / recorded / tracing);
  return 0;
}
