// SPDX-License-Identifier: Apache-2.0
// The successors of axis-aligned filtering (sheared, multiple axis-aligned) beside it and plain rays: error and time at the same rays, on every scene of
// sceneEntries.
#include <cmath>
#include <cstdio>

#include "filters/multiple_axis_aligned/technique.h"
#include "filters/sheared/technique.h"
#include "measure/report.h"
#include "shadow/options.h"
#include "shadow/techniques.h"
#include "shadow/truth.h"

namespace gobo::shadowbench {
namespace {

struct Rival {
  std::string name;
  Runner::Plan plan;  ///< empty: `technique`
  v1::ShadowTechnique technique;
};

Rival shearedRival(const std::string& name, int samples, float always, ShearedFilterSettings::Passes passes) {
  ShearedShadowSettings s;
  s.samples = uint32_t(samples);
  s.always = always;
  s.passes = passes;
  return {name, [s](Graph& g, const ShadowInput& input) { return planShearedShadow(g, input, s); }, {}};
}
Rival multipleRival(const std::string& name, int samples, std::vector<float> rims, std::vector<float> scales) {
  MultipleAxisAlignedSettings s;
  s.samples = uint32_t(samples);
  if (!rims.empty()) {
    s.bands.rims = std::move(rims);
    s.scales = std::move(scales);
  }
  return {name, [s](Graph& g, const ShadowInput& input) { return planMultipleAxisAligned(g, input, s); }, {}};
}

std::vector<Rival> rivals(int samples, bool quick) {
  using Passes = ShearedFilterSettings::Passes;
  std::vector<Rival> list{{"rays", {}, rayTraced(samples)}, {"axis-aligned", {}, axisAligned(samples)}};
  list.push_back(shearedRival("sheared", samples, 0.0f, Passes::Where));
  list.push_back(multipleRival("multiple", samples, {}, {}));
  if (!quick) return list;
  list.push_back(shearedRival("sheared whole", samples, 0.0f, Passes::Never));
  list.push_back(shearedRival("sheared always 3", samples, 3.0f, Passes::Where));
  list.push_back(multipleRival("multiple rim 0.5 x 1.5", samples, {0.5f, 0.0f}, {1.5f, 1.0f}));
  list.push_back(multipleRival("multiple 3", samples, {1.0f, 0.5f, 0.0f}, {1.5f, 1.2f, 1.0f}));
  return list;
}

}  // namespace

int sheared(Options o) {
  if (!o.width) o.width = o.height = 256;
  if (!o.truth) o.truth = 2048;
  Table table("successors of axis-aligned filtering",
              {"scene", "asked", "technique", "rays/px", "ms", "rmse", "penumbra", "error of axis-aligned", "its time"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("truth, rays a pixel", std::to_string(o.truth));
  table.note("last two", "how many times a row's own");
  for (const SceneEntry& entry : sceneEntries()) {
    if (!o.only.empty() && entry.scene.find(o.only) == std::string::npos) continue;
    o.scene = entry.scene;
    o.light = entry.soft;
    o.camera = entry.camera;
    auto runner = makeRunner(o, true);
    if (!runner.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), runner.status().toString().c_str());
      return 1;
    }
    const auto truth = makeTruth(**runner, baseName(o) + "-soft", o.truth, o.out + "/truth");
    if (!truth.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), truth.status().toString().c_str());
      return 1;
    }
    for (int samples : {4, 9, 16, 64}) {
      double straightError = 0, straightMs = 0;
      for (const Rival& rival : rivals(samples, o.quick)) {
        double rays = 0, squares = 0, inside = 0;
        std::vector<double> times;
        const std::vector<uint64_t> seeds = o.quick ? std::vector<uint64_t>{1, 2} : std::vector<uint64_t>{11, 12, 13};
        for (uint64_t seed : seeds) {
          const auto m = rival.plan ? (*runner)->measure(rival.plan, seed) : (*runner)->measure(rival.technique, seed);
          if (!m.ok()) {
            std::fprintf(stderr, "%s, %s: %s\n", entry.scene.c_str(), rival.name.c_str(), m.status().toString().c_str());
            return 1;
          }
          const Errors e = errorsOf(*truth, m->V);
          rays += m->rays / double(seeds.size());
          squares += e.rmse * e.rmse / double(seeds.size());
          inside += e.penumbra * e.penumbra / double(seeds.size());
          times.push_back(m->ms.total());
        }
        const double rmse = std::sqrt(squares), ms = median(times);
        if (rival.name == "axis-aligned") {
          straightError = rmse;
          straightMs = ms;
        }
        table.add({entry.scene, double(samples), rival.name, rays, ms, rmse, std::sqrt(inside), straightError / rmse, straightMs / ms});
      }
    }
  }
  std::fputs(table.text().c_str(), stdout);
  return 0;
}

}  // namespace gobo::shadowbench
