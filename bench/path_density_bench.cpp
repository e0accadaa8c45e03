// SPDX-License-Identifier: Apache-2.0
// Outlier rejection on path samples: path density against the estimators of filters/outliers, on the same samples.
//   path_density_bench [errors]   error by scene, samples and estimator
//   path_density_bench time       time of the searches on one scene's samples, error of the approximate one (gate G8); grids and mixtures with their memory
//   path_density_bench combined   combined correlated and importance sampling on a floor under a lamp (path_density/combined.h)
// RMSE^2 = mean over pixels and channels of (x - a)(x - b), a and b two halves of a path-traced reference of other seeds: free of its noise. "ratio": RMSE over
// that of the mean of all samples. "display": RMSE of what is shown, divided by white, clipped to 1, by sRGB's curve, as the source's pictures are; its
// reference's noise is in it. relMSE as RMSE^2, over (((a + b) / 2)^2 + 0.01 white^2). "energy": sum of the picture over that of the mean. "ms": the estimator
// alone. White (of the colours' metric) is 1 / 0.18 of the median pixel's luminance in the 3 x 3 median of the noisy picture: nothing of the reference.
// Arguments: --scene NAME,... (built-in; specular_room, hidden_lamp: made here; or files) --size WxH --spp N,N,... --reference N (each half) --seed
// N
//            --estimators NAME,... (part of a name) --neighbours N --samples N (time) --threads N
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numeric>

#include "filters/outliers/bilateral_grid.h"
#include "filters/outliers/mean_shift.h"
#include "filters/outliers/picture_filters.h"
#include "filters/outliers/sample_estimators.h"
#include "filters/outliers/smoothing_filters.h"
#include "filters/outliers/white.h"
#include "filters/path_density/mixture_density.h"
#include "filters/path_density/neighbour_search.h"
#include "filters/path_density/path_density.h"
#include "filters/path_density/product_tree.h"
#include "filters/path_density/sample_segments.h"
#include "filters/path_density/streaming_density.h"
#include "filters/path_density/trace_samples.h"
#include "import/load.h"
#include "measure/report.h"
#include "path_density/combined.h"
#include "rooms/rooms.h"
#include "trace/accel.h"

using namespace gobo;
using namespace gobo::pathdensity;
using gobo::pathdensitybench::combinedSampling;

namespace {

[[noreturn]] void stop(const Status& status) {
  std::fprintf(stderr, "path_density_bench: %s\n", status.toString().c_str());
  std::exit(1);
}
template <class T>
T need(Result<T> r) {
  if (!r.ok()) stop(r.status());
  return std::move(*r);
}
double msSince(std::chrono::steady_clock::time_point t) { return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t).count(); }

