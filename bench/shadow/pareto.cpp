// SPDX-License-Identifier: Apache-2.0
// Speed against error on one scene: every technique and its main parameter.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "measure/plot.h"
#include "measure/report.h"
#include "shadow/bilateral_kernels.h"
#include "shadow/options.h"
#include "shadow/techniques.h"

namespace gobo::shadowbench {
namespace {

struct Row {
  Setting setting;
  Measured m;
  Errors e;
  double temporal = -1;
  bool front = false;
};

constexpr double kFloor = 1e-4;  // errors are unbiased estimates: below this they are noise, and logarithms need a floor

Result<Row> measureOne(Runner& r, const Truth& truth, const Setting& s, int temporal) {
  Row row{s, {}, {}};
  if (s.family == "rays" && s.viewSamples > 1) {
    GOBO_ASSIGN(row.m, r.supersampled(s.viewSamples));
  } else {
    GOBO_ASSIGN(row.m, r.measure(s.technique));
  }
  if (s.bilateral != 0) {
    const TermPtr g = r.gbuffer(r.camera());
    std::vector<double> times;
    std::vector<float> V;
    for (int k = 0; k < r.repeat(); ++k) {
      const double begin = r.now();
      V = jointBilateral(r.arena(), *g, row.m.V, s.bilateral);
      times.push_back(r.now() - begin);
    }
    row.m.V = V;
    row.m.ms.filter += median(times);
  }
  row.e = errorsOf(truth, row.m.V);
  if (temporal > 1 && s.viewSamples == 1 && s.bilateral == 0) { GOBO_ASSIGN(row.temporal, temporalVariance(r, truth, s.technique, temporal)); }
  row.m.term.reset();
  return row;
}

void markFront(std::vector<Row>& rows) {
  for (Row& a : rows)
    a.front = std::none_of(rows.begin(), rows.end(), [&](const Row& b) {
      const double ea = std::max(a.e.rmse, kFloor), eb = std::max(b.e.rmse, kFloor), ta = a.m.ms.total(), tb = b.m.ms.total();
      return (tb < ta && eb <= ea) || (tb <= ta && eb < ea);
    });
}

Status plotRows(const std::vector<Row>& rows, const std::string& title, const std::string& path) {
  Plot plot;
  plot.title = title;
  plot.xLabel = "depth + encode + filter + lookup, ms";
  plot.yLabel = "RMSE of visibility";
  plot.width = 1200;
  plot.height = 760;
  for (const Row& row : rows) {
    auto s = std::find_if(plot.series.begin(), plot.series.end(), [&](const PlotSeries& p) { return p.name == row.setting.family; });
    if (s == plot.series.end()) {
      plot.series.push_back({row.setting.family, {}, false, true});
      s = plot.series.end() - 1;
    }
    s->points.push_back({row.m.ms.total(), std::max(row.e.rmse, kFloor)});
  }
  PlotSeries front{"front", {}, true, false};
  std::vector<Row> sorted = rows;
  std::sort(sorted.begin(), sorted.end(), [](const Row& a, const Row& b) { return a.m.ms.total() < b.m.ms.total(); });
  for (const Row& row : sorted)
    if (row.front) front.points.push_back({row.m.ms.total(), std::max(row.e.rmse, kFloor)});
  plot.series.push_back(front);
  return writePlot(plot, path);
}

}  // namespace

int pareto(Options o) {
  if (!o.width) {
    o.width = 512;
    o.height = 384;
  }
  if (!o.truth) o.truth = 1024;
  auto runner = makeRunner(o, o.soft);
  if (!runner.ok()) {
    std::fprintf(stderr, "%s\n", runner.status().toString().c_str());
    return 1;
  }
  Runner& r = **runner;
  r.setRepeat(o.repeat);
  const std::string base = baseName(o) + (o.soft ? "-soft" : "-hard");
  const auto truth = makeTruth(r, base, o.truth, o.out + "/truth");
  if (!truth.ok()) {
    std::fprintf(stderr, "%s\n", truth.status().toString().c_str());
    return 1;
  }

  std::vector<Row> rows;
  std::string skipped;
  for (const Setting& s : o.soft ? softSettings(o.quick) : hardSettings(o.quick)) {
    if (!o.only.empty() && s.label().find(o.only) == std::string::npos) continue;
    if (!r.supported(s.technique)) {
      if (skipped.find(s.family) == std::string::npos) skipped += (skipped.empty() ? "" : ", ") + s.family;
      continue;
    }
    auto row = measureOne(r, *truth, s, o.temporal);
    if (!row.ok()) {
      std::fprintf(stderr, "%s: %s\n", s.label().c_str(), row.status().toString().c_str());
      continue;
    }
    rows.push_back(*row);
  }
  markFront(rows);

  Table table("shadow_pareto " + base, {"family", "parameter", "depth ms", "encode ms", "filter ms", "lookup ms", "view ms", "total ms", "MiB", "rays/px",
                                        "rmse", o.soft ? "rmse pixel" : "rmse centre", "penumbra", "false lit %", "false dark %", "temporal", "front"});
  const auto count = [](const std::vector<uint8_t>& m) { return double(std::count(m.begin(), m.end(), 1)); };
  table.note("scene", o.scene);
  table.note("light", o.light + (o.soft ? " (area)" : " (hard)"));
  table.note("camera", o.camera);
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("error against",
             std::string(truth->soft ? "the pixel's centre, " : "the pixel's area, ") + std::to_string(o.truth) + " rays a pixel in two halves");
  table.note("receivers %", 100 * count(truth->mask) / double(r.pixels()));
  table.note("penumbra %", 100 * count(truth->band) / std::max(1.0, count(truth->mask)));
  table.note("map.fit", o.cameraFit ? "CAMERA" : "SCENE");
  table.note("clock", o.clock == Runner::Clock::Wall ? "wall" : "cpu of all threads");
  if (o.temporal > 1) {
    auto own = temporalVarianceOfTruth(r, *truth, o.temporal, 16);
    if (own.ok()) table.note("temporal variance of the truth", *own);
  }
  if (!skipped.empty()) table.note("not registered or not for this light", skipped);
  for (const Row& x : rows)
    table.add({x.setting.family, x.setting.parameter, x.m.ms.depth, x.m.ms.encode, x.m.ms.filter, x.m.ms.lookup, x.m.ms.view, x.m.ms.total(),
               double(x.m.bytes) / (1 << 20), x.m.rays, x.e.rmse, x.e.other, x.e.penumbra, 100 * x.e.falseLit, 100 * x.e.falseDark,
               x.temporal >= 0 ? x.temporal : NAN, std::string(x.front ? "*" : "")});
  std::fputs(table.text().c_str(), stdout);
  std::sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.m.ms.total() < b.m.ms.total(); });
  std::printf("\nPareto front, fastest first:\n");
  for (const Row& x : rows)
    if (x.front) std::printf("  %8.2f ms  rmse %.4f  %s\n", x.m.ms.total(), x.e.rmse, x.setting.label().c_str());
  std::filesystem::create_directories(o.out);
  const std::string path = o.out + "/shadow_pareto_" + base;
  for (const Status& s : {table.write(path + ".csv"), table.write(path + ".json"), plotRows(rows, baseName(o) + (o.soft ? ", soft" : ", hard"), path + ".png")})
    if (!s.ok()) {
      std::fprintf(stderr, "%s\n", s.toString().c_str());
      return 1;
    }
  std::printf("%s.csv, .json, .png\n", path.c_str());
  return 0;
}

}  // namespace gobo::shadowbench
