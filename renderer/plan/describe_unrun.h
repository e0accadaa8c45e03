// SPDX-License-Identifier: Apache-2.0
// What a plan would do if it were run now. Runs no node.
#pragma once

#include "gobo/v1/service.pb.h"
#include "plan/executor.h"
#include "plan/planner.h"

namespace gobo {
inline namespace plan {

/// Fills everything but `resolved` and the errors. `executor` is of plan.graph and has run nothing; what the store has and how long nodes take here is what
/// its services know.
void describeUnrun(const Plan& plan, Executor& executor, v1::PlanReply& reply);

/// Whether its error is noise of samples and nothing else: it leaves out and approximates nothing, and whatever traces rays does so by sample.
bool samplesDecideAll(const Plan& plan);

/// Milliseconds that running it now would take on an idle machine.
double expectedMs(const Plan& plan, Executor& executor);

/// Of those the ones for what comes before anything of the view: results that decide what is planned, and terms dear enough for the disk tier, but for sums of
/// samples.
double aheadMs(const Plan& plan, Executor& executor);

/// Rows of what was left out of the plan, and why; of replies too.
void addPrunedRows(const Graph& graph, google::protobuf::RepeatedPtrField<v1::NodeReport>& rows);

}  // namespace plan
}  // namespace gobo
