// SPDX-License-Identifier: Apache-2.0
// The CSV and the JSON of a measurement: every run once, in table order, the same numbers in both; nothing that is not a number; no folders.
#include "measurement/record.h"

#include <cmath>
#include <limits>
#include <sstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace gobo::cli {
namespace {

Measurement example() {
  Measurement m;
  m.date = "2026-11-27T20:00:00Z", m.command = "gobo measure cornell", m.clientBuild = "c", m.serverBuild = "s", m.output = "beauty", m.repeats = 3;
  m.machine = {"CPU", 2, 4}, m.threads = 4, m.cold = true;
  m.scene.set_id("cornell"), m.scene.set_source("/home/me/cornell.glb"), m.scene.set_hash("abc"), m.scene.set_triangles(12);
  m.series = {{"A, b", MeasuredSeries::Kind::Sweep, "halt.spp", {"1", "2"}, {"environment.path=/home/me/sky.hdr"}},
              plainSeries(MeasuredSeries::Kind::PathTracing, 1)};
  m.points.resize(2);
  m.points[0].resize(2), m.points[1].resize(1);
  m.points[0][1].requestHash = "hash", m.points[0][1].warnings = {"careful"};
  m.points[0][1].resolved.mutable_environment()->set_path("/home/me/sky.hdr");
  m.reference.samples = 64, m.reference.resolved.resize(2), m.reference.requestHashes = {"ra", "rb"};
  m.reference.resolved[0].set_seed(17);
  for (const ScheduledRun& at : interleaved({2, 1}, 3)) {
    MeasuredRun run;
    run.at = at, run.ms = 10 * double(at.series + 1) + double(at.point) + 0.25 * double(at.repeat), run.rays = 1000 + at.point,
    run.samples = uint32_t(at.point + 1);
    run.error.mse = 0.25, run.error.standardError = 0.01, run.error.mseLow = 0.16, run.error.mseHigh = 0.36, run.error.rmse = 0.5;
    run.digest = "d";
    run.nodes = {{"gbuffer", double(at.repeat), 5}, {"light", 2, 7}};
    m.runs.push_back(run);
  }
  return m;
}

std::vector<std::string> linesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line.substr(0, line.find('\r')));
  return lines;
}

TEST(Record, CsvHasARowForEachRunInTableOrder) {
  const std::vector<std::string> lines = linesOf(runsCsv(example()));
  ASSERT_EQ(lines.size(), 10u);
  EXPECT_EQ(lines[0].substr(0, 47), "series,path,value,point,repeat,run_order,output");
  EXPECT_EQ(lines[1].substr(0, 43), "\"A, b\",halt.spp,1,0,0,0,beauty,10,0,1000,1,");
  EXPECT_EQ(lines[2].substr(0, 43), "\"A, b\",halt.spp,1,0,1,5,beauty,10.25,0,1000");
  EXPECT_EQ(lines[3].substr(0, 24), "\"A, b\",halt.spp,1,0,2,6,");
  EXPECT_EQ(lines[4].substr(0, 24), "\"A, b\",halt.spp,2,1,0,2,");
  EXPECT_EQ(lines[7].substr(0, 28), "path tracing,halt.spp,1,0,0,");
  EXPECT_EQ(lines[4].substr(lines[4].size() - 7), ",d,hash");
}

