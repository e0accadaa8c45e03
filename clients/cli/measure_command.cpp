// SPDX-License-Identifier: Apache-2.0
// Speed against error: one request swept over values of one field, each point's time, rays and RMSE against two independent
// halves of a path-traced reference that the same server renders.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "measure/metrics.h"
#include "measure/plot.h"
#include "measure/report.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {
namespace {

struct Point {
  std::string value;
  double ms = 0;
  uint64_t rays = 0;
  HalvesError error;
  int reused = 0;
};

struct Sweep {
  std::string path;
  std::vector<std::string> values;
};

// "path=a,b,c"; with ";" between values that hold commas themselves ("lights.key.color=1,0,0;0,1,0").
Result<Sweep> parseSweep(const std::string& text) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size()) return invalidArgument("--sweep " + text + ": must be PATH=VALUE,VALUE,...");
  Sweep sweep{text.substr(0, equals), {}};
  const std::string list = text.substr(equals + 1);
  const char by = list.find(';') != std::string::npos ? ';' : ',';
  size_t begin = 0;
  for (;;) {
    const size_t end = list.find(by, begin);
    const std::string value = list.substr(begin, end == std::string::npos ? end : end - begin);
    if (value.empty()) return invalidArgument("--sweep " + text + ": an empty value");
    sweep.values.push_back(value);
    if (end == std::string::npos) return sweep;
    begin = end + 1;
  }
}

// The same view and lights with every approximation taken out: path traced, no lights in the map's place, no certificate.
v1::RenderRequest referenceOf(v1::RenderRequest request, uint32_t spp, uint64_t seed) {
  request.mutable_shadows()->mutable_path_traced();
  for (auto& [name, light] : *request.mutable_lights()) light.clear_shadow();
  if (request.has_environment()) {
    request.mutable_environment()->clear_extract_lights();
    request.mutable_environment()->clear_area_lights();
    request.mutable_environment()->clear_transfer();
    request.mutable_environment()->clear_subtractive();
  }
  request.clear_certificate();
  request.clear_denoise();
  request.clear_filters();
  request.clear_halt();
  request.mutable_halt()->set_spp(std::max(1u, spp));
  request.set_seed(seed);
  return request;
}

Status dropCaches(Session& session) {
  Session::Call call(session);
  v1::DropCachesRequest request;
  request.set_disk(true);
  v1::DropCachesReply reply;
  return session.statusOf(session.admin().DropCaches(&call.context, request, &reply));
}

Result<Image> beauty(Session& session, const v1::RenderRequest& request, v1::RenderReply* reply) {
  GOBO_ASSIGN(Answer answer, renderOnce(session, request));
  if (reply) *reply = answer.reply;
  return rawImage(answer, 0);
}

Status measure(Session& session, const MeasureCommand& c) {
  GOBO_ASSIGN(const Sweep sweep, parseSweep(c.sweep));
  if (!c.plot.empty()) {
    GOBO_ASSIGN(const v1::Encoding::Format format, formatOf(c.plot));
    if (format != v1::Encoding::PNG) return invalidArgument("--plot " + c.plot + ": must end in .png");
  }
  GOBO_TRY(checkFolder("--csv", c.csv));
  GOBO_TRY(checkFolder("--plot", c.plot));
  GOBO_ASSIGN(v1::RenderRequest base, makeRequest(session, c.request, c.scene));
  base.clear_outputs();
  base.add_outputs("beauty");
  base.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  // Every value is tried on the request before time goes into the reference.
  std::vector<v1::RenderRequest> requests;
  for (const std::string& value : sweep.values) {
    requests.push_back(base);
    GOBO_TRY(setPath(requests.back(), sweep.path + "=" + value));
  }
  const uint32_t half = std::max(1u, c.referenceSpp / 2);
  Image halfA, halfB;
  if (!c.reference.empty()) {  // taken for the truth: its own noise counts as error
    GOBO_ASSIGN(halfA, readPicture(c.reference));
    halfB = halfA;
  } else {
    std::fprintf(stderr, "gobo: reference, 2 x %u spp\n", half);
    GOBO_ASSIGN(halfA, beauty(session, referenceOf(base, half, base.seed() + 0x51ed270b1ull), nullptr));
    GOBO_ASSIGN(halfB, beauty(session, referenceOf(base, half, base.seed() + 0xa3c59ac2full), nullptr));
  }
  const bool cold = c.cold || session.local();
  std::vector<Point> points;
  for (size_t i = 0; i < requests.size(); ++i) {
    Point point;
    point.value = sweep.values[i];
    std::vector<double> times;
    for (uint32_t r = 0; r < std::max(1u, c.repeat); ++r) {
      if (cold) GOBO_TRY(dropCaches(session));
      v1::RenderReply reply;
      GOBO_ASSIGN(const Image picture, beauty(session, requests[i], &reply));
      times.push_back(reply.total_ms() - reply.queue_ms());
      if (r) continue;
      point.rays = reply.rays();
      for (const v1::NodeReport& n : reply.plan()) point.reused += n.state() == v1::NodeReport::REUSED;
      GOBO_ASSIGN(point.error, errorAgainstHalves(picture, halfA, halfB));
    }
    std::sort(times.begin(), times.end());
    point.ms = times[times.size() / 2];
    points.push_back(point);
    std::fprintf(stderr, "gobo: %s=%s: %.1f ms, RMSE %.4g\n", sweep.path.c_str(), point.value.c_str(), point.ms, point.error.rmse);
  }
  std::vector<std::vector<std::string>> rows;
  Table table("measure", {"value", "ms", "rays", "rmse", "rmse_se", "mse", "mse_se", "rel_mse", "rel_mse_se", "reused_nodes"});
  PlotSeries series{sweep.path, {}};
  bool noisy = false, reused = false;
  for (const Point& p : points) {
    const HalvesError& e = p.error;
    rows.push_back({p.value, strf("%.1f", p.ms), std::to_string(p.rays), strf("%.4g", e.rmse), strf("%.2g", e.rmseStandardError), strf("%.4g", e.relMse),
                    strf("%.2g", e.relMseStandardError)});
    table.add({p.value, p.ms, double(p.rays), e.rmse, e.rmseStandardError, e.mse, e.standardError, e.relMse, e.relMseStandardError, double(p.reused)});
    series.points.push_back({p.ms, e.rmse, e.rmse - e.rmseStandardError, e.rmse + e.rmseStandardError});
    noisy |= e.standardError > 0.1 * std::abs(e.mse);
    reused |= p.reused > 0;
  }
  printTable({sweep.path, "ms", "rays", "RMSE", "+-", "relMSE", "+-"}, rows, {false, true, true, true, true, true, true});
  if (noisy) std::printf("warning: the standard error of some squared errors is above 10 %% of them: raise --reference-spp\n");
  if (reused) std::printf("warning: some points reused terms of the server's store, their times are not cold: --cold drops the caches before each\n");
  if (!c.csv.empty()) {
    const std::string csv = table.csv();
    GOBO_TRY(writeFileAtomic(c.csv, csv.data(), csv.size()));
  }
  if (!c.plot.empty()) {
    Plot plot;
    plot.title = base.scene() + ": " + sweep.path;
    plot.xLabel = "ms";
    plot.yLabel = "RMSE";
    plot.series.push_back(std::move(series));
    GOBO_TRY(writePlot(plot, c.plot));
  }
  return {};
}

}  // namespace

int runMeasure(const SessionOptions& options, const MeasureCommand& command) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = measure(**session, command);
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
