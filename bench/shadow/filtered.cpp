// SPDX-License-Identifier: Apache-2.0
// Filtered soft shadows against unfiltered ones and a joint bilateral filter, over rays and over time, on every scene of sceneEntries.
#include <cmath>
#include <cstdio>

#include "measure/report.h"
#include "shadow/bilateral_kernels.h"
#include "shadow/options.h"
#include "shadow/techniques.h"
#include "shadow/truth.h"

namespace gobo::shadowbench {
namespace {

struct CurvePoint {
  std::string curve;
  double rays = 0, ms = 0, rmse = 0, penumbra = 0;
};

/// What a curve needs to reach an error, log-log between its points, going on beyond its last two; 0 before its first.
double atEqualError(const std::vector<CurvePoint>& points, const std::string& curve, double rmse, double CurvePoint::*axis) {
  std::vector<const CurvePoint*> own;
  for (const CurvePoint& p : points)
    if (p.curve == curve) own.push_back(&p);
  if (own.size() < 2 || rmse > own.front()->rmse) return 0;
  size_t i = 1;
  while (i + 1 < own.size() && own[i]->rmse > rmse) ++i;
  const CurvePoint &a = *own[i - 1], &b = *own[i];
  const double f = std::log(a.rmse / rmse) / std::log(a.rmse / b.rmse);
  return std::exp(std::log(a.*axis) * (1 - f) + std::log(b.*axis) * f);
}

/// The same rays, left as they are.
v1::ShadowTechnique sameRays(int samples) {
  v1::ShadowTechnique t = axisAligned(samples);
  t.mutable_axis_aligned()->set_radius_px(0);
  return t;
}
Result<std::vector<CurvePoint>> measureScene(const Options& o, Runner& r, const Truth& truth) {
  std::vector<CurvePoint> points;
  const auto add = [&](const std::string& curve, const v1::ShadowTechnique& t, int bilateral) -> Status {
    std::vector<CurvePoint> seeds;
    for (uint64_t seed : {11, 12, 13}) {
      GOBO_ASSIGN(Measured m, r.measure(t, seed));
      CurvePoint p{curve, m.rays, m.ms.total()};
      if (bilateral) {
        const TermPtr g = r.gbuffer(r.camera());
        std::vector<double> times;
        std::vector<float> V;
        for (int k = 0; k < r.repeat(); ++k) {
          const double begin = r.now();
          V = jointBilateral(r.arena(), *g, m.V, bilateral);
          times.push_back(r.now() - begin);
        }
        m.V = V;
        p.ms += median(times);
      }
      const Errors e = errorsOf(truth, m.V);
      p.rmse = e.rmse;
      p.penumbra = e.penumbra;
      seeds.push_back(p);
    }
    CurvePoint mean{curve};
    std::vector<double> times;
    for (const CurvePoint& p : seeds) {
      mean.rays += p.rays / double(seeds.size());
      mean.rmse += p.rmse * p.rmse / double(seeds.size());
      mean.penumbra += p.penumbra * p.penumbra / double(seeds.size());
      times.push_back(p.ms);
    }
    mean.rmse = std::sqrt(mean.rmse);
    mean.penumbra = std::sqrt(mean.penumbra);
    mean.ms = median(times);
    points.push_back(mean);
    return {};
  };
  for (int n : {4, 9, 16, 25, 36, 64, 128, 256}) GOBO_TRY(add("rays", rayTraced(n), 0));
  for (int n : {4, 8, 16, 32, 64}) GOBO_TRY(add("filtered", axisAligned(n), 0));
  GOBO_TRY(add("not filtered", sameRays(16), 0));
  if (!o.quick) {
    for (int n : {12, 16, 25, 64}) GOBO_TRY(add("published", publishedAxisAligned(n), 0));
    for (int radius : {2, 4, -1})
      for (int n : {4, 9, 16})
        GOBO_TRY(add("bilateral " + (radius < 0 ? std::string("a-trous") : std::to_string(2 * radius + 1) + "^2"), rayTraced(n), radius));
  }
  return points;
}

}  // namespace

int filtered(Options o) {
  if (!o.width) o.width = o.height = 256;
  if (!o.truth) o.truth = 2048;
  Table table("filtered shadows", {"scene", "curve", "rays/px", "ms", "rmse", "penumbra", "rays unfiltered", "x rays", "ms unfiltered", "x time"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("truth, rays a pixel", std::to_string(o.truth));
  table.note("unfiltered", "what plain rays need at equal RMSE");
  for (const SceneEntry& entry : sceneEntries()) {
    if (!o.only.empty() && entry.scene.find(o.only) == std::string::npos) continue;
    o.scene = entry.scene;
    if (o.sun > 0 && entry.hard != "sun") continue;
    o.light = o.sun > 0 ? entry.hard : entry.soft;
    o.camera = entry.camera;
    auto runner = makeRunner(o, true);
    if (!runner.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), runner.status().toString().c_str());
      return 1;
    }
    (*runner)->setRepeat(o.repeat);
    const auto truth = makeTruth(**runner, baseName(o) + "-soft", o.truth, o.out + "/truth");
    if (!truth.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), truth.status().toString().c_str());
      return 1;
    }
    const auto points = measureScene(o, **runner, *truth);
    if (!points.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), points.status().toString().c_str());
      return 1;
    }
    for (const CurvePoint& p : *points) {
      const double rays = atEqualError(*points, "rays", p.rmse, &CurvePoint::rays), ms = atEqualError(*points, "rays", p.rmse, &CurvePoint::ms);
      table.add({entry.scene, p.curve, p.rays, p.ms, p.rmse, p.penumbra, rays, rays / p.rays, ms, ms / p.ms});
    }
  }
  std::fputs(table.text().c_str(), stdout);
  return 0;
}

}  // namespace gobo::shadowbench
