// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/automatic.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/automatic/decision.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/parameter.h"
#include "filters/ray_traced/technique.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/soft_shadow.h"

namespace gobo {
inline namespace filters {
namespace {

// Nanoseconds on the machine of docs/benchmarks.md (2 cores), by `bench/shadow_bench costs`.
struct Costs {
  double sample = 2;                                             // a view sample that only background or the wrong side shows
  double shadowRay = 13, softRay = 40;                           // one occlusion query with its set-up, in packets, among 1000 triangles
  double tree = 0.38, alpha = 0.8;                               // rays: share more per doubling of triangles; per share of triangles with alpha
  double depthTexel = 0.45, depthEdge = 11, depthTriangle = 15;  // scan conversion: t texels and r triangles cost a t + b sqrt(r t) + c r
  double hardLookup = 5.5;                                       // percentage-closer
  double softTexel = 0.4, softSearch = 22, softFilter = 88;      // depth bounds; a lookup: the search, and the rest in penumbras
  double probeRay = 25;                                          // a ray of a probe
  double depth(double texels, double triangles) const { return depthTexel * texels + depthEdge * std::sqrt(texels * triangles) + depthTriangle * triangles; }
};

constexpr uint32_t kEnvironmentRays = 4;  // bench/environment_bench
// Looks, each closer than those before: numbers of ProbeDesign. A later one is taken only where it can pay for itself (decision.h).
struct LookSize {
  int cells, split, judged;
};
constexpr LookSize kHardLooks[] = {{576, 64, 96}, {1152, 192, 384}, {2304, 512, 1536}};
constexpr LookSize kSoftLooks[] = {{576, 64, 96}, {1152, 128, 288}};
constexpr double kHardTaps = 4, kSoftTaps = 136;  // rays a view sample that a map's probe takes, at most

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
  const v1::AutomaticShadow& a = technique.auto_();
  const ShadowBudget budget{numberParameter(a, "error"), a.has_time_ms() ? a.time_ms() : 0.0};
  const std::span<const LookSize> looks = soft ? std::span<const LookSize>(kSoftLooks) : std::span<const LookSize>(kHardLooks);
  const size_t rays = probe.rays.size();
  std::vector<ProbeEvidence> evidence(choice.candidates.size());
  std::vector<double> penumbra(evidence.size(), 0.0);
  double pixels = 0;
  // Rays are shot where the light can shine; soft lookups filter only in penumbras.
  const auto time = [&](size_t k) {
    const double ms = choice.candidates[k].ms;
    if (k < rays) return samples * (cost.sample + choice.receivers * ms) * 1e-6;
    return ms + (soft ? samples * choice.receivers * (cost.softSearch + penumbra[k] * cost.softFilter) * 1e-6 : 0.0);
  };
  std::vector<size_t> asked;  // maps that the look is for; the first asks for those that may win by their time
  for (size_t look = 0; look < looks.size(); ++look) {
    probe.cells = looks[look].cells;
    probe.split = looks[look].split;
    probe.judged = looks[look].judged;
    probe.seed = look == 0 ? shadowSeed(input) : hash64(shadowSeed(input), look);
    const std::string at = look == 0 ? "" : " look " + std::to_string(look + 1);
    const NodeId node = graph.add({makeShadowProbeNode(probe), {}, {input.light}, "shadow_probe:" + light.name + at, 0, input.scene, false});
    GOBO_ASSIGN(const TermPtr judged, expand(graph, node));
    if (!judged) return choice;
    const double more = probe.judged;
    choice.receivers = (pixels * choice.receivers + more * judged->plane<double>("share")[0]) / (pixels + more);
    pixels += more;
    for (size_t k = 0; k < rays; ++k) evidence[k].add(judged->plane<double>("mse")[k], judged->plane<double>("variance")[k], more);
    for (size_t k = 0; k < evidence.size(); ++k) evidence[k].ms = time(k);
    const auto askMap = [&](size_t k) -> Status {
      const MapProbeSettings m{maps[k - rays], base.bias, base.slopeBias, soft ? softLight(light.shape).size : Vec2(0.0f), input.viewSamples, input.clear};
      const std::string label = "map_probe:" + light.name + " " + std::to_string(m.map.resolution) + at;
      const NodeId id = graph.add({makeMapProbeNode(m), {node}, {}, label, 0, input.scene, false});
      GOBO_ASSIGN(const TermPtr term, expand(graph, id));
      const double before = evidence[k].pixels;
      penumbra[k] = (before * penumbra[k] + more * term->plane<double>("penumbra")[0]) / (before + more);
      evidence[k].add(term->plane<double>("mse")[0], term->plane<double>("variance")[0], more);
      evidence[k].ms = time(k);
      return {};
    };
    if (look == 0) {
      // Maps, cheapest first (they are in that order). One that cannot win by its time is not judged; its time is at least what is said of it.
      for (size_t k = rays; k < evidence.size(); ++k) {
        if (k > 0) {
          const ProbeEvidence& best = evidence[chooseByEvidence(std::span(evidence).first(k), budget)];
          if (budget.timeMs > 0 ? evidence[k].ms > budget.timeMs && best.ms <= budget.timeMs : best.high() <= budget.error && evidence[k].ms >= best.ms)
            continue;
        }
        GOBO_TRY(askMap(k));
      }
    } else {
      for (const size_t k : asked) GOBO_TRY(askMap(k));
    }
    choice.chosen = chooseByEvidence(evidence, budget);
    const std::vector<size_t> rivals = rivalsOf(evidence, budget, choice.chosen);
    if (look + 1 == looks.size()) break;
    asked.clear();
    for (const size_t k : rivals)
      if (k >= rays) asked.push_back(k);
    if (choice.chosen >= rays) asked.push_back(choice.chosen);
    ShadowProbeSettings next = probe;
    next.cells = looks[look + 1].cells;
    next.split = looks[look + 1].split;
    next.judged = looks[look + 1].judged;
    const double taps = (soft ? kSoftTaps : kHardTaps) * double(asked.size()) * next.judged * input.viewSamples;
    if (!worthAnotherLook(evidence, budget, choice.chosen, rivals, (shadowProbeRays(next) + taps) * cost.probeRay * deep * 1e-6)) break;
  }
  for (size_t k = 0; k < evidence.size(); ++k) {
    AutomaticCandidate& c = choice.candidates[k];
    c.ms = evidence[k].ms;
    c.judged = evidence[k].judged();
    c.rmse = evidence[k].high();
  }
  return choice;
}

}  // namespace filters
}  // namespace gobo
