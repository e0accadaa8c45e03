// SPDX-License-Identifier: Apache-2.0
// Speed against error (docs/measuring.md): series of settings of one request, each point's time, rays and RMSE against two independent
// halves of a reference that the same server renders, in interleaved repeats.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "measure/metrics.h"
#include "measurement/record.h"
#include "pictures.h"
#include "plan/engine.h"
#include "regress/references.h"
#include "report.h"
#include "request/request.h"
#include "server/log.h"

namespace gobo::cli {
namespace {

Status dropCaches(Session& session) {
  Session::Call call(session);
  v1::DropCachesRequest request;
  request.set_disk(true);
  v1::DropCachesReply reply;
  return session.statusOf(session.admin().DropCaches(&call.context, request, &reply));
}

Result<v1::PlanReply> planOf(Session& session, const v1::RenderRequest& request) {
  Session::Call call(session);
  v1::PlanReply reply;
  GOBO_TRY(session.statusOf(session.render().Plan(&call.context, request, &reply)));
  return reply;
}

Result<v1::SceneInfo> inspected(Session& session, const std::string& scene) {
  Session::Call call(session);
  v1::InspectSceneRequest request;
  request.set_scene(scene);
  v1::SceneInfo info;
  GOBO_TRY(session.statusOf(session.scenes().Inspect(&call.context, request, &info)));
  return info;
}

/// The machine is known where the server is in this process or behind a Unix socket; what a server does not tell this caller stays unknown.
void describeServer(Session& session, Measurement& m) {
  if (session.local() || session.address().starts_with("unix:")) m.machine = thisMachine();
  Session::Call call(session);
  v1::StatusReply status;
  if (session.statusOf(session.admin().GetStatus(&call.context, {}, &status)).ok()) m.threads = status.threads();
}

/// What all of a measurement is held against.
struct Halves {
  Image a, b;
};

class Measuring {
 public:
  Measuring(Session& session, const MeasureCommand& command) : session_(session), c_(command), cold_(command.cold || session.local()) {}

  Status run() {
    GOBO_TRY(checkFiles());
    GOBO_ASSIGN(m_.reference.by, truthOf(c_.output));
    GOBO_TRY(makeSeries());
    GOBO_ASSIGN(base_, makeRequest(session_, c_.request, c_.scene));
    base_.clear_outputs();
    base_.add_outputs(c_.output);
    base_.clear_certificate();
    base_.mutable_encoding()->Clear();
    base_.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
    GOBO_TRY(makeRequests());
    GOBO_ASSIGN(m_.scene, inspected(session_, base_.scene()));
    GOBO_TRY(makeReference());
    GOBO_TRY(measureAll());
    m_.date = timeNow(), m_.command = c_.command, m_.clientBuild = buildVersion(), m_.output = c_.output, m_.cold = cold_, m_.repeats = c_.repeats;
    describeServer(session_, m_);
    return deliver();
  }

 private:
  Status checkFiles() const {
    GOBO_TRY(checkFolder("--csv", c_.csv));
    GOBO_TRY(checkFolder("--out", c_.out));
    if (!c_.out.empty() && !c_.out.ends_with(".json")) return invalidArgument("--out " + c_.out + ": must end in .json");
    return {};
  }

  Status makeSeries() {
    GOBO_ASSIGN(m_.series, parseSeries(c_.series));
    if (c_.pathTracing) {
      const bool rays = m_.reference.by == TruthBy::Rays;
      if (rays && c_.pathTracing > 4096) return invalidArgument("--path-tracing " + std::to_string(c_.pathTracing) + ": at most 4096 rays a view sample");
      GOBO_TRY(addSeries(m_.series, plainSeries(rays ? MeasuredSeries::Kind::ShadowRays : MeasuredSeries::Kind::PathTracing, c_.pathTracing)));
    }
    return m_.series.empty() ? invalidArgument("nothing to measure: name points by --sweep PATH=VALUE,VALUE,... or --path-tracing N") : Status();
  }

