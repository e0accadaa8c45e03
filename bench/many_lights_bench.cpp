// SPDX-License-Identifier: Apache-2.0
// Time to equal error as lights grow from 10 to 1000: scene `lamps` with every k-th lamp kept (of an order that keeps the share of
// strings, ceiling field and candles) at k times the power, so that the hall stays as bright. For every way of selecting lights:
// relMSE of one block of samples a pixel, CPU time a sample, and from both the seconds to a relMSE of 1 % (error falls as 1 / samples).
// relMSE is the mean over pixels and channels of (x - a)(x - b) / (0.01 m^2 + (a + b)^2 / 4), where a and b are two independent halves
// of the reference and m is its mean: the product is free of the reference's own noise. The CPU clock, because cores may be shared.
// Arguments: --size WxH --spp N --reference N --threads N --out PATH (.json, .md, .csv, .txt).
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>

#include "base/check.h"
#include "import/load.h"
#include "measure/report.h"
#include "scene/edit.h"
#include "trace/path_tracer.h"

using namespace gobo;

namespace {

double cpu() {
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

Result<ScenePtr> withLights(const Scene& base, int count) {
  return editScene(base, [&](Scene& s) -> Status {
    std::vector<int> order(s.lights.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [](int a, int b) { return a % 10 < b % 10; });
    const int step = int(order.size()) / count;
    std::vector<Light> kept;
    for (int i = 0; i < count; ++i) {
      Light l = base.lights[order[size_t(i) * step + step / 2]];
      l.power *= float(step);
      kept.push_back(l);
    }
    s.lights = std::move(kept);
    return Status();
  });
}

struct Picture {
  std::vector<double> texels;
  double seconds = 0;
  uint64_t rays = 0;
};

struct Run {
  int width, height;
  TaskArena arena;
  explicit Run(int threads) : arena(threads) {}

  Picture trace(const Scene& scene, const SceneView& view, const AccelPtr& accel, LightSelection selection, uint64_t seed, int spp) const {
    PathTracerSettings s;
    s.camera = scene.cameras[0];
    s.width = width;
    s.height = height;
    s.blockSize = std::min(spp, 4096);
    s.seed = seed;
    s.selection = selection;
    for (const Light& l : scene.lights) {
      s.groupOf.push_back(0);
      s.nominal.push_back(l.power);
    }
    const auto tracer = PathTracer::create(view, accel, s);
    Picture p;
    p.texels.assign(size_t(width) * height * 3, 0.0);
    std::vector<uint64_t> rays(height, 0), dropped(height, 0);
    const double start = cpu();
    arena.parallelFor(size_t(height), 1, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y)
        for (int x = 0; x < width; ++x) tracer->traceBlock(x, int(y), 0, &p.texels[(y * width + x) * 3], rays[y], dropped[y]);
    });
    p.seconds = cpu() - start;
    for (double& v : p.texels) v /= s.blockSize;
    p.rays = std::accumulate(rays.begin(), rays.end(), uint64_t(0));
    return p;
  }
};

double relMse(const Picture& x, const Picture& a, const Picture& b) {
  double mean = 0, sum = 0;
  for (size_t i = 0; i < a.texels.size(); ++i) mean += 0.5 * (a.texels[i] + b.texels[i]);
  mean /= double(a.texels.size());
  for (size_t i = 0; i < a.texels.size(); ++i) {
    const double m = 0.5 * (a.texels[i] + b.texels[i]);
    sum += (x.texels[i] - a.texels[i]) * (x.texels[i] - b.texels[i]) / (0.01 * mean * mean + m * m);
  }
  return sum / double(a.texels.size());
}

}  // namespace

int main(int argc, char** argv) {
  const int threads = std::atoi(argumentOr(argc, argv, "--threads", "2").c_str());
  Run run(std::max(threads, 1));
  run.width = run.height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "80x60").c_str(), "%dx%d", &run.width, &run.height);
  const int spp = std::atoi(argumentOr(argc, argv, "--spp", "16").c_str()), reference = std::atoi(argumentOr(argc, argv, "--reference", "256").c_str());
  if (run.width < 1 || run.height < 1 || spp < 1 || reference < 1 || reference > 4096 || threads < 1) {
    std::fprintf(stderr, "many_lights_bench: sizes and sample counts must be positive, --reference at most 4096\n");
    return 2;
  }
  auto loaded = loadScene("lamps");
  if (!loaded) {
    std::fprintf(stderr, "%s\n", loaded.status().toString().c_str());
    return 1;
  }
  constexpr double kTarget = 0.01;
  const struct {
    LightSelection kind;
    const char* name;
  } selections[] = {{LightSelection::Tree, "tree"}, {LightSelection::Power, "power"}, {LightSelection::Uniform, "uniform"}};
  Table table("many lights", {"lights", "selection", "us a sample", "relMSE", "s to relMSE 0.01", "rays a path"});
  table.note("scene", std::string("lamps, every k-th light at k times the power"));
  table.note("pixels", double(run.width) * run.height);
  table.note("samples a pixel", double(spp));
  table.note("reference samples a pixel, each of two halves", double(reference));
  std::map<std::string, std::map<int, double>> seconds;
  for (const int count : {10, 100, 1000}) {
    auto scene = withLights(**loaded, count);
    if (!scene) {
      std::fprintf(stderr, "%s\n", scene.status().toString().c_str());
      return 1;
    }
    std::vector<int> all(size_t(count), 0);
    std::iota(all.begin(), all.end(), 0);
    const SceneView view(**scene, kPathTracerFacets, all);
    const AccelPtr accel = Accel::build(view, run.arena);
    // The tree makes the best reference for its cost; any selection converges to the same picture.
    const Picture a = run.trace(**scene, view, accel, LightSelection::Tree, 1001, reference),
                  b = run.trace(**scene, view, accel, LightSelection::Tree, 1002, reference);
    for (const auto& s : selections) {
      double error = 0, best = 1e30;
      uint64_t rays = 0;
      constexpr int kSeeds = 4;
      for (int seed = 0; seed < kSeeds; ++seed) {
        const Picture x = run.trace(**scene, view, accel, s.kind, uint64_t(seed + 1), spp);
        error += relMse(x, a, b) / kSeeds;
        best = std::min(best, x.seconds);
        rays += x.rays;
      }
      const double samples = double(run.width) * run.height * spp, time = best * error / kTarget;
      seconds[s.name][count] = time;
      table.add({double(count), std::string(s.name), best / samples * 1e6, error, time, double(rays) / (samples * kSeeds)});
    }
  }
  for (const auto& s : selections) table.note(std::string("growth 10 -> 1000, ") + s.name, seconds[s.name][1000] / seconds[s.name][10]);
  std::printf("%s", table.text().c_str());
  if (const std::string out = argumentOr(argc, argv, "--out", ""); !out.empty()) {
    if (const Status status = table.write(out); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.toString().c_str());
      return 1;
    }
  }
  return 0;
}
