// SPDX-License-Identifier: Apache-2.0
// What `gobo measure` found: a row for each run (tidy data: Wickham, Journal of Statistical Software 59, 2014), what the runs of a point say together, and
// where all of it comes from. docs/measuring.md has the columns and fields in words; gobo.report (Python) reads both files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "gobo/v1/render.pb.h"
#include "gobo/v1/service.pb.h"
#include "measurement/provenance.h"
#include "measurement/reference.h"
#include "measurement/series.h"
#include "measurement/statistics.h"

namespace gobo::cli {

struct NodeTime {
  std::string node;  ///< kind: "visibility" of visibility:key and visibility:fill
  double ms = 0;
  uint64_t rays = 0;
};
/// Rows that ran, by kind, in the order of the plan.
std::vector<NodeTime> nodeTimes(const v1::RenderReply& reply);

struct MeasuredRun {
  ScheduledRun at;
  double ms = 0, queueMs = 0;
  uint64_t rays = 0;
  uint32_t samples = 0;
  uint32_t reusedNodes = 0;
  HalvesError error;
  std::string digest;  ///< of the picture's floats: equal pictures have equal ones
  std::vector<NodeTime> nodes;
};

struct MeasuredPoint {
  std::string requestHash;
  v1::RenderRequest resolved;
  std::vector<std::string> warnings;
};

struct ReferenceRecord {
  std::string file;  ///< name of a picture that was given; empty: made by `requests`
  TruthBy by = TruthBy::Paths;
  uint32_t samples = 0;                     ///< a pixel (rays: a view sample), of both halves together
  std::vector<v1::RenderRequest> resolved;  ///< of the halves
  std::vector<std::string> requestHashes;
};

struct Measurement {
  std::string date, command, clientBuild, serverBuild;  ///< date: UTC, ISO 8601
  Machine machine;                                      ///< of the server; nothing known where that may be another one
  uint32_t threads = 0;                                 ///< of the server; 0: not known
  v1::SceneInfo scene;
  std::string output;
  bool cold = false;
  size_t repeats = 1;
  ReferenceRecord reference;
  std::vector<MeasuredSeries> series;
  std::vector<std::vector<MeasuredPoint>> points;  ///< [series][point]
  std::vector<MeasuredRun> runs;                   ///< in the order in which they ran
};

struct MeasurementColumn {
  const char *name, *unit, *meaning;  ///< unit "": text; "error", "error^2": errorUnit() and its square
};
/// The columns of the CSV and the keys of the JSON's rows.
const std::vector<MeasurementColumn>& measurementColumns();

struct PointFigures {
  TimeFigures time;
  ErrorFigure error;
  std::vector<const MeasuredRun*> runs;  ///< by repeat
};
/// The point has a run (CHECKed).
PointFigures pointFigures(const Measurement& m, size_t series, size_t point);

/// RFC 4180, header first, numbers with 17 significant digits, empty where not finite; rows by series, point, repeat.
std::string runsCsv(const Measurement& m);
/// Everything. Paths of environments are reduced to file names.
std::string measurementJson(const Measurement& m);

}  // namespace gobo::cli
