// SPDX-License-Identifier: Apache-2.0
// Whether and how a request's caustics are made: what the planner and the certificate agree on. Pure functions.
#pragma once

#include <string>
#include <vector>

#include "gobo/v1/render.pb.h"
#include "request/effective_scene.h"
#include "request/material_kinds.h"
#include "trace/photon_tracer.h"

namespace gobo {
inline namespace techniques {

struct CausticPlan {
  uint32_t photons = 0;  ///< 0: none are made
  float radius = 0;      ///< of the first pass, metres
  std::string pruned;    ///< why none are made; empty when nobody asked and there is none to make
  bool lost = false;     ///< the scene has such light, and it is left out
};
CausticPlan causticPlan(const Scene& scene, const MaterialKinds& kinds, const v1::Integrator& integrator);

/// One node's work: the delta lights by relight group, or one light that is edited inside its cluster (group -1).
struct CausticTask {
  std::string label;
  CausticSettings settings;
  std::vector<int> lights;
  std::vector<int> groups;    ///< relight group of each slot group
  std::vector<Vec3> weights;  ///< of its planes in the beauty
};
/// `path`: camera, size, bounces, block size, seed; its groups are filled in.
std::vector<CausticTask> causticTasks(const CausticPlan& plan, const EffectiveScene& effective, const RelightGroups& relight, const PathTracerSettings& path,
                                      bool byLobe);
/// What is wrong with `passes` passes, for reports.
std::string causticNote(const CausticPlan& plan, uint32_t passes);

}  // namespace techniques
}  // namespace gobo
