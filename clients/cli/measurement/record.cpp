// SPDX-License-Identifier: Apache-2.0
#include "measurement/record.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

#include "base/check.h"
#include "measure/report.h"
#include "request/request.h"

namespace gobo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFormatVersion = 1;

/// JSON has no NaN or infinity.
Json finite(double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); }

/// Counts stay integers.
Json number(double v) {
  if (std::isfinite(v) && v == std::floor(v) && std::fabs(v) < 9e15) return Json(int64_t(v));
  return finite(v);
}

Json known(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }
Json known(int count) { return count > 0 ? Json(count) : Json(nullptr); }

std::string unitOf(const MeasurementColumn& column, const std::string& error) {
  const std::string unit = column.unit;
  if (unit == "error") return error;
  if (unit == "error^2") return error == "1" ? error : "(" + error + ")^2";
  return unit;
}

Json requestJson(v1::RenderRequest request) {
  if (request.environment().has_path()) request.mutable_environment()->set_path(fileName(request.environment().path()));
  return Json::parse(messageToJson(request, false));
}

std::vector<const MeasuredRun*> inTableOrder(const Measurement& m) {
  std::vector<const MeasuredRun*> rows;
  for (const MeasuredRun& run : m.runs) rows.push_back(&run);
  std::sort(rows.begin(), rows.end(), [](const MeasuredRun* a, const MeasuredRun* b) {
    return std::tuple(a->at.series, a->at.point, a->at.repeat) < std::tuple(b->at.series, b->at.point, b->at.repeat);
  });
  return rows;
}

/// In the order of measurementColumns().
std::vector<Table::Cell> cellsOf(const Measurement& m, const MeasuredRun& run) {
  const MeasuredSeries& series = m.series[run.at.series];
  const HalvesError& e = run.error;
  const double low = std::sqrt(std::max(0.0, e.mseLow)), high = std::sqrt(std::max(0.0, e.mseHigh));
  return {series.name,
          series.path,
          withoutFolders(series.values[run.at.point]),
          double(run.at.point),
          double(run.at.repeat),
          double(run.at.order),
          m.output,
          run.ms,
          run.queueMs,
          double(run.rays),
          double(run.samples),
          double(run.reusedNodes),
          e.rmse,
          low,
          high,
          e.mse,
          e.standardError,
          e.mseLow,
          e.mseHigh,
          e.relMse,
          e.relMseStandardError,
          double(e.nonFinite),
          run.digest,
          m.points[run.at.series][run.at.point].requestHash};
}

Json timeJson(const TimeFigures& t) {
  return {{"median", finite(t.median)},
          {"lower_quartile", finite(t.lowerQuartile)},
          {"upper_quartile", finite(t.upperQuartile)},
          {"least", finite(t.least)},
          {"most", finite(t.most)},
          {"median_interval", {{"low", finite(t.low)}, {"high", finite(t.high)}, {"confidence", finite(t.confidence)}}}};
}

/// A kind that some repeats did not run took no time there.
Json nodesJson(const std::vector<const MeasuredRun*>& runs) {
  std::vector<std::string> order;
  std::map<std::string, std::vector<double>> ms, rays;
  for (size_t r = 0; r < runs.size(); ++r)
    for (const NodeTime& n : runs[r]->nodes) {
      if (!ms.count(n.node)) order.push_back(n.node), ms[n.node].resize(runs.size()), rays[n.node].resize(runs.size());
      ms[n.node][r] += n.ms, rays[n.node][r] += double(n.rays);
    }
  Json out = Json::array();
  for (const std::string& node : order) {
    const TimeFigures t = timeFigures(ms[node]);
    out.push_back({{"node", node},
                   {"time_ms", {{"median", finite(t.median)}, {"lower_quartile", finite(t.lowerQuartile)}, {"upper_quartile", finite(t.upperQuartile)}}},
                   {"rays", number(quantile(rays[node], 0.5))}});
  }
  return out;
}

