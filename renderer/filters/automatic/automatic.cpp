// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/automatic.h"

#include <algorithm>
#include <cmath>

#include "filters/automatic/shadow_probe.h"
#include "filters/parameter.h"
#include "filters/ray_traced/technique.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/soft_shadow.h"

namespace gobo::inline filters {
namespace {

// Nanoseconds on the machine of docs/benchmarks.md (2 cores), by `bench/shadow_bench costs`.
struct Costs {
  double sample = 2;                                            // a view sample that only background or the wrong side shows
  double shadowRay = 13, softRay = 40;                          // one occlusion query with its set-up, in packets, among 1000 triangles
  double tree = 0.38, alpha = 0.8;                              // rays: share more per doubling of triangles; per share of triangles with alpha
  double depthTexel = 0.9, depthEdge = 11, depthTriangle = 15;  // scan conversion: t texels and r triangles cost a t + b sqrt(r t) + c r
  double hardLookup = 7.5;                                      // percentage-closer
  double softTexel = 0.4, softLookup = 85;                      // depth bounds; a lookup
  double depth(double texels, double triangles) const { return depthTexel * texels + depthEdge * std::sqrt(texels * triangles) + depthTriangle * triangles; }
};

constexpr uint32_t kEnvironmentRays = 4;             // bench/environment_bench
constexpr int kHardPixels = 400, kSoftPixels = 250;  // penumbras are wide, edges are not
constexpr double kNearMiss = 1.25;                   // what a probe cannot tell apart

bool areaLight(const LightShape& s) { return s.kind == LightKind::Rect || s.kind == LightKind::Disk || s.kind == LightKind::Sphere || isWideDirectional(s); }

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

Result<AutomaticChoice> chooseShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique,
                                     const std::function<Result<TermPtr>(const Graph&, NodeId)>& expand) {
  const Light& light = input.scene->lights[size_t(input.light)];
  const bool soft = areaLight(light.shape), mapped = shadowMapSupports(light.shape.kind);
  const bool delta = isDeltaLight(light.shape);
  const ShadowMapSettings base = shadowMapSettings(technique.map());
  AutomaticChoice choice;
  ShadowProbeSettings probe;
  std::vector<ProbeMap> maps;
  probe.seed = shadowSeed(input);
  probe.pixels = soft ? kSoftPixels : kHardPixels;
  const double samples = double(input.filmWidth()) * input.filmHeight() * input.viewSamples;
  const Costs cost;
  const Shapes shapes = shapesOf(*input.scene);
  const double deep = (1.0 + cost.tree * std::log2(1.0 + shapes.triangles / 1000.0)) * (1.0 + cost.alpha * shapes.alpha / std::max(shapes.triangles, 1.0));

  if (light.shape.kind == LightKind::Directional &&
      light.shape.skyRectangle != Vec2(0.0f)) {  // one of many lights that stand for an environment: their noise averages out, a map's errors add up
    AutomaticCandidate c;
    c.technique.mutable_ray_traced()->set_samples(kEnvironmentRays);
    c.text = "ray_traced, " + std::to_string(kEnvironmentRays) + " rays";
    choice.candidates.push_back(std::move(c));
    return choice;
  }
  if (light.shape.kind != LightKind::Environment) {
    probe.rays = delta ? std::vector<uint32_t>{1} : std::vector<uint32_t>{1, 2, 4, 8, 16, 32};
    for (const uint32_t n : probe.rays) {
      AutomaticCandidate c;
      c.technique.mutable_ray_traced()->set_samples(n);
      c.text = "ray_traced, " + std::to_string(n) + (n > 1 ? " rays" : " ray");
      c.ms = n * (delta ? cost.shadowRay : cost.softRay) * deep;  // a receiver, for now
      choice.candidates.push_back(std::move(c));
    }
  }
  if (mapped) {
    Vec3 lo, hi;
    input.scene->bounds(lo, hi);
    const ShadowTechniqueEntry* softMap = findShadowTechnique(v1::ShadowTechnique::kPercentageCloserSoft);
    for (const int resolution : soft ? std::vector<int>{256, 512, 1024, 2048} : std::vector<int>{256, 512, 1024, 2048, 4096}) {
      if (soft && !softMap) break;
      ProbeMap m;
      m.resolution = resolution;
      GOBO_ASSIGN(m.frames, fitLightFrames(light.shape, lo, hi, resolution, 2));
      AutomaticCandidate c;
      *c.technique.mutable_map() = technique.map();
      c.technique.mutable_map()->set_resolution(uint32_t(resolution));
      if (soft) {
        c.technique.mutable_percentage_closer_soft();
        c.ms = (m.frames.count * (cost.depth(double(resolution) * resolution, shapes.triangles) + cost.softTexel * resolution * resolution) +
                samples * cost.sample) *
               1e-6;
      } else {
        c.technique.mutable_percentage_closer();
        c.ms = (m.frames.count * cost.depth(double(resolution) * resolution, shapes.triangles) + samples * cost.hardLookup) * 1e-6;  // the whole picture
      }
      c.text = std::string(soft ? "percentage_closer_soft" : "percentage_closer") + ", " + std::to_string(resolution) + " texels";
      choice.candidates.push_back(std::move(c));
      maps.push_back(std::move(m));
    }
  }
  if (choice.candidates.empty()) return invalidArgument("light '" + light.name + "': no shadow technique is left for shadows.auto");

  probe.camera = input.camera;
  probe.width = input.filmWidth();
  probe.height = input.filmHeight();
  probe.viewSamples = input.viewSamples;
  probe.clear = input.clear;
  const NodeId node = graph.add({makeShadowProbeNode(probe), {}, {input.light}, "shadow_probe:" + light.name, 0, input.scene, false});
  GOBO_ASSIGN(const TermPtr judged, expand(graph, node));
  if (!judged) return choice;
  choice.receivers = judged->plane<double>("share")[0];
  // Rays are shot where the light can shine; soft lookups are cheap elsewhere.
  for (size_t k = 0; k < choice.candidates.size(); ++k) {
    AutomaticCandidate& c = choice.candidates[k];
    if (k < probe.rays.size()) {
      c.ms = samples * (cost.sample + choice.receivers * c.ms) * 1e-6;
      c.rmse = judged->plane<double>("rays")[k];
    } else {
      c.judged = false;
      if (soft) c.ms += samples * choice.receivers * cost.softLookup * 1e-6;
    }
  }

  const v1::AutomaticShadow& a = technique.auto_();
  const double error = numberParameter(a, "error");
  const auto better = [&](const AutomaticCandidate& x, const AutomaticCandidate& y) {
    if (a.has_time_ms()) {
      const bool fx = x.ms <= a.time_ms(), fy = y.ms <= a.time_ms();
      if (fx != fy) return fx;
      return fx ? (x.rmse != y.rmse ? x.rmse < y.rmse : x.ms < y.ms) : x.ms < y.ms;
    }
    const bool fx = x.rmse <= error, fy = y.rmse <= error;
    if (fx != fy) return fx;
    return fx ? x.ms < y.ms : (x.rmse != y.rmse ? x.rmse < y.rmse : x.ms < y.ms);
  };
  if (!probe.rays.empty())
    for (size_t k = 1; k < probe.rays.size(); ++k)
      if (better(choice.candidates[k], choice.candidates[choice.chosen])) choice.chosen = k;
  // Maps, cheapest first (they are in that order). One that cannot win by its time is not judged.
  for (size_t k = probe.rays.size(); k < choice.candidates.size(); ++k) {
    AutomaticCandidate& c = choice.candidates[k];
    const AutomaticCandidate& best = choice.candidates[choice.chosen];
    const bool first = k == 0;
    if (!first && (a.has_time_ms() ? c.ms > a.time_ms() && best.ms <= a.time_ms() : best.rmse <= error && c.ms >= best.ms)) continue;
    MapProbeSettings m{std::move(maps[k - probe.rays.size()]),          base.bias,         base.slopeBias,
                       soft ? softLight(light.shape).size : Vec2(0.0f), input.viewSamples, input.clear};
    const std::string label = "map_probe:" + light.name + " " + std::to_string(m.map.resolution);
    const NodeId id = graph.add({makeMapProbeNode(m), {node}, {}, label, 0, input.scene, false});
    GOBO_ASSIGN(const TermPtr term, expand(graph, id));
    c.rmse = term->plane<double>("rmse")[0];
    c.judged = true;
    if (!first && better(c, best)) choice.chosen = k;
  }
  // Nobody keeps the error: the cheapest of those that miss it by about as little as the best does.
  const double least = choice.candidates[choice.chosen].rmse;
  if (!a.has_time_ms() && least > error)
    for (size_t k = 0; k < choice.candidates.size(); ++k)
      if (choice.candidates[k].judged && choice.candidates[k].rmse <= kNearMiss * least && choice.candidates[k].ms < choice.candidates[choice.chosen].ms)
        choice.chosen = k;
  return choice;
}

}  // namespace gobo::inline filters
