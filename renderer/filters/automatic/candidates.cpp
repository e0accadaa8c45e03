// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/candidates.h"

#include <algorithm>
#include <cmath>

#include "filters/shadow_map/techniques.h"
#include "terms/shadow_light.h"

namespace gobo {
inline namespace filters {
namespace {

// Nanoseconds on the machine of docs/benchmarks.md (2 cores), by `bench/shadow_bench costs`.
struct Costs {
  double sample = 2;                                             // a view sample that only background or the wrong side shows
  double shadowRay = 13, softRay = 40;                           // one occlusion query with its set-up, in packets, among 1000 triangles
  double tree = 0.38, alpha = 0.8;                               // rays: share more per doubling of triangles; per share of triangles with alpha
  double softTree = 0.15, softAlpha = 1.8, softOrigin = 4;       // the same of soft ones, which are many from one place; ns a place and doubling
  double depthTexel = 0.45, depthEdge = 11, depthTriangle = 15;  // scan conversion: t texels and r triangles cost a t + b sqrt(r t) + c r
  double hardLookup = 5.5;                                       // percentage-closer
  double softTexel = 1.2;                                        // depth bounds
  double softLookup = 36;                                        // the bounds' part of a soft lookup
  double softWork[SoftWork::kChannels] = {1.4, 38, 0, 1.4};      // of what it reads
  double pilotRay = 60, filterRay = 45;                          // axis-aligned filtering: a ray of the pilot, one beyond it
  double filtered = 60, filterTap = 1.0;                         // the rest of a view sample; a tap of the filter
  double windowSample = 60;                                      // a view sample of a window
  double probeRay = 25, softProbeRay = 75;                       // a ray of a probe
  double depth(double texels, double triangles) const { return depthTexel * texels + depthEdge * std::sqrt(texels * triangles) + depthTriangle * triangles; }
};

constexpr uint32_t kSoftRays[] = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32};
constexpr int kHardMaps[] = {256, 512, 1024, 2048, 4096}, kSoftMaps[] = {256, 512, 1024, 2048};
struct Taps {
  int search, filter;
};
constexpr Taps kSoftTaps[] = {{8, 16}, {32, 64}};
constexpr uint32_t kFilterRays[] = {4, 8, 16};

struct Shapes {
  double triangles = 0, alpha = 0;
};
Shapes shapesOf(const Scene& scene) {
  Shapes s;
  for (const Instance& i : scene.instances) {
    const Mesh& mesh = *scene.meshes[size_t(i.mesh)];
    const double n = double(mesh.triangles());
    s.triangles += n;
    if (scene.materials[size_t(mesh.material)].coverage.mode != AlphaMode::Opaque) s.alpha += n;
  }
  return s;
}

}  // namespace

double CandidateCost::time(double samples, double receivers, std::span<const double> work) const {
  double ns = receivers * receiver;
  for (size_t i = 0; i < work.size(); ++i) ns += work[i] * workNs[i];
  return ms + samples * ns * 1e-6;
}

ProbeWindowsSettings filterWindows(int viewSamples) {
  ProbeWindowsSettings s;
  s.viewSamples = viewSamples;
  return s;
}

bool castsSoftShadows(const LightShape& s) {
  return s.kind == LightKind::Rect || s.kind == LightKind::Disk || s.kind == LightKind::Sphere || isWideDirectional(s);
}

Result<Candidates> shadowCandidates(const ShadowInput& input, const v1::ShadowTechnique& technique) {
  Candidates out;
  const Costs cost;
  const LightShape& light = input.scene->lights[size_t(input.light)].shape;
  const bool delta = isDeltaLight(light), soft = castsSoftShadows(light);
  const double samples = double(input.filmWidth()) * input.filmHeight() * input.viewSamples;
  const auto add = [&](AutomaticCandidate c, CandidateCost costs) {
    out.list.push_back(std::move(c));
    out.costs.push_back(std::move(costs));
  };
  const Shapes shapes = shapesOf(*input.scene);
  const double doublings = std::log2(1.0 + shapes.triangles / 1000.0), alphas = shapes.alpha / std::max(shapes.triangles, 1.0);
  const double deep = (1.0 + (delta ? cost.tree : cost.softTree) * doublings) * (1.0 + (delta ? cost.alpha : cost.softAlpha) * alphas);
  out.probeRay = (soft ? cost.softProbeRay : cost.probeRay) * deep;
  if (light.kind != LightKind::Environment) {
    if (delta) out.rays = {1};
    else out.rays.assign(std::begin(kSoftRays), std::end(kSoftRays));
    for (const uint32_t n : out.rays) {
      AutomaticCandidate c;
      c.technique.mutable_ray_traced()->set_samples(n);
      c.text = "ray_traced, " + std::to_string(n) + (n > 1 ? " rays" : " ray");
      const double receiver = delta ? cost.shadowRay * deep : n * cost.softRay * deep + cost.softOrigin * doublings;
      add(std::move(c), {.ms = samples * cost.sample * 1e-6, .receiver = receiver});
    }
  }
  if (hasShadowLightFrame(light) && !input.clear) {
    const ProbeWindowsSettings w = filterWindows(input.viewSamples);
    const double windows = double(w.extent().elements()), windowsMs = (windows * cost.windowSample + probeWindowsRays(w) * out.probeRay) * 1e-6;
    for (const uint32_t n : kFilterRays) {
      AutomaticCandidate c;
      c.technique.mutable_axis_aligned()->set_mean_samples(n);
      c.text = "axis_aligned, " + std::to_string(n) + " rays";
      const double ray = cost.filterRay * deep, receiver = kFilterPilot * cost.pilotRay * deep + cost.filtered;
      add(std::move(c), {.ms = samples * cost.sample * 1e-6,
                         .receiver = receiver,
                         .judgeMs = windowsMs + windows * (receiver + (n - kFilterPilot) * ray) * 1e-6,
                         .filtered = n,
                         .workNs = {(n - kFilterPilot) * ray, cost.filterTap}});
    }
  }
  if (!shadowMapSupports(light.kind) || !oneSided(light)) return out;
  for (const int resolution : soft ? std::span<const int>(kSoftMaps) : std::span<const int>(kHardMaps)) {
    AutomaticCandidate c;
    *c.technique.mutable_map() = technique.map();
    c.technique.mutable_map()->set_resolution(uint32_t(resolution));
    if (soft) c.technique.mutable_percentage_closer_soft();
    else c.technique.mutable_percentage_closer();
    GOBO_ASSIGN(const PlannedShadowMap planned,
                fitShadowMap(input, c.technique, soft ? 1 : percentageCloserRim(c.technique), soft ? MapWindow::Corners : MapWindow::InFront));
    const ProbeMap map{planned.frames, resolution};
    const double texels = double(resolution) * resolution, depth = map.frames.count * cost.depth(texels, shapes.triangles);
    const std::string size = std::to_string(resolution) + " texels";
    if (!soft) {
      c.text = "percentage_closer, " + size;
      add(std::move(c), {.ms = (depth + samples * cost.hardLookup) * 1e-6, .virtualMap = map});
      continue;
    }
    const double mapMs = (depth + map.frames.count * cost.softTexel * texels) * 1e-6;
    for (const Taps& taps : kSoftTaps) {
      AutomaticCandidate each = c;
      each.technique.mutable_percentage_closer_soft()->set_search_taps(uint32_t(taps.search));
      each.technique.mutable_percentage_closer_soft()->set_filter_taps(uint32_t(taps.filter));
      each.text = "percentage_closer_soft, " + std::to_string(taps.search) + " + " + std::to_string(taps.filter) + " taps, " + size;
      add(std::move(each), {.ms = mapMs + samples * cost.sample * 1e-6,
                            .receiver = cost.softLookup,
                            .judgeMs = mapMs,
                            .resolution = resolution,
                            .taps = taps.filter,
                            .workNs = std::to_array(cost.softWork)});
    }
  }
  return out;
}

}  // namespace filters
}  // namespace gobo
