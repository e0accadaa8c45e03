// SPDX-License-Identifier: Apache-2.0
// Regret of shadows.auto: the time of what it picks, probe included, over the time of the fastest technique of the whole sweep that keeps the
// same error; the scenes are others than those that its costs were taken from ("fence").
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>

#include "filters/automatic/automatic.h"
#include "measure/report.h"
#include "shadow/bilateral_kernels.h"
#include "shadow/options.h"
#include "shadow/techniques.h"

namespace gobo::shadowbench {
namespace {

struct Point {
  std::string label;
  double ms = 0, rmse = 0;
};

/// What chooseShadow evaluates while it plans: each node once, inputs before.
Result<TermPtr> evaluate(Runner& r, const Graph& graph, NodeId id, std::map<NodeId, TermPtr>& known, double& total) {
  const GraphNode& n = graph.at(id);
  std::vector<double> times;
  TermPtr out;
  for (int k = 0; k < 3; ++k) {
    const SceneView view(*n.scene, n.node->traits().facets, n.lights);
    RunContext ctx;
    ctx.scene = &view;
    ctx.arena = &r.arena();
    ctx.accels = &r.accels();
    for (const NodeId i : n.inputs) ctx.inputs.push_back(known.at(i));
    const auto begin = std::chrono::steady_clock::now();
    GOBO_ASSIGN(out, runNode(*n.node, ctx));
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
  }
  std::sort(times.begin(), times.end());
  total += times[1];
  known[id] = out;
  return out;
}

Result<std::vector<Point>> sweep(Runner& r, const Truth& truth, bool soft, bool quick) {
  std::vector<Point> points;
  for (const Setting& s : soft ? softSettings(quick) : hardSettings(quick)) {
    if (!r.supported(s.technique)) continue;
    const bool supersampled = s.family == "rays" && s.viewSamples > 1;
    if (supersampled) continue;  // view samples are the request's, not the technique's
    auto m = r.measure(s.technique);
    if (!m.ok()) continue;
    double ms = m->ms.total();
    std::vector<float> V = m->V;
    if (s.bilateral != 0) {
      const TermPtr g = r.gbuffer(r.camera());
      const auto begin = std::chrono::steady_clock::now();
      V = jointBilateral(r.arena(), *g, m->V, s.bilateral);
      ms += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    }
    points.push_back({s.label(), ms, errorsOf(truth, V).rmse});
  }
  return points;
}

}  // namespace

int regret(Options o) {
  if (!o.width) {
    o.width = 640;
    o.height = 480;
  }
  if (!o.truth) o.truth = 512;
  Table table("shadow_regret", {"scene", "kind", "budget", "chosen", "probe ms", "chosen ms", "its error", "expected", "best within", "best ms", "regret"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  std::vector<double> all;
  for (const SceneEntry& e : sceneEntries()) {
    if (e.scene == "fence" || (!o.only.empty() && e.scene.find(o.only) == std::string::npos)) continue;
    for (const bool soft : {false, true}) {
      Options at = o;
      at.scene = e.scene;
      at.light = soft ? e.soft : e.hard;
      at.camera = e.camera;
      if (at.light.empty()) continue;
      auto runner = makeRunner(at, soft);
      if (!runner.ok()) {
        std::fprintf(stderr, "%s: %s\n", e.scene.c_str(), runner.status().toString().c_str());
        continue;
      }
      Runner& r = **runner;
      r.setRepeat(o.repeat);
      const std::string size = std::to_string(o.width);
      const auto truth = makeTruth(r, baseName(at) + (soft ? "-soft-" : "-hard-") + size, o.truth, o.out + "/truth");
      if (!truth.ok()) {
        std::fprintf(stderr, "%s\n", truth.status().toString().c_str());
        return 1;
      }
      auto points = sweep(r, *truth, soft, o.quick);
      if (!points.ok()) {
        std::fprintf(stderr, "%s\n", points.status().toString().c_str());
        return 1;
      }
      for (const double budget : {0.2, 0.1, 0.05, 0.03}) {
        Graph graph;
        ShadowInput input;
        input.scene = r.scene();
        input.light = r.light();
        input.camera = r.camera();
        input.width = r.width();
        input.height = r.height();
        input.seed = 1;
        v1::ShadowTechnique t;
        t.mutable_auto_()->set_error(budget);
        double probe = 0;
        std::map<NodeId, TermPtr> known;
        const auto choice = chooseShadow(graph, input, t, [&](const Graph& g, NodeId id) { return evaluate(r, g, id, known, probe); });
        if (!choice.ok()) {
          std::fprintf(stderr, "%s\n", choice.status().toString().c_str());
          return 1;
        }
        const AutomaticCandidate& chosen = choice->candidates[choice->chosen];
        const auto m = r.measure(chosen.technique);
        if (!m.ok()) {
          std::fprintf(stderr, "%s\n", m.status().toString().c_str());
          return 1;
        }
        const double error = errorsOf(*truth, m->V).rmse, ms = probe + m->ms.total();
        // At equal error: what keeps the budget, or the choice's own error where that misses it.
        Point best{chosen.text, m->ms.total(), error};
        for (const Point& p : *points)
          if (p.rmse <= std::max(budget, error) && p.ms < best.ms) best = p;
        all.push_back(ms / best.ms);
        table.add(
            {e.scene, std::string(soft ? "soft" : "hard"), budget, chosen.text, probe, m->ms.total(), error, chosen.rmse, best.label, best.ms, ms / best.ms});
      }
    }
  }
  std::fputs(table.text().c_str(), stdout);
  if (all.empty()) return 1;
  std::sort(all.begin(), all.end());
  std::printf("regret over %zu cases: median %.2f, worst %.2f (asked: 1.2 and 2)\n", all.size(), all[all.size() / 2], all.back());
  std::filesystem::create_directories(o.out);
  const std::string path = o.out + "/shadow_regret";
  for (const Status& s : {table.write(path + ".csv"), table.write(path + ".json")})
    if (!s.ok()) {
      std::fprintf(stderr, "%s\n", s.toString().c_str());
      return 1;
    }
  return 0;
}

}  // namespace gobo::shadowbench
