// SPDX-License-Identifier: Apache-2.0
// How each output is planned: the functions behind the rows of outputs.cpp.
#pragma once

#include <string>

#include "plan/outputs.h"
#include "plan/planner.h"
#include "technique/plan_context.h"

namespace gobo {
inline namespace plan {

class OutputContext {
 public:
  OutputContext(PlanContext& plan, const ScenePtr& base, const PlannerServices& services) : plan(plan), base(base), services(services) {}
  PlanContext& plan;
  const ScenePtr& base;  ///< before the request's edits
  const PlannerServices& services;
};

Result<OutputPlane> planComposite(OutputContext&, const std::string& output, const std::string& light);       ///< what the row shows of the beauty
Result<OutputPlane> planNegativeLight(OutputContext&, const std::string& output, const std::string& light);   ///< that subtractive shadows cut off at 0
Result<OutputPlane> planFilteredStage(OutputContext&, const std::string& output, const std::string& filter);  ///< a term after some of its filters
Result<OutputPlane> planAlbedo(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planNormal(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planPosition(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planDepth(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planZDepth(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planAlpha(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planObjectId(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planMaterialId(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planCryptomatteObject(OutputContext&, const std::string& output, const std::string& light);    ///< plan/cryptomatte.h
Result<OutputPlane> planCryptomatteMaterial(OutputContext&, const std::string& output, const std::string& light);  ///< plan/cryptomatte.h
Result<OutputPlane> planMotion(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planSampleCount(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planVariance(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planUnoccludedOutput(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planVisibilityOutput(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planShadowDistance(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planShadowFlags(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planShadowRays(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planShadowWidth(OutputContext&, const std::string& output, const std::string& light);
Result<OutputPlane> planShadowBasis(OutputContext&, const std::string& output, const std::string& light);

}  // namespace plan
}  // namespace gobo
