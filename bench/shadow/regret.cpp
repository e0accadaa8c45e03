// SPDX-License-Identifier: Apache-2.0
// Regret of shadows.auto: the time of what it picks, probe included, over the time of the fastest technique that a request can name, of the whole sweep
// and of its own candidates, that keeps the same error. Costs and probe were fitted on fence, planes, grids and boxes (column "tuned"); on other
// scenes they were looked at; those "apart" were chosen before and run after. Times of what is nearly best are measured in turns, so that a busy machine slows
// all of them alike.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

#include "filters/automatic/automatic.h"
#include "measure/report.h"
#include "shadow/bilateral_kernels.h"
#include "shadow/options.h"
#include "shadow/techniques.h"
#include "terms/gbuffer.h"

namespace gobo::shadowbench {
namespace {

struct Point {
  std::string label;
  v1::ShadowTechnique technique;
  bool served = true;  ///< a request can name it; a joint bilateral filter of rays it cannot
  double ms = 0, rmse = 0;
};

struct RegretScene : SceneEntry {
  bool apart = false;  ///< not looked at before all was chosen
  double sun = 0;      ///< soft: width of the directional light, degrees
};
/// Scenes of the tables, and some that only this looks at.
std::vector<RegretScene> regretScenes() {
  std::vector<RegretScene> list;
  for (const SceneEntry& e : sceneEntries()) list.push_back({e});
  list.push_back({{"spheres", "key", "key", "front", ""}});
  list.push_back({{"lights8", "key", "rim", "front", ""}});
  list.push_back({{"trees", "sun", "", "front", ""}});
  list.push_back({{"atrium", "sun", "", "court", ""}});
  const char* sibenik = "../shared/data/derived/sibenik.glb";
  if (std::filesystem::exists(sibenik)) list.push_back({{sibenik, "lamp0", "", "nave", ""}});
  list.push_back({{"tentacles", "", "key", "front", ""}, true});
  list.push_back({{"lights8", "", "key", "front", ""}, true});
  list.push_back({{"lights8", "", "c", "front", ""}, true});
  list.push_back({{"trees", "", "sun", "under", ""}, true, 2.0});
  list.push_back({{"atrium", "", "sun", "gallery", ""}, true, 1.0});
  return list;
}
bool tunedOn(const std::string& scene) { return scene == "fence" || scene == "planes" || scene == "grids" || scene == "boxes"; }

/// What chooseShadow evaluates while it plans: each node once, inputs before.
struct Evaluated {
  TermPtr term;
  double ms = 0;
};
Result<TermPtr> evaluate(Runner& r, const Graph& graph, NodeId id, std::map<NodeId, Evaluated>& known) {
  if (const auto at = known.find(id); at != known.end()) return at->second.term;
  const GraphNode& n = graph.at(id);
  for (const NodeId i : n.inputs) GOBO_TRY(evaluate(r, graph, i, known).status());
  std::vector<double> times;
  TermPtr out;
  for (int k = 0; k < 3; ++k) {
    const SceneView view(*n.scene, n.node->traits().facets, n.lights);
    RunContext ctx;
    ctx.scene = &view;
    ctx.arena = &r.arena();
    ctx.accels = &r.accels();
    for (const NodeId i : n.inputs) ctx.inputs.push_back(known.at(i).term);
    out.reset();  // memory that was touched before, as for what is measured beside it
    const double begin = r.now();
    GOBO_ASSIGN(out, runNode(*n.node, ctx));
    times.push_back(r.now() - begin);
  }
  known[id] = {out, median(times)};
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
      const double begin = r.now();
      V = jointBilateral(r.arena(), *g, m->V, s.bilateral);
      ms += r.now() - begin;
    }
    points.push_back({s.label(), s.technique, s.bilateral == 0, ms, errorsOf(truth, V).rmse});
  }
  return points;
}

