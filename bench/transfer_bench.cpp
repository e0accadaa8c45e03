// SPDX-License-Identifier: Apache-2.0
// New and turned environment maps by precomputed transfer against path tracing them: global illumination of a scene under maps alone (its own lights off).
// Time against relMSE of all methods in one run. Of each method: the reply to a new map and the median reply to seven turns of it, in milliseconds by the
// engine's clock, when everything that does not depend on the map is there already (transfer, G-buffer, surface; for path tracing the acceleration structure);
// relMSE = mean over pixels and channels of (x - a)(x - b) / (((a + b) / 2)^2 + 0.01), a and b two halves of a path-traced reference: free of its noise.
// "traced to that error" is what path tracing takes to the same relMSE, which falls as 1 / samples. Then what a precompute takes, and the steps of a new map.
// Arguments: --scene NAME --env FILE,FILE,... --size WxH --spp N,N,... --reference N (each half) --points N --threads N --view-samples N
//            --set assignments, separated by spaces --out PATH
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "import/load.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

using namespace gobo;

namespace {

constexpr int kTurns = 7;
const char* const kDefault = "transfer (default)";

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "transfer_bench: %s\n", status.toString().c_str());
  std::exit(1);
}
void edit(v1::RenderRequest& r, const std::string& text) {
  if (const Status s = setPath(r, text); !s.ok()) fail(s);
}
double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

double relMse(const Image& x, const Image& a, const Image& b) {
  double sum = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double p = double(a.data[i]), q = double(b.data[i]), mean = 0.5 * (p + q), own = double(x.data[i]);
    sum += (own - p) * (own - q) / (mean * mean + 1e-2);
  }
  return sum / double(a.data.size());
}
double meanRatio(const Image& x, const Image& a, const Image& b) {
  double own = 0, truth = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    own += double(x.data[i]);
    truth += 0.5 * (double(a.data[i]) + double(b.data[i]));
  }
  return own / truth;
}

struct Bench {
  v1::RenderRequest request;
  std::shared_ptr<Engine> engine;

  RenderResult render(const v1::RenderRequest& r) const {
    auto result = engine->render(r);
    if (!result.ok()) fail(result.status());
    return std::move(*result);
  }
  v1::RenderRequest under(const std::string& map, double turn) const {
    v1::RenderRequest r = request;
    edit(r, "environment.path=" + map);
    edit(r, "environment.rotation_deg=" + std::to_string(turn));
    return r;
  }
};

}  // namespace