Json pointJson(const Measurement& m, size_t series, size_t index) {
  const MeasuredPoint& point = m.points[series][index];
  const PointFigures f = pointFigures(m, series, index);
  std::vector<double> rays;
  for (const MeasuredRun* run : f.runs) rays.push_back(double(run->rays));
  const ErrorFigure& e = f.error;
  return {{"point", index},
          {"value", withoutFolders(m.series[series].values[index])},
          {"request_hash", point.requestHash},
          {"samples_per_pixel", f.runs.front()->samples},
          {"time_ms", timeJson(f.time)},
          {"rays", number(quantile(rays, 0.5))},
          {"rmse", {{"estimate", finite(e.rmse)}, {"low", finite(e.rmseLow)}, {"high", finite(e.rmseHigh)}}},
          {"mse", {{"estimate", finite(e.mse)}, {"standard_error", finite(e.mseStandardError)}, {"low", finite(e.mseLow)}, {"high", finite(e.mseHigh)}}},
          {"rel_mse", {{"estimate", finite(e.relMse)}, {"standard_error", finite(e.relMseStandardError)}}},
          {"nonfinite_pixels", e.nonFinite},
          {"nodes", nodesJson(f.runs)},
          {"warnings", point.warnings},
          {"resolved", requestJson(point.resolved)}};
}

const char* kindName(MeasuredSeries::Kind kind) {
  switch (kind) {
    case MeasuredSeries::Kind::Sweep: return "sweep";
    case MeasuredSeries::Kind::PathTracing: return "path tracing";
    case MeasuredSeries::Kind::ShadowRays: return "shadow rays";
  }
  return "";
}

Json referenceJson(const ReferenceRecord& r) {
  if (!r.file.empty()) return {{"kind", "file"}, {"file", r.file}, {"samples_per_pixel", nullptr}, {"halves", Json::array()}};
  Json halves = Json::array();
  for (size_t i = 0; i < r.resolved.size(); ++i)
    halves.push_back({{"seed", r.resolved[i].seed()}, {"request_hash", r.requestHashes[i]}, {"resolved", requestJson(r.resolved[i])}});
  return {{"kind", r.by == TruthBy::Rays ? "shadow rays" : "path tracing"}, {"file", nullptr}, {"samples_per_pixel", r.samples}, {"halves", halves}};
}

}  // namespace

std::vector<NodeTime> nodeTimes(const v1::RenderReply& reply) {
  std::vector<NodeTime> out;
  for (const v1::NodeReport& n : reply.plan()) {
    if (n.state() != v1::NodeReport::RUN) continue;
    const std::string kind = n.node().substr(0, n.node().find(':'));
    auto at = std::find_if(out.begin(), out.end(), [&](const NodeTime& t) { return t.node == kind; });
    if (at == out.end()) at = out.insert(out.end(), {kind, 0, 0});
    at->ms += n.ms(), at->rays += n.rays();
  }
  return out;
}

const std::vector<MeasurementColumn>& measurementColumns() {
  static const std::vector<MeasurementColumn> columns{
      {"series", "", "name of the series"},
      {"path", "", "field of the request that the series sweeps"},
      {"value", "", "its value at this point, as on the command line"},
      {"point", "1", "number of the point in its series, from 0"},
      {"repeat", "1", "round of the run, from 0"},
      {"run_order", "1", "how many runs came before this one"},
      {"output", "", "what the error is of"},
      {"time_ms", "ms", "time of the render without its wait for others"},
      {"queue_ms", "ms", "that wait"},
      {"rays", "1", "rays traced"},
      {"samples_per_pixel", "1", "samples of path-traced nodes as they came out; 0: none is"},
      {"reused_nodes", "1", "results that were there already: the time is of a part of the work where this is not 0"},
      {"rmse", "error", "root of the mean squared error over pixels and channels; of mse where that is above 0"},
      {"rmse_low", "error", "95 % interval"},
      {"rmse_high", "error", "95 % interval"},
      {"mse", "error^2", "mean squared error, without the noise of the reference; it may be negative"},
      {"mse_standard_error", "error^2", "over pixels, their noise taken as independent"},
      {"mse_low", "error^2", "95 % interval"},
      {"mse_high", "error^2", "95 % interval"},
      {"rel_mse", "1", "mean of squared error over (squared reference + 0.01)"},
      {"rel_mse_standard_error", "1", "over pixels, and of the reference's noise in the denominator"},
      {"nonfinite_pixels", "1", "pixels with a NaN or an infinity, left out of the errors"},
      {"picture_digest", "", "XXH3-128 of the picture: equal for equal pictures"},
      {"request_hash", "", "of the resolved request and the scene"},
  };
  return columns;
}