  /// Every point is planned before time goes into the reference: what the server refuses it refuses now.
  Status makeRequests() {
    for (const MeasuredSeries& series : m_.series) {
      requests_.emplace_back();
      m_.points.emplace_back(series.values.size());
      for (const std::string& value : series.values) {
        v1::RenderRequest request = base_;
        if (series.kind != MeasuredSeries::Kind::Sweep) request = truthRequest(base_, m_.reference.by, uint32_t(std::stoul(value)), base_.seed());
        const std::string place = (series.name == series.path ? "--sweep " : "series " + series.name + ", ") + series.path + "=" + value;
        const auto placed = [&](const Status& s) { return s.ok() ? s : Status(s.code(), place + ": " + s.message(), s.location()); };
        if (series.kind == MeasuredSeries::Kind::Sweep) {
          for (const std::string& fixed : series.fixed) GOBO_TRY(placed(setPath(request, fixed)));
          GOBO_TRY(placed(setPath(request, series.path + "=" + value)));
          GOBO_TRY(placed(checkSameTruth(base_, request, m_.reference.by)));
        }
        GOBO_TRY(placed(planOf(session_, request).status()));
        requests_.back().push_back(std::move(request));
      }
    }
    return {};
  }

  Result<Image> picture(const v1::RenderRequest& request, v1::RenderReply& reply) {
    GOBO_ASSIGN(Answer answer, renderOnce(session_, request));
    reply = std::move(answer.reply);
    return rawImage({reply, std::move(answer.images)}, 0);
  }

  Status makeReference() {
    ReferenceRecord& r = m_.reference;
    if (!c_.reference.empty()) {  // taken for the truth: its own noise counts as error
      r.file = fileName(c_.reference);
      GOBO_ASSIGN(halves_.a, readPicture(c_.reference));
      halves_.b = halves_.a;
      // The first run pays for what is made once: a structure to trace rays in, memory.
      v1::RenderReply reply;
      return picture(requests_[0][0], reply).status();
    }
    const uint32_t half = std::max(1u, c_.referenceSpp / 2);
    std::fprintf(stderr, "gobo: reference, 2 x %u %s\n", half, r.by == TruthBy::Rays ? "rays a view sample" : "spp");
    r.samples = 0;
    const auto render = [&](uint64_t seed) -> Result<Image> {
      v1::RenderReply reply;
      const v1::RenderRequest request = truthRequest(base_, r.by, half, seed);
      GOBO_ASSIGN(Image image, picture(request, reply));
      r.samples += r.by == TruthBy::Rays ? request.shadows().ray_traced().samples() : samplesOf(reply);
      r.requestHashes.push_back(reply.request_hash());
      r.resolved.push_back(reply.resolved());
      return image;
    };
    GOBO_ASSIGN(halves_.a, render(base_.seed() + 0x51ed270b1ull));
    GOBO_ASSIGN(halves_.b, render(base_.seed() + 0xa3c59ac2full));
    return {};
  }

  static uint32_t samplesOf(const v1::RenderReply& reply) {
    uint32_t samples = 0;
    for (const v1::NodeReport& n : reply.plan()) samples = std::max(samples, n.samples());
    return samples;
  }