int main(int argc, char** argv) {
  const std::string scene = argumentOr(argc, argv, "--scene", "atrium");
  const std::vector<std::string> maps = partsOf(argumentOr(argc, argv, "--env", ""), ',');
  if (maps.empty()) fail(invalidArgument("--env names the maps: FILE,FILE,..."));
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "320x240").c_str(), "%dx%d", &width, &height);
  const int reference = std::atoi(argumentOr(argc, argv, "--reference", "128").c_str());
  if (width < 1 || height < 1 || reference < 1) fail(invalidArgument("--size and --reference must be positive"));
  const std::string threads = argumentOr(argc, argv, "--threads", "2"), points = argumentOr(argc, argv, "--points", "30000");

  Bench bench;
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = std::atoi(threads.c_str());
  options.anyPath = true;
  auto engine = Engine::create(options);
  if (!engine.ok()) fail(engine.status());
  bench.engine = std::move(*engine);
  if (auto opened = bench.engine->openScene(scene, scene); !opened.ok()) fail(opened.status());
  for (const std::string& e : {"scene=" + scene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=beauty"),
                               std::string("seed=7"), "view_samples=" + argumentOr(argc, argv, "--view-samples", "2")})
    edit(bench.request, e);
  const auto info = bench.engine->inspectScene(scene);
  if (!info.ok()) fail(info.status());
  for (const auto& light : info->lights())
    if (light.name() != "environment") edit(bench.request, "lights." + light.name() + ".enabled=false");
  for (const std::string& e : partsOf(argumentOr(argc, argv, "--set", ""), ' ')) edit(bench.request, e);

  struct Method {
    std::string name;
    std::vector<std::string> edits;
    double traced;  // samples a pixel; 0: not path tracing
  };
  std::vector<Method> methods;
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--spp", "1,4,16,64"), ','))
    methods.push_back({"path traced, " + n + " spp", {"halt.spp=" + n}, std::atof(n.c_str())});
  const std::string p = "environment.transfer.points=" + points;
  // The default first: what the others share with it they would find done.
  methods.push_back({kDefault, {p, "halt.spp=1"}, 0});
  methods.push_back({"transfer, harmonics alone", {p, "environment.transfer.lights=0", "halt.spp=1"}, 0});
  methods.push_back({"transfer, 1 ray a light", {p, "shadows.ray_traced.samples=1", "halt.spp=1"}, 0});
  methods.push_back({"transfer, 16 rays a light", {p, "shadows.ray_traced.samples=16", "halt.spp=1"}, 0});

  Table table("New maps by transfer", {"map", "method", "new map, ms", "turned, ms", "relMSE", "mean / truth", "traced to that error, ms", "times faster"});
  Table precompute("Precompute", {"node", "ms", "million rays / s", "MB"});
  Table steps("Steps of a new map (default)", {"map", "node", "ms"});
  // What does not depend on a map, under one that is none of them.
  for (const Method& m : methods) {
    if (m.traced > 1) continue;
    v1::RenderRequest r = bench.request;
    edit(r, "environment.sky.turbidity=3");
    for (const std::string& e : m.edits) edit(r, e);
    const RenderResult first = bench.render(r);
    if (m.name != kDefault) continue;
    struct Sum {
      double ms = 0, rays = 0, bytes = 0;
    };
    std::map<std::string, Sum> sums;
    for (const auto& n : first.reply.plan())
      if (n.node().rfind("transfer", 0) == 0 && n.state() == v1::NodeReport::RUN) {
        Sum& s = sums[n.node()];
        s.ms += n.ms();
        s.rays += double(n.rays());
        s.bytes = double(n.bytes());
      }
    for (const auto& [name, s] : sums) precompute.add({name, s.ms, 1e-3 * s.rays / s.ms, 1e-6 * s.bytes});
  }
  for (const std::string& map : maps) {
    const std::string name = map.substr(map.find_last_of('/') + 1);
    Image halves[2];
    for (int k = 0; k < 2; ++k) {
      v1::RenderRequest r = bench.under(map, 0);
      edit(r, "seed=" + std::to_string(1001 + k));
      edit(r, "halt.spp=" + std::to_string(reference));
      halves[k] = bench.render(r).images[0].image();
    }
    double msTimesError = 0;
    for (size_t own = 0; own < methods.size(); ++own) {  // seeds and turns of its own: nothing is found done
      const Method& m = methods[own];
      v1::RenderRequest r = bench.under(map, 0);
      if (m.traced > 0) edit(r, "seed=" + std::to_string(7 + own));
      for (const std::string& e : m.edits) edit(r, e);
      const RenderResult fresh = bench.render(r);
      std::vector<double> turns;
      for (int k = 1; k <= (m.traced > 1 ? 0 : kTurns); ++k) {
        edit(r, "environment.rotation_deg=" + std::to_string(51.4 * k + double(own)));
        turns.push_back(bench.render(r).reply.total_ms());
      }
      const double ms = fresh.reply.total_ms(), turned = turns.empty() ? ms : median(turns);
      const double error = relMse(fresh.images[0].image(), halves[0], halves[1]);
      if (m.traced > 0) msTimesError = ms * error;  // of the largest count, where what is done once weighs least
      const double traced = m.traced > 0 ? ms : msTimesError / std::max(error, 1e-9);
      table.add({name, m.name, m.traced > 0 || m.name == kDefault ? ms : std::nan(""), turned, error, meanRatio(fresh.images[0].image(), halves[0], halves[1]),
                 traced, traced / turned});
      if (m.name == kDefault)
        for (const auto& n : fresh.reply.plan())
          if (n.state() == v1::NodeReport::RUN && n.ms() > 0.05) steps.add({name, n.node(), n.ms()});
    }
  }
  table.note("scene", scene);
  table.note("pixels", double(width) * height);
  table.note("view samples", double(bench.request.view_samples()));
  table.note("points at most", points);
  table.note("threads", threads);
  table.note("reference samples a pixel, each of two halves", double(reference));
  std::printf("%s\n%s\n%s", table.text().c_str(), precompute.text().c_str(), steps.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