PointFigures pointFigures(const Measurement& m, size_t series, size_t point) {
  PointFigures out;
  for (const MeasuredRun& run : m.runs)
    if (run.at.series == series && run.at.point == point) out.runs.push_back(&run);
  GOBO_CHECK(!out.runs.empty());
  std::vector<double> times;
  std::vector<HalvesError> errors;
  for (const MeasuredRun* run : out.runs) times.push_back(run->ms), errors.push_back(run->error);
  out.time = timeFigures(times);
  out.error = errorFigure(errors);
  return out;
}

std::string runsCsv(const Measurement& m) {
  std::vector<std::string> names;
  for (const MeasurementColumn& c : measurementColumns()) names.emplace_back(c.name);
  Table table("runs", names);
  for (const MeasuredRun* run : inTableOrder(m)) table.add(cellsOf(m, *run));
  return table.csv();
}

std::string measurementJson(const Measurement& m) {
  const std::string error = errorUnit(m.reference.by);
  Json columns = Json::array();
  for (const MeasurementColumn& c : measurementColumns()) columns.push_back({{"name", c.name}, {"unit", unitOf(c, error)}, {"meaning", c.meaning}});
  Json runs = Json::array();
  for (const MeasuredRun* run : inTableOrder(m)) {
    Json row;
    const std::vector<Table::Cell> cells = cellsOf(m, *run);
    for (size_t c = 0; c < cells.size(); ++c) {
      const auto* text = std::get_if<std::string>(&cells[c]);
      row[measurementColumns()[c].name] = text ? Json(*text) : number(std::get<double>(cells[c]));
    }
    runs.push_back(std::move(row));
  }
  Json series = Json::array();
  for (size_t s = 0; s < m.series.size(); ++s) {
    Json points = Json::array();
    for (size_t p = 0; p < m.series[s].values.size(); ++p) points.push_back(pointJson(m, s, p));
    std::vector<std::string> fixed;
    for (const std::string& text : m.series[s].fixed) fixed.push_back(withoutFolders(text));
    series.push_back({{"name", m.series[s].name}, {"kind", kindName(m.series[s].kind)}, {"path", m.series[s].path}, {"fixed", fixed}, {"points", points}});
  }
  const Json out = {
      {"format", "gobo measure"},
      {"format_version", kFormatVersion},
      {"date_utc", m.date},
      {"command", m.command},
      {"build", {{"client", m.clientBuild}, {"server", m.serverBuild}}},
      {"machine",
       {{"cpu", known(m.machine.cpu)},
        {"cores", known(m.machine.cores)},
        {"logical_cores", known(m.machine.logicalCores)},
        {"threads", known(int(m.threads))}}},
      {"scene", {{"id", m.scene.id()}, {"source", fileName(m.scene.source())}, {"hash", m.scene.hash()}, {"triangles", m.scene.triangles()}}},
      {"output", m.output},
      {"error_unit", error},
      {"cold", m.cold},
      {"repeats", m.repeats},
      {"reference", referenceJson(m.reference)},
      {"columns", columns},
      {"series", series},
      {"runs", runs},
  };
  return out.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace gobo::cli
