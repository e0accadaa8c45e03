// SPDX-License-Identifier: Apache-2.0
// What `gobo measure` is told to compare: series of points, each a technique at many budgets. Pure; any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo::cli {

/// One --series, --sweep or --with, in the order of the command line.
struct SeriesWord {
  enum class Kind { Series, Sweep, With };
  Kind kind = Kind::Sweep;
  std::string text;
};

struct MeasuredSeries {
  enum class Kind { Sweep, PathTracing, ShadowRays };
  std::string name;
  Kind kind = Kind::Sweep;
  std::string path;                 ///< swept field of the request
  std::vector<std::string> values;  ///< as the command line has them, in its order; at least one
  std::vector<std::string> fixed;   ///< PATH=VALUE of this series alone
};

/// The grammar. A --series NAME begins a series, whose --sweep PATH=VALUE,VALUE,... (exactly one) and --with PATH=VALUE (any number) follow it in any order.
/// A --sweep that no --series begins, or that follows a whole series without a name, is a series named by its path; --with after it are its own.
/// ';' stands between values that hold commas themselves: lights.key.color=1,0,0;0,1,0.
/// Paths are not looked up here. Errors: InvalidArgument naming the option: a text that is no PATH=VALUES or PATH=VALUE, an empty or repeated value, a series
/// without a sweep or with two, a --with of no series, a name that is empty, comes twice, is longer than 80 bytes or has control characters; no series at all.
Result<std::vector<MeasuredSeries>> parseSeries(const std::vector<SeriesWord>& words);

/// The line that others are compared with: values 1, 2, 4, ... of samples, up to `most` (at least 1), which is the last one whether it is a power of two or
/// not. `kind` is PathTracing ("path tracing", over halt.spp) or ShadowRays ("shadow rays", over shadows.ray_traced.samples).
MeasuredSeries plainSeries(MeasuredSeries::Kind kind, uint32_t most);
/// Adds `series`. Errors: InvalidArgument: the name is taken.
Status addSeries(std::vector<MeasuredSeries>& all, MeasuredSeries series);

/// One run of a point. `order` counts runs from 0.
struct ScheduledRun {
  size_t series = 0, point = 0, repeat = 0, order = 0;
};
/// Rounds: each runs every point once. Within a round the first points of all series come before the second ones, so that neighbours in time are of different
/// series; every second round goes backwards, so that over an even number of rounds all points have the same mean place and a drift of the machine
/// that is linear in time moves none of them against another (counterbalancing: Cochran, Cox, Experimental Designs, 1957, on systematic trends).
/// `points`: how many each series has.
std::vector<ScheduledRun> interleaved(const std::vector<size_t>& points, size_t repeats);

}  // namespace gobo::cli
