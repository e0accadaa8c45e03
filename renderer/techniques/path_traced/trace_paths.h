// SPDX-License-Identifier: Apache-2.0
// Path tracing nodes for sets of paths of some lights: what the path tracer's own technique plans, and what others ask it for beside their part
// (light through surfaces whose front alone they see).
#pragma once

#include <string>
#include <vector>

#include "technique/plan_context.h"
#include "trace/path_tracer.h"

namespace gobo {
inline namespace techniques {

/// Of the request: camera, size, bounces, seed. Groups are the caller's.
PathTracerSettings pathTracerSettings(const PlanContext& context, PathClass cover);
SamplerKind samplerOf(const v1::Integrator& integrator);

/// `paths` of `lights`, by relight groups, brought in the name of `technique`, which has claimed them. Of direct light the tracer can tell lobes
/// apart, and what is behind from all; not the front alone where light passes surfaces (Internal).
Status tracePaths(PlanContext& context, const char* technique, const std::vector<int>& lights, PathSet paths, const std::string& label);
/// All paths of one light of a cluster, white and at its nominal power, `weight` times on top of what its cluster has of it; but for those that are brought at
/// its gains (PlanContext::claimAtGains).
Status traceDifference(PlanContext& context, int light, const Vec3& weight);
/// The state of what the camera sees of one light without a scattering event, by the samples that tracePaths takes. Nothing is added to the picture.
Result<NodeId> traceSeen(PlanContext& context, int light, const Vec3& nominal, const ScenePtr& scene, const std::string& label);
/// What unlit surfaces show, which is no light's.
Status traceUnlit(PlanContext& context);

}  // namespace techniques
}  // namespace gobo