struct Case {
  AutomaticChoice choice;
  double probeMs = 0;
};
Result<Case> choose(Runner& r, double budget) {
  Case c;
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
  std::map<NodeId, Evaluated> known;
  GOBO_ASSIGN(c.choice, chooseShadow(graph, input, t, [&](const Graph& g, NodeId id) { return evaluate(r, g, id, known); }));
  for (const auto& [id, e] : known) c.probeMs += e.ms;
  // What the choice was judged by and needs again, its map, is there already: structurally equal nodes are one, and the server's store keeps them.
  const v1::ShadowTechnique& chosen = c.choice.candidates[c.choice.chosen].technique;
  input.gbuffer = graph.add({makeGBufferNode({input.camera, input.width, input.height, 1}), {}, {}, "gbuffer", 0, input.scene, false});
  GOBO_ASSIGN(const NodeId node, findShadowTechnique(chosen.technique_case())->plan(graph, input, chosen));
  std::vector<NodeId> open{node};
  std::set<NodeId> seen;
  while (!open.empty()) {
    const NodeId id = open.back();
    open.pop_back();
    if (!seen.insert(id).second) continue;
    if (const auto at = known.find(id); at != known.end()) c.probeMs -= at->second.ms;
    for (const NodeId i : graph.at(id).inputs) open.push_back(i);
  }
  return c;
}

/// Times of some points, in turns.
Status inTurns(Runner& r, std::vector<Point*> points, int rounds) {
  std::vector<std::vector<double>> ms(points.size());
  const int repeat = r.repeat();
  r.setRepeat(3);  // the first touches memory
  for (int k = 0; k < rounds; ++k)
    for (size_t i = 0; i < points.size(); ++i) {
      GOBO_ASSIGN(const Measured m, r.measure(points[i]->technique));
      ms[i].push_back(m.ms.total());
    }
  r.setRepeat(repeat);
  for (size_t i = 0; i < points.size(); ++i) points[i]->ms = median(ms[i]);
  return {};
}

struct Figures {
  std::vector<double> cold, remembered;
  void print(const char* of) {
    if (cold.empty()) return;
    std::sort(cold.begin(), cold.end());
    std::sort(remembered.begin(), remembered.end());
    std::printf("regret over %zu cases%s: median %.2f, worst %.2f; probe remembered: median %.2f, worst %.2f (asked: 1.2 and 2)\n", cold.size(), of,
                median(cold), cold.back(), median(remembered), remembered.back());
  }
};

constexpr int kContenders = 3, kRounds = 3;

}  // namespace

