// SPDX-License-Identifier: Apache-2.0
// Denoisers against plain samples, on the same samples: error against time and against samples, all filters in one run, scene by scene.
// RMSE^2 = mean over pixels and channels of (x - a)(x - b), relMSE the same over (((a + b) / 2)^2 + 0.01), a and b two halves of a path-traced reference of
// other seeds: free of its noise. ms: the whole picture, by the engine's clock, with the acceleration structure there and an empty store; filter ms: what
// is not path tracing. "worth": the samples that plain path tracing takes to the same relMSE, which falls as 1 / samples from its best one here; "faster": the
// time that this takes, over the filter's. "regret": of auto, the root of its relMSE over that of the best single filter. (RMSE is mostly of the pixels along
// the edges of lamps, whose light the camera sees itself: no filter touches it.) Arguments: --scene NAME,NAME,... (built-in; specular_room, hidden_lamp:
// rooms/rooms.h; or files)
// --size WxH --spp N,N,... --reference N (each half) --filters NAME,NAME,... (path_density+wavelet: one behind the other) --threads N
//            --set assignments, separated by spaces; --plot FOLDER: SCENE.png there, RMSE and relMSE against milliseconds and against samples
// --temporal N: over time. A lamp (cornell, lights8) or the sun (atrium) moves in N steps, the camera rests, every frame has a seed of its own; of the light
// that filters see (beauty without emission) the means of RMSE^2 and relMSE over frames; and flicker: per pixel and channel the variance over time of how
// the error changes from frame to frame, halved (the variance of a frame's error where frames err independently), its mean over pixels as a root, and
// relative to (the reference's mean^2 + 0.01). The reference has the same seeds in every frame. Arguments: --scene --size 128x96 --spp 4 --reference 64 (each
// half) --threads --set as above; --filters also with "temporal", "temporal.clamp" (denoise/over_time.h); --travel F: share of the light's way, 0: it rests;
// --least-share F: of a new frame in accumulation
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "base/image_io.h"
#include "denoise/choose.h"
#include "denoise/over_time.h"
#include "import/load.h"
#include "measure/plot.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"
#include "rooms/rooms.h"

using namespace gobo;

namespace {

[[noreturn]] void stop(const Status& status) {
  std::fprintf(stderr, "denoise_bench: %s\n", status.toString().c_str());
  std::exit(1);
}
void edit(v1::RenderRequest& r, const std::string& text) {
  if (const Status s = setPath(r, text); !s.ok()) stop(s);
}

struct Errors {
  double rmse = 0, relMse = 0;
};
Errors errorsOf(const Image& x, const Image& a, const Image& b) {
  double sum = 0, relative = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double p = a.data[i], q = b.data[i], mean = 0.5 * (p + q), own = x.data[i], square = (own - p) * (own - q);
    sum += square;
    relative += square / (mean * mean + 1e-2);
  }
  return {std::sqrt(std::max(sum, 0.0) / double(a.data.size())), std::max(relative, 0.0) / double(a.data.size())};
}

struct Row {
  std::string filter;
  uint32_t spp = 0;
  Errors errors;
  double ms = 0, filterMs = 0;
};

void choose(v1::RenderRequest& r, const std::string& filter) {
  if (const Status s = bench::chooseFilter(r, filter); !s.ok()) stop(s);
}

Row rowOf(Engine& engine, const RenderControl& control, v1::RenderRequest r, const std::string& filter, uint32_t spp, const Image& a, const Image& b) {
  r.mutable_halt()->set_spp(spp);
  choose(r, filter);
  engine.dropCaches(false, true);
  auto result = engine.render(r, control);
  if (!result.ok()) stop(result.status());
  Row row{filter, spp, errorsOf(result->images[0].image(), a, b), 0, 0};
  for (const v1::NodeReport& n : result->reply.plan()) {
    if (n.state() != v1::NodeReport::RUN) continue;
    row.ms += n.ms();
    if (n.samples() == 0) row.filterMs += n.ms();
  }
  return row;
}

/// RMSE above, relMSE below; against milliseconds on the left, against samples on the right.
void plot(const std::string& scene, const std::vector<Row>& rows, const std::string& path) {
  constexpr int kWidth = 640, kHeight = 440;
  Image all(2 * kWidth, 2 * kHeight, 3);
  for (int panel = 0; panel < 4; ++panel) {
    const bool relative = panel > 1, samples = panel % 2 == 1;
    Plot p;
    p.title = scene;
    p.xLabel = samples ? "samples a pixel" : "ms";
    p.yLabel = relative ? "relMSE" : "RMSE";
    p.width = kWidth;
    p.height = kHeight;
    for (const Row& row : rows) {
      auto s = std::find_if(p.series.begin(), p.series.end(), [&](const PlotSeries& one) { return one.name == row.filter; });
      if (s == p.series.end()) s = p.series.insert(s, {row.filter, {}});
      s->points.push_back({samples ? double(row.spp) : row.ms, relative ? row.errors.relMse : row.errors.rmse});
    }
    const Image drawn = drawPlot(p);
    for (int y = 0; y < kHeight; ++y)
      std::copy_n(&drawn.data[size_t(3 * y * kWidth)], 3 * kWidth, &all.data[size_t(3 * ((y + relative * kHeight) * 2 * kWidth + samples * kWidth))]);
  }
  const auto png = encodePng(all);
  if (!png.ok()) stop(png.status());
  if (const Status s = writeFileAtomic(path, png->data(), png->size()); !s.ok()) stop(s);
}