  Status measureAll() {
    std::vector<size_t> points;
    for (const auto& series : requests_) points.push_back(series.size());
    const std::vector<ScheduledRun> runs = interleaved(points, c_.repeats);
    std::map<std::string, HalvesError> errors;  // by the picture's digest
    ProgressBar bar(true, true);
    for (const ScheduledRun& at : runs) {
      const MeasuredSeries& series = m_.series[at.series];
      bar.show(double(at.order) / double(runs.size()), "round " + std::to_string(at.repeat + 1) + ", " + series.name + ", " + series.values[at.point]);
      if (cold_) GOBO_TRY(dropCaches(session_));
      v1::RenderReply reply;
      GOBO_ASSIGN(const Image image, picture(requests_[at.series][at.point], reply));
      MeasuredRun run{at, reply.total_ms() - reply.queue_ms(), reply.queue_ms(), reply.rays(), samplesOf(reply), 0, {}, "", nodeTimes(reply)};
      for (const v1::NodeReport& n : reply.plan()) run.reusedNodes += n.state() == v1::NodeReport::REUSED;
      run.digest = reply.images(0).digest();
      auto known = errors.find(run.digest);
      if (known == errors.end()) {
        GOBO_ASSIGN(const HalvesError error, errorAgainstHalves(image, halves_.a, halves_.b));
        known = errors.emplace(run.digest, error).first;
      }
      run.error = known->second;
      MeasuredPoint& point = m_.points[at.series][at.point];
      if (at.repeat == 0) {
        point.requestHash = reply.request_hash();
        point.resolved = reply.resolved();
        point.warnings.assign(reply.warnings().begin(), reply.warnings().end());
        m_.serverBuild = reply.build();
      }
      m_.runs.push_back(std::move(run));
    }
    bar.clear();
    return {};
  }

  Status deliver() const {
    const std::string json = c_.json || !c_.out.empty() ? measurementJson(m_) : "";
    if (!c_.out.empty()) GOBO_TRY(writeFileAtomic(c_.out, json.data(), json.size()));
    if (!c_.csv.empty()) {
      const std::string csv = runsCsv(m_);
      GOBO_TRY(writeFileAtomic(c_.csv, csv.data(), csv.size()));
    }
    if (c_.json) std::printf("%s", json.c_str());
    else printFigures();
    return {};
  }

  void printFigures() const {
    std::vector<std::vector<std::string>> rows;
    bool noisy = false, reused = false;
    size_t nonFinite = 0;
    for (size_t s = 0; s < m_.series.size(); ++s)
      for (size_t p = 0; p < m_.series[s].values.size(); ++p) {
        const PointFigures f = pointFigures(m_, s, p);
        const ErrorFigure& e = f.error;
        rows.push_back({escaped(m_.series[s].name), escaped(m_.series[s].path + "=" + m_.series[s].values[p]), strf("%.1f", f.time.median),
                        c_.repeats > 1 ? strf("%.1f-%.1f", f.time.lowerQuartile, f.time.upperQuartile) : "-", std::to_string(f.runs.front()->rays),
                        strf("%.4g", e.rmse), strf("%.4g-%.4g", e.rmseLow, e.rmseHigh), strf("%.4g", e.relMse), strf("%.2g", e.relMseStandardError)});
        nonFinite = std::max(nonFinite, e.nonFinite);
        noisy |= e.mseStandardError > 0.1 * std::abs(e.mse);
        for (const MeasuredRun* run : f.runs) reused |= run->reusedNodes > 0;
      }
    printTable({"series", "point", "ms", "quartiles", "rays", "RMSE", "95 %", "relMSE", "+-"}, rows, {false, false, true, true, true, true, true, true, true});
    std::map<std::string, size_t> warnings;
    for (const auto& series : m_.points)
      for (const MeasuredPoint& point : series)
        for (const std::string& text : point.warnings) ++warnings[text];
    for (const auto& [text, points] : warnings) std::printf("warning: %s (%zu points)\n", escaped(text).c_str(), points);
    if (nonFinite > 0) std::printf("warning: up to %zu pixels of a picture or of the reference are not finite: the figures are of the others\n", nonFinite);
    if (noisy) std::printf("warning: the standard error of some squared errors is above 10 %% of them: raise --reference-spp\n");
    if (reused) std::printf("warning: some runs reused terms of the server's store, their times are not cold: --cold drops the caches before each\n");
  }

  Session& session_;
  const MeasureCommand& c_;
  const bool cold_;
  v1::RenderRequest base_;
  std::vector<std::vector<v1::RenderRequest>> requests_;  // [series][point]
  Halves halves_;
  Measurement m_;
};

}  // namespace

int runMeasure(const SessionOptions& options, const MeasureCommand& command) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = Measuring(**session, command).run();
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