struct Place {
  ScenePtr scene;
  std::vector<int> lights;
  AccelPtr accel;
  PathTracerSettings settings;
};
Place placeOf(const std::string& name, int width, int height, const TaskArena& arena) {
  Place p;
  p.scene = need(bench::roomOf(name));
  if (!p.scene) p.scene = need(loadScene(name));
  p.lights.resize(p.scene->lights.size());
  std::iota(p.lights.begin(), p.lights.end(), 0);
  p.settings.camera = p.scene->cameras[0];
  p.settings.width = width;
  p.settings.height = height;
  for (const Light& l : p.scene->lights) {
    p.settings.groupOf.push_back(0);
    p.settings.nominal.push_back(l.power);
  }
  p.accel = Accel::build(SceneView(*p.scene, kPathTracerFacets, p.lights), arena);
  return p;
}
std::shared_ptr<const PathTracer> tracerOf(Place& p, uint64_t seed) {
  p.settings.seed = seed;
  return PathTracer::create(SceneView(*p.scene, kPathTracerFacets, p.lights), p.accel, p.settings);
}
std::vector<double> reference(Place& p, uint64_t seed, uint32_t samples, const TaskArena& arena) {
  const auto tracer = tracerOf(p, seed);
  const size_t width = size_t(p.settings.width), height = size_t(p.settings.height);
  const uint32_t blocks = std::max(1u, samples / uint32_t(p.settings.blockSize));
  std::vector<double> out(3 * width * height, 0.0);
  arena.parallelFor(height, 1, [&](size_t y, size_t) {
    uint64_t rays = 0, dropped = 0;
    for (size_t x = 0; x < width; ++x)
      for (uint32_t b = 0; b < blocks; ++b) tracer->traceBlock(int(x), int(y), b, &out[3 * (y * width + x)], rays, dropped);
  });
  for (double& v : out) v /= double(blocks) * p.settings.blockSize;
  return out;
}
PathSamples samplesOf(Place& p, uint64_t seed, uint32_t samples, const TaskArena& arena) {
  p.settings.blockSize = int(std::min(samples, 16u));
  const auto tracer = tracerOf(p, seed);
  uint64_t rays = 0, dropped = 0;
  auto made = need(traceSamples(*tracer, p.settings, 0, std::max(1u, samples / uint32_t(p.settings.blockSize)), size_t(8) << 30, arena, rays, dropped));
  p.settings.blockSize = 16;
  return made;
}
/// Samples come twice, a pass of both.
Filtered byGrid(const SampleView& v, const Settings& s, const GridSettings& grid, const TaskArena& arena, size_t* bytes = nullptr) {
  StreamingDensity density = need(StreamingDensity::create(v.width, v.height, s, grid));
  for (const Status& status : {density.count(v, arena), density.weigh(v, arena)})
    if (!status.ok()) stop(status);
  if (bytes) *bytes = density.bytes();
  return need(density.finish(arena));
}
struct Errors {
  double rmse = 0, relMse = 0, shown = 0, energy = 0;
};
/// As displays have it: white is 1, brighter is clipped, the curve of sRGB.
double displayed(double v, double white) {
  const double x = std::clamp(v / white, 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}
Errors errorsOf(const std::vector<float>& x, const std::vector<double>& a, const std::vector<double>& b, double white) {
  double sum = 0, relative = 0, shown = 0, energy = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    const double mean = 0.5 * (a[i] + b[i]), own = double(x[i]), square = (own - a[i]) * (own - b[i]);
    sum += square;
    relative += square / (mean * mean + 0.01 * white * white);
    shown += std::pow(displayed(own, white) - displayed(mean, white), 2);
    energy += own;
  }
  return {std::sqrt(std::max(sum, 0.0) / double(a.size())), std::max(relative, 0.0) / double(a.size()), std::sqrt(shown / double(a.size())), energy};
}