int overTime(int argc, char** argv, Engine& engine) {
  bench::OverTime how;
  how.frames = uint32_t(std::stoul(argumentOr(argc, argv, "--temporal", "64")));
  how.samples = uint32_t(std::stoul(argumentOr(argc, argv, "--spp", "4")));
  how.reference = uint32_t(std::stoul(argumentOr(argc, argv, "--reference", "64")));
  how.travel = std::stod(argumentOr(argc, argv, "--travel", "1"));
  how.leastShare = std::stod(argumentOr(argc, argv, "--least-share", "0.1"));
  const std::vector<std::string> filters =
      partsOf(argumentOr(argc, argv, "--filters",
                         "none,wavelet,non_local_means,axis_aligned,auto.fast=true,temporal,temporal.clamp,temporal+wavelet,temporal.clamp+wavelet,"
                         "axis_aligned+temporal,axis_aligned+temporal.clamp"),
              ',');
  uint32_t width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "128x96").c_str(), "%ux%u", &width, &height);
  std::printf("%-10s %-27s %9s %9s %9s %9s\n", "scene", "filter", "RMSE", "relMSE", "flicker", "relative");
  for (const std::string& scene : partsOf(argumentOr(argc, argv, "--scene", "cornell,lights8,atrium"), ',')) {
    v1::RenderRequest r;
    r.set_scene(scene);
    r.set_width(width);
    r.set_height(height);
    for (const std::string& a : partsOf(argumentOr(argc, argv, "--set", ""), ' ')) edit(r, a);
    if (const auto opened = engine.openScene(scene, scene); !opened.ok()) stop(opened.status());
    if (const Status s = bench::measureOverTime(engine, {}, r, filters, how); !s.ok()) stop(s);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> scenes = partsOf(argumentOr(argc, argv, "--scene", "cornell,spheres,atrium,lights8"), ',');
  const std::vector<std::string> filters =
      partsOf(argumentOr(argc, argv, "--filters", "joint_bilateral,wavelet,non_local_means,first_order,axis_aligned,auto"), ',');
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "320x240").c_str(), "%dx%d", &width, &height);
  std::vector<uint32_t> counts;
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--spp", "1,4,16,64"), ',')) counts.push_back(uint32_t(std::stoul(n)));
  const uint32_t reference = uint32_t(std::stoul(argumentOr(argc, argv, "--reference", "1024")));
  const std::string plots = argumentOr(argc, argv, "--plot", "");
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = std::atoi(argumentOr(argc, argv, "--threads", "0").c_str());
  options.storeBytes = 4ull << 30;
  options.anyPath = true;
  auto created = Engine::create(options);
  if (!created.ok()) stop(created.status());
  Engine& engine = **created;
  if (!argumentOr(argc, argv, "--temporal", "").empty()) return overTime(argc, argv, engine);
  std::printf("%-13s %4s %-26s %9s %9s %9s %9s %8s %8s\n", "scene", "spp", "filter", "RMSE", "relMSE", "ms", "filter ms", "worth", "faster");
  for (const std::string& scene : scenes) {
    v1::RenderRequest r;
    r.set_scene(scene);
    r.set_width(uint32_t(width));
    r.set_height(uint32_t(height));
    for (const std::string& a : partsOf(argumentOr(argc, argv, "--set", ""), ' ')) edit(r, a);
    const auto room = bench::roomOf(scene);
    if (!room.ok()) stop(room.status());
    RenderControl control;
    control.scene = *room;
    if (!*room) {
      if (const auto opened = engine.openScene(scene, scene); !opened.ok()) stop(opened.status());
    }
    Image halves[2];
    for (uint32_t k = 0; k < 2; ++k) {
      v1::RenderRequest half = r;
      half.set_seed(1000 + k);
      half.mutable_halt()->set_spp(reference);
      auto result = engine.render(half, control);
      if (!result.ok()) stop(result.status());
      halves[k] = result->images[0].image();
    }
    std::vector<Row> plain;
    for (const uint32_t spp : counts) plain.push_back(rowOf(engine, control, r, "none", spp, halves[0], halves[1]));
    const Row& most = plain.back();
    const double variance = most.errors.relMse * most.spp, msPerSample = most.ms / most.spp;
    std::vector<Row> drawn;
    for (const Row& p : plain) {
      std::vector<Row> rows{p};
      for (const std::string& f : filters) rows.push_back(rowOf(engine, control, r, f, p.spp, halves[0], halves[1]));
      double best = std::numeric_limits<double>::infinity();
      for (const Row& row : rows) {
        if (row.filter != "auto") best = std::min(best, row.errors.relMse);
        const double worth = variance / std::max(row.errors.relMse, 1e-30);
        std::printf("%-13.13s %4u %-26s %9.5f %9.5f %9.1f %9.1f %8.0f %8.1f", scene.substr(scene.find_last_of('/') + 1).c_str(), row.spp, row.filter.c_str(),
                    row.errors.rmse, row.errors.relMse, row.ms, row.filterMs, worth, worth * msPerSample / row.ms);
        if (row.filter == "auto") std::printf("  regret %.2f", std::sqrt(row.errors.relMse / best));
        std::printf("\n");
        std::fflush(stdout);
      }
      drawn.insert(drawn.end(), rows.begin(), rows.end());
    }
    const std::string name = scene.substr(scene.find_last_of('/') + 1);
    if (!plots.empty()) plot(name, drawn, plots + "/" + name + ".png");
  }
  return 0;
}
