// SPDX-License-Identifier: Apache-2.0
// A shadow technique on a scene, planned as the engine plans it and run node by node: no store, nothing between the test and the nodes.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "filters/shadow_technique.h"
#include "filters/tinted_visibility.h"
#include "terms/gbuffer.h"
#include "trace/accel.h"
#include "trace/straight.h"

namespace gobo::test {

struct ShadowRun {
  Status status;  ///< of planning; runs are CHECKed
  Graph graph;
  NodeId gbuffer = -1, visibility = -1;
  std::vector<TermPtr> terms;  ///< by node
  std::vector<uint64_t> rays;
  bool ok() const { return status.ok(); }
  std::span<const float> V() const { return terms.at(size_t(visibility))->floats("V"); }
  const Term& view() const { return *terms.at(size_t(gbuffer)); }
  size_t size() const { return view().extent().elements(); }
  Vec3 at(const char* plane, size_t i) const {
    const auto p = view().floats(plane);
    return Vec3(p[3 * i], p[3 * i + 1], p[3 * i + 2]);
  }
  bool surface(size_t i) const { return view().plane<uint32_t>("instance")[i] != ~0u; }
  /// The first node of a type, or null.
  TermPtr term(const std::string& type) const {
    for (NodeId id = 0; id < graph.size(); ++id)
      if (graph.at(id).node->type() == type) return terms[size_t(id)];
    return nullptr;
  }
  uint64_t raysOf(const std::string& type) const {
    uint64_t sum = 0;
    for (NodeId id = 0; id < graph.size(); ++id)
      if (graph.at(id).node->type() == type) sum += rays[size_t(id)];
    return sum;
  }
};

struct ShadowPicture {
  int width = 64, height = 48, threads = 2;
};

/// `light` of `scene`, seen by the scene's first camera, by what `plan` adds.
inline ShadowRun runPlanned(const ScenePtr& scene, const std::function<Result<NodeId>(Graph&, const ShadowInput&)>& plan, const ShadowPicture& picture = {},
                            int light = 0) {
  ShadowRun r;
  GraphNode g;
  g.node = makeGBufferNode({scene->cameras.at(0), picture.width, picture.height, 1});
  g.scene = scene;
  r.gbuffer = r.graph.add(std::move(g));
  ShadowInput input;
  input.scene = scene;
  input.light = light;
  input.gbuffer = r.gbuffer;
  input.camera = scene->cameras.at(0);
  input.width = picture.width;
  input.height = picture.height;
  input.clear = hasClearSurfaces(*scene);
  auto id = plan(r.graph, input);
  r.status = id.status();
  if (!id.ok()) return r;
  r.visibility = *id;
  const TaskArena arena(picture.threads);
  static AccelCache accels;
  for (NodeId n = 0; n < r.graph.size(); ++n) {
    const GraphNode& node = r.graph.at(n);
    RunContext ctx;
    RunCounters counters;
    ctx.arena = &arena;
    ctx.counters = &counters;
    for (NodeId i : node.inputs) ctx.inputs.push_back(r.terms[size_t(i)]);
    std::optional<SceneView> view;
    if (node.scene) {
      view.emplace(*node.scene, node.node->traits().facets, node.lights);
      ctx.scene = &*view;
      ctx.accels = &accels;
    }
    auto term = runNode(*node.node, ctx);
    if (!term.ok()) std::cerr << node.label << ": " << term.status().toString() << std::endl;
    GOBO_CHECK(term.ok());
    r.terms.push_back(*term);
    r.rays.push_back(counters.rays);
  }
  return r;
}

/// The same by a technique.
inline ShadowRun runShadow(const ScenePtr& scene, const v1::ShadowTechnique& technique, const ShadowPicture& picture = {}, int light = 0) {
  const ShadowTechniqueEntry* entry = findShadowTechnique(technique.technique_case());
  GOBO_CHECK(entry != nullptr);
  const auto plan = [&](Graph& graph, const ShadowInput& input) -> Result<NodeId> {
    GOBO_ASSIGN(const NodeId id, entry->plan(graph, input, technique));
    return entry->usesMap ? planTint(graph, input, id) : id;
  };
  return runPlanned(scene, plan, picture, light);
}

/// Every technique that reads a depth map, at its defaults.
struct NamedTechnique {
  std::string name;
  v1::ShadowTechnique technique;
};
inline std::vector<NamedTechnique> mapTechniques() {
  std::vector<NamedTechnique> all;
  for (const ShadowTechniqueEntry& e : shadowTechniques()) {
    if (!e.usesMap) continue;
    v1::ShadowTechnique t;
    const auto* field = v1::ShadowTechnique::descriptor()->FindFieldByNumber(int(e.key));
    GOBO_CHECK(field != nullptr);
    t.GetReflection()->MutableMessage(&t, field);
    all.push_back({e.name, t});
  }
  return all;
}
inline v1::ShadowTechnique mapTechnique(const std::string& name) {
  for (const NamedTechnique& t : mapTechniques())
    if (t.name == name) return t.technique;
  GOBO_CHECK(false);
  return {};
}
inline v1::ShadowTechnique rayTraced(uint32_t samples = 1) {
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(samples);
  return t;
}

}  // namespace gobo::test
