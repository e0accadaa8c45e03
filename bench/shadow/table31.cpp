// SPDX-License-Identifier: Apache-2.0
// Table 3.1 and figure 3.6 of B. Wang, UCB/EECS-2013-118, in their own columns: the published method on scenes like the source's, beside the printed
// numbers (GeForce GTX 570), and what the renderer does by default in the place of it.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>

#include "measure/report.h"
#include "shadow/options.h"
#include "shadow/techniques.h"

namespace gobo::shadowbench {
namespace {

struct Printed {
  const char *name, *scene, *camera;
  double vertices, spp, ray, filter, total, filtered, unfiltered;
};
// The source's scenes are not published: grids is that of the parent's study (Mehta et al. 2012) as far as its numbers pin it down, the others are of the kind.
const Printed kPrinted[] = {{"Grids", "grids", "receiver", 200, 14.2, 20.4, 5.01, 25.4, 39, 49},
                            {"Bench", "bench", "front", 309e3, 28.0, 425, 4.78, 430, 2.3, 2.3},
                            {"Tentacles", "tentacles", "front", 145e3, 26.3, 288, 4.79, 293, 3.4, 3.5},
                            {"Spheres", "spheres", "front", 72e3, 33.8, 342, 4.99, 347, 2.9, 2.9}};

double vertices(const Scene& scene) {
  double n = 0;
  for (const Instance& i : scene.instances) n += double(scene.meshes[size_t(i.mesh)]->positions.size());
  return n;
}

Status addRow(Table& table, const Printed& p, Runner& r, const char* method, const v1::ShadowTechnique& t) {
  double primary = 0;
  r.gbuffer(r.camera(), 1, &primary);
  GOBO_ASSIGN(const Measured m, r.measure(t, 11));
  double ray = primary;
  for (const auto& [type, ms] : m.byType)
    if (type == "shadow_slopes" || type == "shadow_adaptive") ray += ms;
  const double total = primary + m.ms.total();
  table.add({std::string(p.name) + ": " + p.scene, std::string(method), vertices(*r.scene()), m.samples, ray, total - ray, total, 1000 / total, 1000 / ray});
  return {};
}

struct FigurePoint {
  std::string curve;
  double spp, rms;
};

Result<std::vector<FigurePoint>> figure(const Options& o, Runner& r, const Truth& truth) {
  std::vector<FigurePoint> points;
  const auto add = [&](const char* curve, const v1::ShadowTechnique& t, double spp) -> Status {
    double squares = 0, samples = 0;
    const int seeds = o.quick ? 1 : 3;
    for (int s = 0; s < seeds; ++s) {
      GOBO_ASSIGN(const Measured m, r.measure(t, uint64_t(11 + s)));
      squares += std::pow(errorsOf(truth, m.V).rmse, 2) / seeds;
      samples += m.samples / seeds;
    }
    points.push_back({curve, spp > 0 ? spp : samples, std::sqrt(squares)});
    return {};
  };
  for (const int n : {10, 12, 16, 27, 40, 64, 100, 165}) GOBO_TRY(add("ours", publishedAxisAligned(n), 0));
  for (const int n : {9, 16, 27, 40, 64, 100, 165}) {
    v1::ShadowTechnique even = publishedAxisAligned(n);
    even.mutable_axis_aligned()->set_adaptive(false);
    GOBO_TRY(add("filter on non-adaptive samples", even, n));
  }
  for (const int n : {4, 9, 16, 27, 40, 64, 100, 165, 256}) GOBO_TRY(add("Monte Carlo", rayTraced(n), n));
  for (const int n : {4, 8, 16, 32, 64, 128}) GOBO_TRY(add("default", axisAligned(n), 0));
  return points;
}

/// Samples at which a curve has this error, log-log between its points; nan beyond them.
double sppAt(const std::vector<FigurePoint>& points, const std::string& curve, double rms) {
  const FigurePoint* last = nullptr;
  for (const FigurePoint& p : points) {
    if (p.curve != curve) continue;
    if (last && last->rms >= rms && p.rms <= rms) {
      const double f = std::log(last->rms / rms) / std::log(last->rms / p.rms);
      return std::exp(std::log(last->spp) * (1 - f) + std::log(p.spp) * f);
    }
    last = &p;
  }
  return std::nan("");
}

}  // namespace

int table31(Options o) {
  if (!o.width) o.width = 640, o.height = 480;
  if (!o.truth) o.truth = 1024;
  Table table("table 3.1", {"scene", "method", "vertices", "avg spp", "ray ms", "filter ms", "total ms", "fps filtered", "fps unfiltered"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("ray ms", "primary rays, pilot and adaptive rays; filter ms: everything else");
  table.note("clock", o.clock == Runner::Clock::Wall ? "wall" : "cpu of all threads");
  Table curves("figure 3.6", {"curve", "spp", "rms"});
  const auto one = [&](const Printed& p) -> Status {
    o.scene = p.scene;
    o.light = "key";
    o.camera = p.camera;
    GOBO_ASSIGN(const auto runner, makeRunner(o, true));
    table.add({std::string(p.name), "printed", p.vertices, p.spp, p.ray, p.filter, p.total, p.filtered, p.unfiltered});
    GOBO_TRY(addRow(table, p, *runner, "published", publishedAxisAligned(0)));
    GOBO_TRY(addRow(table, p, *runner, "default", axisAligned(16)));
    if (std::string(p.name) != "Grids") return {};
    std::printf("%s\n", table.text().c_str());
    std::fflush(stdout);
    GOBO_ASSIGN(const Truth truth, makeTruth(*runner, baseName(o) + "-soft", o.truth, o.out + "/truth"));
    runner->setRepeat(1);  // no times in the figure
    GOBO_ASSIGN(const auto points, figure(o, *runner, truth));
    for (const FigurePoint& f : points) curves.add({f.curve, f.spp, f.rms});
    for (const char* curve : {"ours", "default"})
      for (const FigurePoint& f : points)
        if (f.curve == curve) std::printf("%s: %.1f spp = %.1f Monte Carlo\n", curve, f.spp, sppAt(points, "Monte Carlo", f.rms));
    std::printf("printed: 27 spp = 165 Monte Carlo\n\n");
    return {};
  };
  for (auto p = std::rbegin(kPrinted); p != std::rend(kPrinted); ++p) {  // the figure last
    if (!o.only.empty() && o.only != p->scene) continue;
    const Status s = one(*p);
    if (!s.ok()) {
      std::fprintf(stderr, "%s: %s\n", p->scene, s.toString().c_str());
      return 1;
    }
  }
  std::printf("%s", curves.rows() ? curves.csv().c_str() : table.text().c_str());
  std::filesystem::create_directories(o.out);
  for (const Status& s : {table.write(o.out + "/table31.csv"), curves.rows() ? curves.write(o.out + "/figure36.csv") : Status()})
    if (!s.ok()) {
      std::fprintf(stderr, "%s\n", s.toString().c_str());
      return 1;
    }
  return 0;
}

}  // namespace gobo::shadowbench