int errors(int argc, char** argv, const TaskArena& arena) {
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "128x96").c_str(), "%dx%d", &width, &height);
  const auto scenes = partsOf(argumentOr(argc, argv, "--scene", "specular_room,spheres,hidden_lamp,atrium,cornell"), ',');
  const auto wanted = partsOf(argumentOr(argc, argv, "--estimators", ""), ',');
  const uint32_t half = uint32_t(std::stoul(argumentOr(argc, argv, "--reference", "2048")));
  const uint64_t seed = std::stoul(argumentOr(argc, argv, "--seed", "1"));
  const int most = std::stoi(argumentOr(argc, argv, "--neighbours", std::to_string(Settings{}.neighbours)));
  std::printf("%-14s %4s %-24s %9s %6s %9s %6s %9s %7s %8s\n", "scene", "spp", "estimator", "RMSE", "ratio", "display", "ratio", "relMSE", "energy", "ms");
  for (const std::string& scene : scenes) {
    Place place = placeOf(scene, width, height, arena);
    const auto a = reference(place, 1001, half, arena), b = reference(place, 1002, half, arena);
    for (const std::string& count : partsOf(argumentOr(argc, argv, "--spp", "16,64"), ',')) {
      const uint32_t n = uint32_t(std::stoul(count));
      const PathSamples samples = samplesOf(place, seed, n, arena);
      const SampleView v = samples.view();
      const SampleBins bins = binSamples(v);
      const auto mean = outliers::meanPicture(v, bins);
      Settings s;
      s.metric.white = need(outliers::whiteOf(mean, width, height, arena));
      s.neighbours = most;
      const std::vector<float> none(v.direct.size(), 0.0f);
      SampleView bounced = v, seen = v;
      bounced.direct = none;
      seen.indirect = none;
      const auto direct = outliers::meanPicture(seen, bins);
      const auto withDirect = [&](std::vector<float> rgb) {
        for (size_t i = 0; i < rgb.size(); ++i) rgb[i] += direct[i];
        return rgb;
      };
      const auto density = [&](const std::function<void(Settings&)>& change) {
        Settings own = s;
        change(own);
        return need(rejectOutliers(v, own, arena)).rgb;
      };
      const std::vector<std::pair<std::string, std::function<std::vector<float>()>>> estimators = {
          {"path_density", [&] { return density([](Settings&) {}); }},
          {"path_density, no spread", [&] { return density([](Settings& o) { o.spread = 0; }); }},
          {"path_density k=50", [&] { return density([](Settings& o) { o.neighbours = 50; }); }},
          {"path_density of 2010", [&] { return density([](Settings& o) { o.neighbours = 50, o.judged = Judged::Together, o.spread = 0; }); }},
          {"grid density", [&] { return byGrid(v, s, {}, arena).rgb; }},
          {"grid density 1 px, 32",
           [&] {
             return byGrid(v, s, {1, 32}, arena).rgb;
           }},
          {"mixture density", [&] { return need(rejectByMixture(v, s, {}, arena)).rgb; }},
          {"mean-shift segments", [&] { return need(rejectSmallSegments(v, s, {}, arena)).rgb; }},
          {"trimmed 1%", [&] { return outliers::trimmedMean(v, bins, 0.01); }},
          {"trimmed 10%", [&] { return outliers::trimmedMean(v, bins, 0.1); }},
          {"trimmed 50%", [&] { return outliers::trimmedMean(v, bins, 0.5); }},
          {"median of pixels", [&] { return outliers::medianFilter(mean, width, height); }},
          {"MAD median of pixels", [&] { return outliers::medianOfOutliers(mean, width, height); }},
          {"G-MoN", [&] { return outliers::adaptiveMedianOfMeans(v, bins); }},
          {"reweighting",
           [&] {
             return outliers::reweightedMean(v, bins, {s.metric.white, 8.0f, 4.0f});
           }},
          {"energy preserving", [&] { return outliers::spreadOutliers(mean, width, height); }},
          {"bilateral", [&] { return outliers::bilateralFilter(mean, width, height, 2.0, 0.1 * double(s.metric.white)); }},
          {"bilateral grid",
           [&] {
             return outliers::bilateralGrid(mean, width, height, {2.0, 0.1, double(s.metric.white)}, {&arena});
           }},
          {"mean shift",
           [&] {
             return outliers::meanShift(mean, width, height, {4.0, 8.0, s.metric.white, 50}, {&arena});
           }},
          {"anisotropic diffusion", [&] { return outliers::anisotropicDiffusion(mean, width, height, 8, 0.1 * double(s.metric.white)); }},
          // As path density is by default: direct light as it is.
          {"trimmed 1%, indirect", [&] { return withDirect(outliers::trimmedMean(bounced, bins, 0.01)); }},
          {"trimmed 10%, indirect", [&] { return withDirect(outliers::trimmedMean(bounced, bins, 0.1)); }},
          {"median, indirect", [&] { return withDirect(outliers::medianFilter(outliers::meanPicture(bounced, bins), width, height)); }},
          {"MAD median, indirect", [&] { return withDirect(outliers::medianOfOutliers(outliers::meanPicture(bounced, bins), width, height)); }},
          {"G-MoN, indirect", [&] { return withDirect(outliers::adaptiveMedianOfMeans(bounced, bins)); }},
          {"reweighting, indirect",
           [&] {
             return withDirect(outliers::reweightedMean(bounced, bins, {s.metric.white, 8.0f, 4.0f}));
           }},
          {"energy pres., indirect", [&] { return withDirect(outliers::spreadOutliers(outliers::meanPicture(bounced, bins), width, height)); }},
      };
      const Errors linear = errorsOf(mean, a, b, double(s.metric.white));
      std::printf("%-14.14s %4u %-24s %9.5f %6.3f %9.5f %6.3f %9.5f %7.3f %8s   white %.4g\n", scene.c_str(), n, "mean", linear.rmse, 1.0, linear.shown, 1.0,
                  linear.relMse, 1.0, "-", double(s.metric.white));
      for (const auto& [name, estimate] : estimators) {
        if (!wanted.empty() && std::none_of(wanted.begin(), wanted.end(), [&](const std::string& w) { return name.find(w) != std::string::npos; })) continue;
        const auto start = std::chrono::steady_clock::now();
        const auto picture = estimate();
        const double ms = msSince(start);
        const Errors e = errorsOf(picture, a, b, double(s.metric.white));
        std::printf("%-14.14s %4u %-24s %9.5f %6.3f %9.5f %6.3f %9.5f %7.3f %8.1f\n", scene.c_str(), n, name.c_str(), e.rmse, e.rmse / linear.rmse, e.shown,
                    e.shown / linear.shown, e.relMse, e.energy / linear.energy, ms);
        std::fflush(stdout);
      }
    }
  }
  return 0;
}

