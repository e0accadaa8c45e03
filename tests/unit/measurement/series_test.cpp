// SPDX-License-Identifier: Apache-2.0
// Series of `gobo measure`: the grammar, what it refuses, and the order of runs.
#include "measurement/series.h"

#include <map>
#include <set>

#include <gtest/gtest.h>

namespace gobo::cli {
namespace {

using Kind = SeriesWord::Kind;

SeriesWord named(const std::string& text) { return {Kind::Series, text}; }
SeriesWord sweep(const std::string& text) { return {Kind::Sweep, text}; }
SeriesWord with(const std::string& text) { return {Kind::With, text}; }

std::string refusal(const std::vector<SeriesWord>& words) {
  const auto parsed = parseSeries(words);
  if (parsed.ok()) return "accepted";
  EXPECT_EQ(parsed.status().code(), Code::InvalidArgument);
  return parsed.status().message();
}

TEST(Series, SweepAndFixedSettingsBelongToTheNameBeforeThem) {
  const auto parsed = parseSeries({named("A b"), with("shadows.axis_aligned.k=3"), sweep("halt.spp=1,2,4"), with("seed=5"), named("B"), sweep("seed=7")});
  ASSERT_TRUE(parsed.ok()) << parsed.status().toString();
  ASSERT_EQ(parsed->size(), 2u);
  const MeasuredSeries &a = (*parsed)[0], &b = (*parsed)[1];
  EXPECT_EQ(a.name, "A b");
  EXPECT_EQ(a.kind, MeasuredSeries::Kind::Sweep);
  EXPECT_EQ(a.path, "halt.spp");
  EXPECT_EQ(a.values, (std::vector<std::string>{"1", "2", "4"}));
  EXPECT_EQ(a.fixed, (std::vector<std::string>{"shadows.axis_aligned.k=3", "seed=5"}));
  EXPECT_EQ(b.name, "B");
  EXPECT_EQ(b.values, (std::vector<std::string>{"7"}));
  EXPECT_TRUE(b.fixed.empty());
}

TEST(Series, SweepsWithoutANameAreSeriesNamedByTheirPath) {
  const auto parsed = parseSeries({sweep("halt.spp=1,2"), with("seed=1"), sweep("seed=3,4"), with("halt.spp=2"), named("C"), sweep("seed=9")});
  ASSERT_TRUE(parsed.ok()) << parsed.status().toString();
  ASSERT_EQ(parsed->size(), 3u);
  EXPECT_EQ((*parsed)[0].name, "halt.spp");
  EXPECT_EQ((*parsed)[0].fixed, (std::vector<std::string>{"seed=1"}));
  EXPECT_EQ((*parsed)[1].name, "seed");
  EXPECT_EQ((*parsed)[1].fixed, (std::vector<std::string>{"halt.spp=2"}));
  EXPECT_EQ((*parsed)[2].name, "C");
}

TEST(Series, SemicolonsKeepCommasInValues) {
  const auto parsed = parseSeries({sweep("lights.key.color=1,0,0;0,1,0")});
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ((*parsed)[0].values, (std::vector<std::string>{"1,0,0", "0,1,0"}));
  const auto formulas = parseSeries({sweep("expressions.x.formula=a=b,c=d")});  // the first '=' ends the path
  ASSERT_TRUE(formulas.ok());
  EXPECT_EQ((*formulas)[0].values, (std::vector<std::string>{"a=b", "c=d"}));
}

TEST(Series, NothingIsNoSeries) {
  const auto parsed = parseSeries({});
  ASSERT_TRUE(parsed.ok());
  EXPECT_TRUE(parsed->empty());
}

TEST(Series, WhatIsWrongIsNamed) {
  EXPECT_EQ(refusal({sweep("halt.spp")}), "--sweep halt.spp: must be PATH=VALUE,VALUE,...");
  EXPECT_EQ(refusal({sweep("=1")}), "--sweep =1: must be PATH=VALUE,VALUE,...");
  EXPECT_EQ(refusal({sweep("halt.spp=")}), "--sweep halt.spp=: must be PATH=VALUE,VALUE,...");
  EXPECT_EQ(refusal({sweep("halt.spp=1,,2")}), "--sweep halt.spp=1,,2: an empty value");
  EXPECT_EQ(refusal({sweep("halt.spp=1,")}), "--sweep halt.spp=1,: an empty value");
  EXPECT_EQ(refusal({sweep("halt.spp=1,2,1")}), "--sweep halt.spp=1,2,1: the value 1 twice");
  EXPECT_EQ(refusal({named("A")}), "--series A: is empty, a --sweep PATH=VALUE,VALUE,... must follow it");
  EXPECT_EQ(refusal({named("A"), with("seed=1"), named("B"), sweep("seed=1")}), "--series A: is empty, a --sweep PATH=VALUE,VALUE,... must follow it");
  EXPECT_EQ(refusal({named("A"), sweep("seed=1"), sweep("halt.spp=1")}), "--series A: has two sweeps, seed and halt.spp=1: begin another with --series NAME");
  EXPECT_EQ(refusal({named("A"), sweep("seed=1"), named("A"), sweep("seed=2")}), "two series are named \"A\": name them apart by --series NAME before each");
  EXPECT_EQ(refusal({sweep("seed=1"), sweep("seed=2")}), "two series are named \"seed\": name them apart by --series NAME before each");
  EXPECT_EQ(refusal({with("seed=1"), sweep("seed=2")}), "--with seed=1: comes after the --series or --sweep that it is of (--set is of all series)");
  EXPECT_EQ(refusal({named("A"), with("seed"), sweep("seed=2")}), "--with seed: must be PATH=VALUE");
  EXPECT_EQ(refusal({named(""), sweep("seed=2")}), "--series: a name is empty");
  EXPECT_EQ(refusal({named("a\nb"), sweep("seed=2")}), "--series: a name has a control character");
  EXPECT_EQ(refusal({named(std::string(81, 'a')), sweep("seed=2")}), "--series " + std::string(81, 'a') + ": a name has at most 80 bytes");
  EXPECT_EQ(refusal({named(std::string(80, 'a')), sweep("seed=2")}), "accepted");
}

TEST(Series, PlainOnesDoubleUpToTheMost) {
  const auto values = [](uint32_t most) { return plainSeries(MeasuredSeries::Kind::PathTracing, most).values; };
  EXPECT_EQ(values(1), (std::vector<std::string>{"1"}));
  EXPECT_EQ(values(8), (std::vector<std::string>{"1", "2", "4", "8"}));
  EXPECT_EQ(values(10), (std::vector<std::string>{"1", "2", "4", "8", "10"}));
  EXPECT_EQ(values(0xffffffffu).back(), "4294967295");
  EXPECT_EQ(plainSeries(MeasuredSeries::Kind::PathTracing, 4).path, "halt.spp");
  EXPECT_EQ(plainSeries(MeasuredSeries::Kind::ShadowRays, 4).path, "shadows.ray_traced.samples");
  std::vector<MeasuredSeries> all = *parseSeries({named("path tracing"), sweep("halt.spp=1")});
  EXPECT_FALSE(addSeries(all, plainSeries(MeasuredSeries::Kind::PathTracing, 4)).ok());
  EXPECT_TRUE(addSeries(all, plainSeries(MeasuredSeries::Kind::ShadowRays, 4)).ok());
  EXPECT_EQ(all.size(), 2u);
}

TEST(Interleaving, EveryRoundRunsEveryPointOnceAndOrderCounts) {
  for (const std::vector<size_t>& points : {std::vector<size_t>{1}, {3}, {2, 5, 1}, {4, 4}, {1, 1, 1, 1}})
    for (size_t repeats = 1; repeats <= 5; ++repeats) {
      size_t all = 0;
      for (const size_t n : points) all += n;
      const std::vector<ScheduledRun> runs = interleaved(points, repeats);
      ASSERT_EQ(runs.size(), all * repeats);
      for (size_t r = 0; r < repeats; ++r) {
        std::set<std::pair<size_t, size_t>> seen;
        for (size_t i = r * all; i < (r + 1) * all; ++i) {
          EXPECT_EQ(runs[i].order, i);
          EXPECT_EQ(runs[i].repeat, r);
          ASSERT_LT(runs[i].series, points.size());
          ASSERT_LT(runs[i].point, points[runs[i].series]);
          seen.emplace(runs[i].series, runs[i].point);
        }
        EXPECT_EQ(seen.size(), all);
      }
    }
  EXPECT_TRUE(interleaved({}, 3).empty());
}

TEST(Interleaving, NeighboursAreOfDifferentSeries) {
  const std::vector<ScheduledRun> runs = interleaved({4, 4, 4}, 1);
  for (size_t i = 1; i < runs.size(); ++i) EXPECT_NE(runs[i].series, runs[i - 1].series) << i;
  EXPECT_EQ(runs[0].point, 0u);
  EXPECT_EQ(runs[11].point, 3u);
}

/// A machine that slows down steadily favours no point.
TEST(Interleaving, MeanPlacesAreEqualOverEvenNumbersOfRounds) {
  for (const size_t repeats : {2u, 4u, 10u}) {
    std::map<std::pair<size_t, size_t>, double> place;
    const std::vector<ScheduledRun> runs = interleaved({3, 5, 2}, repeats);
    for (const ScheduledRun& run : runs) place[{run.series, run.point}] += double(run.order) / double(repeats);
    for (const auto& [point, mean] : place) EXPECT_DOUBLE_EQ(mean, double(runs.size() - 1) / 2);
  }
}

}  // namespace
}  // namespace gobo::cli
