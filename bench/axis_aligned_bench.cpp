// SPDX-License-Identifier: Apache-2.0
// Axis-aligned shadow filtering against plain Monte Carlo on the built-in scene "grids" (camera "receiver", 256 x 256): RMSE of visibility
// against 4096 shadow rays a pixel, over rays and over time; the sample ratio at equal error; the filter's share of the time.
//   axis_aligned_bench [--out FILE.json] [--size 256] [--reference 4096] [--repeat 3]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <thread>

#include "filters/shadow_technique.h"
#include "import/load.h"
#include "terms/gbuffer.h"
#include "trace/accel.h"

using namespace gobo;

namespace {

using Clock = std::chrono::steady_clock;

struct Result1 {
  double rmse = 0, penumbra = 0, rays = 0, ms = 0, filterMs = 0;
};
struct Point {
  std::string curve;
  double asked = 0;
  Result1 r;
};

class Bench {
 public:
  Bench(int size, int repeat) : size_(size), repeat_(repeat) {}

  bool prepare() {
    auto loaded = loadScene("grids");
    if (!loaded.ok()) {
      std::fprintf(stderr, "%s\n", loaded.status().toString().c_str());
      return false;
    }
    scene_ = *loaded;
    const int camera = scene_->findCamera("receiver");
    light_ = scene_->findLight("key");
    if (camera < 0 || light_ < 0) {
      std::fprintf(stderr, "grids: no camera 'receiver' or light 'key'\n");
      return false;
    }
    camera_ = scene_->cameras[camera];
    GBufferSettings g;
    g.camera = camera_;
    g.width = g.height = size_;
    g.viewSamples = 1;
    Graph graph;
    graph.add({makeGBufferNode(g), {}, {}, "gbuffer", 0, scene_, false});
    gbuffer_ = evaluate(graph, 0, nullptr);
    return gbuffer_ != nullptr;
  }

  void reference(uint32_t samples) {
    v1::ShadowTechnique t;
    t.mutable_ray_traced()->set_samples(samples);
    const TermPtr term = run(t, nullptr, /*seed=*/4711);
    const auto V = term->floats("V");
    truth_.assign(V.begin(), V.end());
    // Penumbra band: truth in 0.02..0.98, dilated by 2 pixels.
    band_.assign(truth_.size(), 0);
    for (int y = 0; y < size_; ++y)
      for (int x = 0; x < size_; ++x) {
        const float v = truth_[size_t(y) * size_ + x];
        if (v <= 0.02f || v >= 0.98f) continue;
        for (int j = std::max(0, y - 2); j <= std::min(size_ - 1, y + 2); ++j)
          for (int i = std::max(0, x - 2); i <= std::min(size_ - 1, x + 2); ++i) band_[size_t(j) * size_ + i] = 1;
      }
  }

  Point measure(std::string curve, double asked, const v1::ShadowTechnique& t) {
    Point p{std::move(curve), asked, {}};
    std::vector<Result1> all;
    TermPtr V;
    for (int k = 0; k < repeat_; ++k) {
      Result1 r;
      V = run(t, &r, 1);
      all.push_back(r);
    }
    std::sort(all.begin(), all.end(), [](const Result1& a, const Result1& b) { return a.ms < b.ms; });
    p.r = all[all.size() / 2];
    double sum = 0, bandSum = 0, bandCount = 0;
    const auto v = V->floats("V");
    for (size_t i = 0; i < truth_.size(); ++i) {
      const double d = double(v[i]) - truth_[i];
      sum += d * d;
      if (band_[i]) {
        bandSum += d * d;
        ++bandCount;
      }
    }
    p.r.rmse = std::sqrt(sum / double(truth_.size()));
    p.r.penumbra = bandCount > 0 ? std::sqrt(bandSum / bandCount) : 0;
    return p;
  }
  double bandShare() const { return double(std::count(band_.begin(), band_.end(), 1)) / double(band_.size()); }