TEST(Record, JsonHasTheRowsThePointsAndWhereTheyAreFrom) {
  const auto j = nlohmann::json::parse(measurementJson(example()));
  EXPECT_EQ(j["format"], "gobo measure");
  EXPECT_EQ(j["format_version"], 1);
  EXPECT_EQ(j["scene"]["source"], "cornell.glb");
  EXPECT_EQ(j["machine"]["cpu"], "CPU");
  EXPECT_EQ(j["machine"]["threads"], 4);
  EXPECT_EQ(j["reference"]["halves"].size(), 2u);
  EXPECT_EQ(j["reference"]["halves"][1]["request_hash"], "rb");
  EXPECT_EQ(j["reference"]["halves"][0]["seed"], 17);
  EXPECT_EQ(j["runs"].size(), 9u);
  EXPECT_EQ(j["columns"].size(), j["runs"][0].size());
  for (const auto& column : j["columns"]) EXPECT_TRUE(j["runs"][8].contains(column["name"])) << column;
  EXPECT_EQ(j["runs"][1]["run_order"], 5);
  EXPECT_TRUE(j["runs"][1]["run_order"].is_number_integer());
  EXPECT_NEAR(double(j["runs"][1]["rmse_low"]), 0.4, 1e-12);
  EXPECT_NEAR(double(j["runs"][1]["rmse_high"]), 0.6, 1e-12);
  ASSERT_EQ(j["series"].size(), 2u);
  EXPECT_EQ(j["series"][1]["kind"], "path tracing");
  const auto& point = j["series"][0]["points"][1];
  EXPECT_EQ(point["time_ms"]["median"], 11.25);
  EXPECT_EQ(point["time_ms"]["least"], 11);
  EXPECT_EQ(point["rmse"]["estimate"], 0.5);
  EXPECT_EQ(point["rays"], 1001);
  EXPECT_TRUE(point["rays"].is_number_integer());
  EXPECT_EQ(point["warnings"], std::vector<std::string>{"careful"});
  EXPECT_EQ(point["nodes"][0]["node"], "gbuffer");
  EXPECT_EQ(point["nodes"][0]["time_ms"]["median"], 1);
  EXPECT_EQ(point["nodes"][1]["rays"], 7);
  EXPECT_EQ(point["resolved"]["environment"]["path"], "sky.hdr");
  EXPECT_EQ(j["series"][0]["fixed"][0], "environment.path=sky.hdr");
  EXPECT_EQ(measurementJson(example()).find("/home/me"), std::string::npos);
}

TEST(Record, UnitsFollowTheOutput) {
  Measurement m = example();
  const auto unit = [&](const std::string& name) {
    const auto j = nlohmann::json::parse(measurementJson(m));
    for (const auto& column : j["columns"])
      if (column["name"] == name) return column["unit"].get<std::string>();
    return std::string("no column");
  };
  EXPECT_EQ(unit("rmse"), "scene-linear radiance");
  EXPECT_EQ(unit("mse_low"), "(scene-linear radiance)^2");
  EXPECT_EQ(unit("time_ms"), "ms");
  m.reference.by = TruthBy::Rays;
  EXPECT_EQ(unit("rmse"), "1");
  EXPECT_EQ(unit("mse"), "1");
}

TEST(Record, WhatIsNoNumberIsNull) {
  Measurement m = example();
  m.runs[0].ms = std::numeric_limits<double>::infinity();
  m.runs[0].error.mse = std::nan("");
  m.machine = {}, m.threads = 0;
  const auto j = nlohmann::json::parse(measurementJson(m));
  EXPECT_TRUE(j["runs"][0]["time_ms"].is_null());
  EXPECT_TRUE(j["runs"][0]["mse"].is_null());
  EXPECT_TRUE(j["machine"]["cpu"].is_null());
  EXPECT_TRUE(j["machine"]["cores"].is_null());
  EXPECT_TRUE(j["machine"]["threads"].is_null());
  EXPECT_NE(linesOf(runsCsv(m))[1].find(",beauty,,0,1000,"), std::string::npos);
}

TEST(Record, NodesOfOneKindAreOneAndWhatDidNotRunIsNone) {
  v1::RenderReply reply;
  const auto add = [&](const char* name, v1::NodeReport::State state, double ms, uint64_t rays) {
    v1::NodeReport& n = *reply.add_plan();
    n.set_node(name), n.set_state(state), n.set_ms(ms), n.set_rays(rays);
  };
  add("gbuffer", v1::NodeReport::REUSED, 9, 9);
  add("visibility:key", v1::NodeReport::RUN, 1, 10);
  add("composite", v1::NodeReport::RUN, 4, 0);
  add("visibility:fill", v1::NodeReport::RUN, 2, 20);
  add("visibility:sun", v1::NodeReport::PRUNED, 8, 80);
  const std::vector<NodeTime> nodes = nodeTimes(reply);
  ASSERT_EQ(nodes.size(), 2u);
  EXPECT_EQ(nodes[0].node, "visibility");
  EXPECT_EQ(nodes[0].ms, 3);
  EXPECT_EQ(nodes[0].rays, 30u);
  EXPECT_EQ(nodes[1].node, "composite");
}

}  // namespace
}  // namespace gobo::cli
