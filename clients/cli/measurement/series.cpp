// SPDX-License-Identifier: Apache-2.0
#include "measurement/series.h"

#include <algorithm>

#include "base/check.h"

namespace gobo::cli {
namespace {

constexpr size_t kLongestName = 80;

/// Where the name is the path of the sweep, which may not have come yet.
struct OpenSeries {
  MeasuredSeries series;
  bool named = false;
};

Status checkSeriesName(const std::string& name) {
  if (name.empty()) return invalidArgument("--series: a name is empty");
  if (name.size() > kLongestName) return invalidArgument("--series " + name + ": a name has at most " + std::to_string(kLongestName) + " bytes");
  for (const unsigned char c : name)
    if (c < 0x20 || c == 0x7f) return invalidArgument("--series: a name has a control character");
  return {};
}

/// The text before '=', which must be there and have something on both sides.
Result<size_t> pathEnd(const std::string& option, const std::string& text, const char* form) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size()) return invalidArgument(option + " " + text + ": must be " + form);
  return equals;
}

Status takeSweep(const std::string& text, MeasuredSeries& to) {
  GOBO_ASSIGN(const size_t equals, pathEnd("--sweep", text, "PATH=VALUE,VALUE,..."));
  to.path = text.substr(0, equals);
  const std::string list = text.substr(equals + 1);
  const char by = list.find(';') != std::string::npos ? ';' : ',';
  for (size_t begin = 0; begin <= list.size();) {
    const size_t end = std::min(list.find(by, begin), list.size());
    const std::string value = list.substr(begin, end - begin);
    if (value.empty()) return invalidArgument("--sweep " + text + ": an empty value");
    if (std::find(to.values.begin(), to.values.end(), value) != to.values.end()) return invalidArgument("--sweep " + text + ": the value " + value + " twice");
    to.values.push_back(value);
    begin = end + 1;
  }
  return {};
}

}  // namespace

Status addSeries(std::vector<MeasuredSeries>& all, MeasuredSeries series) {
  for (const MeasuredSeries& s : all)
    if (s.name == series.name) return invalidArgument("two series are named \"" + series.name + "\": name them apart by --series NAME before each");
  all.push_back(std::move(series));
  return {};
}

Result<std::vector<MeasuredSeries>> parseSeries(const std::vector<SeriesWord>& words) {
  std::vector<MeasuredSeries> all;
  std::vector<OpenSeries> open;  // at most one
  const auto close = [&]() -> Status {
    if (open.empty()) return {};
    MeasuredSeries series = std::move(open.back().series);
    open.pop_back();
    if (series.values.empty()) return invalidArgument("--series " + series.name + ": is empty, a --sweep PATH=VALUE,VALUE,... must follow it");
    return addSeries(all, std::move(series));
  };
  for (const SeriesWord& word : words) {
    switch (word.kind) {
      case SeriesWord::Kind::Series:
        GOBO_TRY(close());
        GOBO_TRY(checkSeriesName(word.text));
        open.emplace_back().named = true;
        open.back().series.name = word.text;
        break;
      case SeriesWord::Kind::Sweep: {
        if (!open.empty() && !open.back().series.values.empty()) {
          const MeasuredSeries& s = open.back().series;
          if (open.back().named)
            return invalidArgument("--series " + s.name + ": has two sweeps, " + s.path + " and " + word.text + ": begin another with --series NAME");
          GOBO_TRY(close());
        }
        if (open.empty()) open.emplace_back();
        GOBO_TRY(takeSweep(word.text, open.back().series));
        if (!open.back().named) open.back().series.name = open.back().series.path;
        break;
      }
      case SeriesWord::Kind::With:
        if (open.empty()) return invalidArgument("--with " + word.text + ": comes after the --series or --sweep that it is of (--set is of all series)");
        GOBO_TRY(pathEnd("--with", word.text, "PATH=VALUE").status());
        open.back().series.fixed.push_back(word.text);
        break;
    }
  }
  GOBO_TRY(close());
  return all;
}

MeasuredSeries plainSeries(MeasuredSeries::Kind kind, uint32_t most) {
  GOBO_CHECK(kind != MeasuredSeries::Kind::Sweep && most >= 1);
  const bool paths = kind == MeasuredSeries::Kind::PathTracing;
  MeasuredSeries series{paths ? "path tracing" : "shadow rays", kind, paths ? "halt.spp" : "shadows.ray_traced.samples", {}, {}};
  for (uint64_t n = 1; n < most; n *= 2) series.values.push_back(std::to_string(n));
  series.values.push_back(std::to_string(most));
  return series;
}

std::vector<ScheduledRun> interleaved(const std::vector<size_t>& points, size_t repeats) {
  std::vector<ScheduledRun> round;
  const size_t longest = points.empty() ? 0 : *std::max_element(points.begin(), points.end());
  for (size_t p = 0; p < longest; ++p)
    for (size_t s = 0; s < points.size(); ++s)
      if (p < points[s]) round.push_back({s, p, 0, 0});
  std::vector<ScheduledRun> runs;
  runs.reserve(round.size() * repeats);
  for (size_t r = 0; r < repeats; ++r) {
    for (ScheduledRun run : round) {
      run.repeat = r, run.order = runs.size();
      runs.push_back(run);
    }
    std::reverse(round.begin(), round.end());
  }
  return runs;
}

}  // namespace gobo::cli