 private:
  TermPtr evaluate(const Graph& graph, NodeId wanted, Result1* r) {
    std::vector<TermPtr> terms;
    for (NodeId id = 0; id < graph.size(); ++id) {
      const GraphNode& n = graph.at(id);
      RunContext ctx;
      std::optional<SceneView> view;
      if (n.scene) view.emplace(*n.scene, n.node->traits().facets, n.lights);
      RunCounters counters;
      ctx.scene = view ? &*view : nullptr;
      for (NodeId i : n.inputs) ctx.inputs.push_back(terms[i]);
      ctx.arena = &arena_;
      ctx.accels = &accels_;
      ctx.counters = &counters;
      const auto begin = Clock::now();
      auto out = runNode(*n.node, ctx);
      const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
      if (!out.ok()) {
        std::fprintf(stderr, "%s: %s\n", n.label.c_str(), out.status().toString().c_str());
        std::exit(1);
      }
      terms.push_back(*out);
      if (!r || n.label == "gbuffer") continue;
      r->ms += ms;
      r->rays += double(counters.rays) / (double(size_) * size_);
      if (!n.scene) r->filterMs += ms;
    }
    return terms[wanted];
  }

  TermPtr run(const v1::ShadowTechnique& t, Result1* r, uint64_t seed) {
    Graph graph;
    ShadowInput input;
    input.scene = scene_;
    input.light = light_;
    input.gbuffer = graph.add({std::make_shared<Given>(gbuffer_), {}, {}, "gbuffer", 0, nullptr, false});
    input.camera = camera_;
    input.width = input.height = size_;
    input.seed = seed;
    auto result = findShadowTechnique(t.technique_case())->plan(graph, input, t);
    if (!result.ok()) {
      std::fprintf(stderr, "%s\n", result.status().toString().c_str());
      std::exit(1);
    }
    return evaluate(graph, *result, r);
  }

  class Given final : public Node {
   public:
    explicit Given(TermPtr t) : term_(std::move(t)) {}
    std::string type() const override { return "given"; }
    NodeTraits traits() const override { return {}; }
    void hashParameters(Hasher& h) const override { h.add(term_->content()); }
    gobo::Result<TermShape> infer(std::span<const TermShape>) const override { return shapeOf(*term_); }
    gobo::Result<TermPtr> run(const RunContext&) const override { return term_; }

   private:
    TermPtr term_;
  };