int regret(Options o) {
  if (!o.width) {
    o.width = 640;
    o.height = 480;
  }
  if (!o.truth) o.truth = 512;
  Table table("shadow_regret", {"scene", "tuned", "kind", "budget", "chosen", "probe ms", "chosen ms", "predicted ms", "its error", "expected", "best within",
                                "best ms", "regret", "remembered", "bilateral ms"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("clock", o.clock == Runner::Clock::Cpu ? "processor time of all threads" : "wall");
  Figures all, others, apart;
  for (const RegretScene& e : regretScenes()) {
    if (e.scene == "fence" || (!o.only.empty() && e.scene.find(o.only) == std::string::npos)) continue;
    for (const bool soft : {false, true}) {
      Options at = o;
      at.scene = e.scene;
      at.light = soft ? e.soft : e.hard;
      at.camera = e.camera;
      if (soft) at.sun = e.sun;
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
      r.setRepeat(1);  // what comes near is measured again, in turns
      auto points = sweep(r, *truth, soft, o.quick);
      r.setRepeat(o.repeat);
      if (!points.ok()) {
        std::fprintf(stderr, "%s\n", points.status().toString().c_str());
        return 1;
      }
      // Its own candidates are what a request could name too.
      const auto candidates = choose(r, 0.0);
      if (!candidates.ok()) {
        std::fprintf(stderr, "%s\n", candidates.status().toString().c_str());
        return 1;
      }
      for (const AutomaticCandidate& c : candidates->choice.candidates) {
        const auto m = r.measure(c.technique);
        if (m.ok()) points->push_back({c.text, c.technique, true, m->ms.total(), errorsOf(*truth, m->V).rmse});
      }
      for (const double budget : {0.2, 0.1, 0.05, 0.03}) {
        const auto picked = choose(r, budget);
        if (!picked.ok()) {
          std::fprintf(stderr, "%s\n", picked.status().toString().c_str());
          return 1;
        }
        const AutomaticCandidate& chosen = picked->choice.candidates[picked->choice.chosen];
        Point* own = nullptr;
        for (Point& p : *points)
          if (p.label == chosen.text) own = &p;
        if (!own) return 1;
        // At equal error: what keeps the budget, or the choice's own error where that misses it.
        const double limit = std::max(budget, own->rmse);
        std::vector<Point*> contenders;
        double bilateral = 0;
        for (Point& p : *points) {
          if (p.rmse > limit || &p == own) continue;
          if (p.served) contenders.push_back(&p);
          else if (bilateral == 0 || p.ms < bilateral) bilateral = p.ms;
        }
        std::sort(contenders.begin(), contenders.end(), [](const Point* x, const Point* y) { return x->ms < y->ms; });
        if (contenders.size() > kContenders) contenders.resize(kContenders);
        contenders.push_back(own);
        if (const Status s = inTurns(r, contenders, kRounds); !s.ok()) {
          std::fprintf(stderr, "%s\n", s.toString().c_str());
          return 1;
        }
        const Point* best = own;
        for (const Point* p : contenders)
          if (p->ms < best->ms) best = p;
        const double cold = (picked->probeMs + own->ms) / best->ms, remembered = own->ms / best->ms;
        std::vector<Figures*> of{e.apart ? &apart : &all};
        if (!e.apart && !tunedOn(e.scene)) of.push_back(&others);
        for (Figures* f : of) {
          f->cold.push_back(cold);
          f->remembered.push_back(remembered);
        }
        table.add({e.scene,
                   std::string(e.apart            ? "apart"
                               : tunedOn(e.scene) ? "yes"
                                                  : "no"),
                   std::string(soft ? "soft" : "hard"), budget, chosen.text, picked->probeMs, own->ms, chosen.ms, own->rmse, chosen.rmse, best->label, best->ms,
                   cold, remembered, bilateral});
      }
    }
  }
  std::fputs(table.text().c_str(), stdout);
  if (all.cold.empty() && apart.cold.empty()) return 1;
  all.print("");
  others.print(" of them in scenes that nothing was fitted on");
  apart.print(" that were not looked at before");
  std::filesystem::create_directories(o.out);
  const std::string path = o.out + "/shadow_regret";
  for (const Status& s : {table.write(path + ".csv"), table.write(path + ".json")})
    if (!s.ok()) {
      std::fprintf(stderr, "%s\n", s.toString().c_str());
      return 1;
    }
  return 0;
}

int costs(Options o) {
  if (!o.width) {
    o.width = 640;
    o.height = 480;
  }
  if (!o.truth) o.truth = 512;
  Table table("shadow_costs", {"scene", "kind", "candidate", "predicted ms", "measured ms", "ratio", "expected", "its error", "receivers", "taps", "boxes",
                               "rows", "vectors", "light space ms"});
  for (const RegretScene& e : regretScenes()) {
    if (!o.only.empty() ? e.scene.find(o.only) == std::string::npos : !tunedOn(e.scene)) continue;
    for (const bool soft : {false, true}) {
      Options at = o;
      at.scene = e.scene;
      at.light = soft ? e.soft : e.hard;
      at.camera = e.camera;
      if (soft) at.sun = e.sun;
      if (at.light.empty()) continue;
      auto runner = makeRunner(at, soft);
      if (!runner.ok()) continue;
      Runner& r = **runner;
      const auto truth = makeTruth(r, baseName(at) + (soft ? "-soft-" : "-hard-") + std::to_string(o.width), o.truth, o.out + "/truth");
      const auto picked = choose(r, 0.0);
      if (!truth.ok() || !picked.ok()) {
        std::fprintf(stderr, "%s %s\n", truth.status().toString().c_str(), picked.status().toString().c_str());
        return 1;
      }
      for (const AutomaticCandidate& c : picked->choice.candidates) {
        const auto m = r.measure(c.technique);
        if (!m.ok()) continue;
        const auto at = [&](size_t i) { return i < c.work.size() ? c.work[i] : 0.0; };
        table.add({e.scene, std::string(soft ? "soft" : "hard"), c.text, c.ms, m->ms.total(), m->ms.total() / c.ms, c.judged ? c.rmse : 0.0,
                   errorsOf(*truth, m->V).rmse, picked->choice.receivers, at(0), at(1), at(2), at(3), m->ms.map()});
      }
      table.add({e.scene, std::string(soft ? "soft" : "hard"), std::string("(probes)"), 0.0, picked->probeMs, 0.0, 0.0, 0.0, picked->choice.receivers, 0.0, 0.0,
                 0.0, 0.0, 0.0});
    }
  }
  std::fputs(table.text().c_str(), stdout);
  return 0;
}

}  // namespace gobo::shadowbench
