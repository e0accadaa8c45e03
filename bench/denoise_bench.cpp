// SPDX-License-Identifier: Apache-2.0
// Denoisers against plain samples, on the same samples: error against time and against samples, all filters in one run, scene by scene.
// RMSE^2 = mean over pixels and channels of (x - a)(x - b), relMSE the same over (((a + b) / 2)^2 + 0.01), a and b two halves of a path-traced reference of
// other seeds: free of its noise. ms: the whole picture, by the engine's clock, with the acceleration structure there and an empty store; filter ms: what
// is not path tracing. "worth": the samples that plain path tracing takes to the same relMSE, which falls as 1 / samples from its best one here; "faster": the
// time that this takes, over the filter's. "regret": of auto, the root of its relMSE over that of the best single filter. (RMSE is mostly of the pixels along
// the edges of lamps, whose light the camera sees itself: no filter touches it.) Arguments: --scene NAME,NAME,... (built-in; specular_room, hidden_lamp:
// rooms/rooms.h; or files)
// --size WxH --spp N,N,... --reference N (each half) --filters NAME,NAME,... (path_density+wavelet: one behind the other) --threads N
//            --set assignments, separated by spaces
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "import/load.h"
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

/// "wavelet", "wavelet.levels=3", "path_density", "path_density.neighbours=20+wavelet": a rejection of outliers, a filter, or one before the other.
void choose(v1::RenderRequest& r, const std::string& filter) {
  for (const std::string& part : partsOf(filter, '+')) {
    const std::string name = part.substr(0, part.find('.'));
    const bool outliers = v1::OutlierRejection::descriptor()->FindFieldByName(name) != nullptr;
    edit(r, std::string(outliers ? "denoise.outliers" : "denoise") + (part.find('=') == std::string::npos ? "=" + part : "." + part));
  }
}

Row rowOf(Engine& engine, const RenderControl& control, v1::RenderRequest r, const std::string& filter, uint32_t spp, const Image& a, const Image& b) {
  r.mutable_halt()->set_spp(spp);
  if (filter != "none") choose(r, filter);
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
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = std::atoi(argumentOr(argc, argv, "--threads", "0").c_str());
  options.storeBytes = 4ull << 30;
  options.anyPath = true;
  auto created = Engine::create(options);
  if (!created.ok()) stop(created.status());
  Engine& engine = **created;
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
    }
  }
  return 0;
}