  int size_, repeat_, light_ = 0;
  ScenePtr scene_;
  Camera camera_;
  TaskArena arena_{0};
  AccelCache accels_;
  TermPtr gbuffer_;
  std::vector<float> truth_;
  std::vector<char> band_;
};

/// Rays at which a curve reaches an error, log-log between its points; 0 outside its range.
double raysAt(const std::vector<Point>& points, const char* curve, double rmse, double Result1::*axis = &Result1::rays) {
  const Point* last = nullptr;
  for (const Point& p : points) {
    if (p.curve != curve) continue;
    if (last && last->r.rmse >= rmse && p.r.rmse <= rmse) {
      const double f = std::log(last->r.rmse / rmse) / std::log(last->r.rmse / p.r.rmse);
      return std::exp(std::log(last->r.*axis) * (1 - f) + std::log(p.r.*axis) * f);
    }
    last = &p;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::string out;
  int size = 256, referenceSamples = 4096, repeat = 3;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--out")) out = argv[i + 1];
    else if (!std::strcmp(argv[i], "--size")) size = std::atoi(argv[i + 1]);
    else if (!std::strcmp(argv[i], "--reference")) referenceSamples = std::atoi(argv[i + 1]);
    else if (!std::strcmp(argv[i], "--repeat")) repeat = std::atoi(argv[i + 1]);
  }
  Bench bench(std::max(size, 16), std::max(repeat, 1));
  if (!bench.prepare()) return 1;
  bench.reference(uint32_t(std::max(referenceSamples, 1)));

  std::vector<Point> points;
  for (uint32_t n : {4u, 9u, 16u, 25u, 36u, 64u, 100u, 165u, 256u, 576u}) {
    v1::ShadowTechnique t;
    t.mutable_ray_traced()->set_samples(n);
    points.push_back(bench.measure("mc", n, t));
  }
  for (double n : {9.0, 16.0, 25.0, 64.0, 165.0}) {  // the same count everywhere, fixed width
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_adaptive(false);
    t.mutable_axis_aligned()->set_mean_samples(n);
    points.push_back(bench.measure("aaf uniform k=3", n, t));
  }
  {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_mu(1);
    points.push_back(bench.measure("aaf adaptive k=3", 0, t));
    t.mutable_axis_aligned()->set_beta_threshold(0.5);
    points.push_back(bench.measure("aaf adaptive k=3 threshold=0.5", 0, t));
    t.mutable_axis_aligned()->clear_beta_threshold();
    t.mutable_axis_aligned()->set_radius_px(0);
    points.push_back(bench.measure("adaptive unfiltered", 0, t));
  }
  for (double n : {12.0, 16.0, 25.0, 40.0, 64.0, 100.0, 165.0}) {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_mean_samples(n);
    t.mutable_axis_aligned()->set_max_samples(1024);
    points.push_back(bench.measure("aaf mu", n, t));
  }
  for (double n : {9.0, 16.0, 25.0, 64.0, 165.0}) {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_adaptive(false);
    t.mutable_axis_aligned()->set_mean_samples(n);
    t.mutable_axis_aligned()->set_mu(std::pow(n / 9, 0.25));
    points.push_back(bench.measure("aaf uniform mu", n, t));
  }

  std::printf("grids %dx%d, %d-ray reference, %u hardware threads, penumbra %.0f %% of the picture\n", size, size, referenceSamples,
              std::thread::hardware_concurrency(), 100 * bench.bandShare());
  std::printf("%-32s %8s %10s %10s %10s %9s %9s %11s %11s\n", "curve", "asked", "rays/px", "rmse", "penumbra", "ms", "filter%", "mc rays", "mc ms");
  std::string json = "{\"scene\":\"grids\",\"size\":" + std::to_string(size) + ",\"reference_rays\":" + std::to_string(referenceSamples) + ",\"points\":[";
  for (size_t i = 0; i < points.size(); ++i) {
    const Point& p = points[i];
    const double mcRays = raysAt(points, "mc", p.r.rmse), mcMs = raysAt(points, "mc", p.r.rmse, &Result1::ms);
    std::printf("%-32s %8.0f %10.2f %10.5f %10.5f %9.1f %9.1f %11.1f %11.1f\n", p.curve.c_str(), p.asked, p.r.rays, p.r.rmse, p.r.penumbra, p.r.ms,
                p.r.ms > 0 ? 100 * p.r.filterMs / p.r.ms : 0, mcRays, mcMs);
    char line[512];
    std::snprintf(line, sizeof line,
                  "%s{\"curve\":\"%s\",\"asked\":%g,\"rays\":%.6g,\"rmse\":%.6g,\"rmse_penumbra\":%.6g,\"ms\":%.4g,\"filter_ms\":%.4g,\"mc_rays_at_equal_"
                  "rmse\":%.6g,\"mc_ms_at_equal_rmse\":%.4g}",
                  i ? "," : "", p.curve.c_str(), p.asked, p.r.rays, p.r.rmse, p.r.penumbra, p.r.ms, p.r.filterMs, mcRays, mcMs);
    json += line;
  }
  json += "]}\n";
  if (!out.empty()) {
    std::ofstream file(out);
    file << json;
    if (!file) {
      std::fprintf(stderr, "cannot write %s\n", out.c_str());
      return 1;
    }
  }
  return 0;
}