int time(int argc, char** argv, const TaskArena& arena) {
  const std::string scene = argumentOr(argc, argv, "--scene", "specular_room");
  const int k = std::stoi(argumentOr(argc, argv, "--neighbours", "50"));
  const uint32_t n = uint32_t(std::stoul(argumentOr(argc, argv, "--spp", "16")));
  const double count = std::stod(argumentOr(argc, argv, "--samples", "10000000"));
  const int width = int(std::sqrt(count / n * 4 / 3)), height = int(count / n / width);
  Place place = placeOf(scene, width, height, arena);
  auto start = std::chrono::steady_clock::now();
  const PathSamples samples = samplesOf(place, 1, n, arena);
  const SampleView v = samples.view();
  std::printf("%s, %d x %d, %zu samples, k = %d, %d threads; traced in %.0f ms\n", scene.c_str(), width, height, v.size(), k, arena.threads(), msSince(start));
  Settings s;
  s.neighbours = k;
  s.metric.white = need(outliers::whiteOf(outliers::meanPicture(v, binSamples(v)), width, height, arena));
  Filtered exact;
  const auto measured = [&](const char* name, const std::function<Filtered()>& filter) {
    start = std::chrono::steady_clock::now();
    const std::clock_t work = std::clock();
    Filtered f = filter();
    const double ms = msSince(start), cpu = 1000.0 * double(std::clock() - work) / CLOCKS_PER_SEC;
    double rms = 0;
    if (exact.rgb.empty()) exact = f;
    for (size_t i = 0; i < f.rgb.size(); ++i) rms += std::pow(double(f.rgb[i]) - double(exact.rgb[i]), 2) / double(f.rgb.size());
    std::printf("%-34s %9.0f ms, of all threads %9.0f   RMS against the first %.6f   mean weight %.4f\n", name, ms, cpu, std::sqrt(rms),
                std::accumulate(f.weight.begin(), f.weight.end(), 0.0) / double(f.weight.size()));
    std::fflush(stdout);
  };
  const auto run = [&](const char* name, const Settings& own) { measured(name, [&] { return need(rejectOutliers(v, own, arena)); }); };
  const std::string only = argumentOr(argc, argv, "--only", "");
  Settings own = s;
  own.judged = Judged::Together;
  own.spread = 0;
  run("tiles, weights, one term", own);
  if (only == "weights") return 0;
  const double pixels = double(width) * height;
  for (const GridSettings& grid : {GridSettings{}, GridSettings{2, 32}, GridSettings{1, 16}, GridSettings{1, 32}}) {
    size_t bytes = 0;
    measured(("grid, cells of " + std::to_string(grid.cell) + ", " + std::to_string(grid.bins) + " bins").c_str(),
             [&] { return byGrid(v, own, grid, arena, &bytes); });
    std::printf("%-34s %9.0f bytes a pixel; the samples %.0f\n", "", double(bytes) / pixels, double(PathSamples::kBytesOfSample) * n);
  }
  for (const int components : {4, 8, 16}) {
    uint64_t used = 0;
    MixtureSettings mixture;
    mixture.fit.components = components;
    measured(("mixture of " + std::to_string(components)).c_str(), [&] { return need(rejectByMixture(v, own, mixture, arena, {}, &used)); });
    std::printf("%-34s %9.0f bytes a pixel; the samples %.0f\n", "", double(used * sizeof(Gaussian)) / pixels, double(PathSamples::kBytesOfSample) * n);
  }
  measured("mean-shift segments", [&] { return need(rejectSmallSegments(v, own, {}, arena)); });
  Settings tree = own;
  tree.treeEpsilon = 0;
  run("k-d tree, one term", tree);
  if (only == "densities") return 0;
  exact = {};
  s.judged = Judged::Apart;
  s.spread = 0;
  run("tiles, weights, both terms", s);
  own = s;
  own.density = true;
  run("tiles, density map, both terms", own);
  for (const float epsilon : {0.0f, 0.5f, 1.0f, 3.0f}) {
    if (only == "tiles") break;
    own = s;
    own.treeEpsilon = epsilon;
    run(("k-d tree, epsilon " + std::to_string(epsilon)).c_str(), own);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const TaskArena arena(std::atoi(argumentOr(argc, argv, "--threads", "0").c_str()));
  if (argc > 1 && std::string(argv[1]) == "combined") return combinedSampling(arena);
  return argc > 1 && std::string(argv[1]) == "time" ? time(argc, argv, arena) : errors(argc, argv, arena);
}
