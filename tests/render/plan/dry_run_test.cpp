// SPDX-License-Identifier: Apache-2.0
// Engine::plan: what a render would do, told without doing it, against what it then does.
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <map>

#include "support/planned_nodes.h"

namespace gobo::testing {
namespace {

std::map<std::string, v1::NodeReport> rowsOf(const google::protobuf::RepeatedPtrField<v1::NodeReport>& plan) {
  std::map<std::string, v1::NodeReport> rows;
  for (const v1::NodeReport& row : plan) rows[row.node()] = row;
  return rows;
}

TEST(DryRun, NamesTheNodesThatThenRunAndRunsNone) {
  double least = 1e9, most = 0;
  for (auto [name, request] : requestsWithAllNodes(37, 29)) {
    if (ofPlansAlone(request.scene())) continue;
    SCOPED_TRACE(name);
    request.mutable_halt()->set_spp(16);
    const auto engine = makeEngine();
    const auto planned = engine->plan(request);
    ASSERT_TRUE(planned.ok()) << planned.status().toString();
    v1::StatusReply status;
    engine->fillStatus(status);
    EXPECT_EQ(status.store_terms(), 0u) << "a node ran";
    const RenderResult done = mustRender(*engine, request);
    if (planned->decides_while_planning()) continue;  // another plan, perhaps smaller
    const auto said = rowsOf(planned->plan()), was = rowsOf(done.reply.plan());
    ASSERT_EQ(said.size(), was.size());
    for (const auto& [node, row] : was) {
      ASSERT_TRUE(said.count(node)) << node;
      EXPECT_EQ(said.at(node).state(), row.state()) << node;
      EXPECT_EQ(said.at(node).samples(), row.samples()) << node;
      EXPECT_EQ(said.at(node).rays() > 0, row.rays() > 0) << node << " traces rays or does not";
    }
    const double ratio = double(planned->rays()) / double(std::max<uint64_t>(1, done.reply.rays()));
    EXPECT_TRUE(ratio > 0.3 && ratio < 3.0) << planned->rays() << " rays expected, " << done.reply.rays() << " traced";
    least = std::min(least, ratio);
    most = std::max(most, ratio);
    // Now everything is there; with more samples a part of it.
    const auto again = engine->plan(request);
    ASSERT_TRUE(again.ok());
    EXPECT_EQ(again->rays(), 0u);
    for (const v1::NodeReport& row : again->plan()) EXPECT_NE(row.state(), v1::NodeReport::RUN) << row.node();
  }
  std::cout << "rays expected / traced: " << least << " to " << most << "\n";
}

TEST(DryRun, ABrokenRequestFailsAsItsRenderWould) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell");
  r.add_outputs("group:nobody");
  const auto planned = engine->plan(r);
  ASSERT_FALSE(planned.ok());
  EXPECT_EQ(planned.status().toString(), engine->render(r).status().toString());
}

TEST(DryRun, SaysThatTheSamplesAreNotKnown) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell");
  r.clear_halt();
  r.mutable_halt()->set_time_s(1);
  const auto planned = engine->plan(r);
  ASSERT_TRUE(planned.ok()) << planned.status().toString();
  ASSERT_GE(planned->warnings_size(), 1);
  EXPECT_NE(planned->warnings(planned->warnings_size() - 1).find("time_s"), std::string::npos);
}

TEST(DryRun, ManySamplesAreNoSmallRenderBecauseOneIsThere) {
  const auto engine = makeEngine();
  const v1::RenderRequest many = smallRequest("cornell", 160, 120, 4096), one = smallRequest("cornell", 160, 120, 1);
  const auto before = engine->prepare(many);
  ASSERT_TRUE(before.ok());
  EXPECT_FALSE(before->small);
  ASSERT_TRUE(engine->render(one).ok());
  const auto there = engine->prepare(one), after = engine->prepare(many);
  ASSERT_TRUE(there.ok() && after.ok());
  EXPECT_TRUE(there->small);
  EXPECT_LT(there->expectedMs, 1e-3 * before->expectedMs);
  EXPECT_FALSE(after->small);
  EXPECT_GT(after->expectedMs, 0.9 * before->expectedMs);
}

}  // namespace
}  // namespace gobo::testing
