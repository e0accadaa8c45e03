// SPDX-License-Identifier: Apache-2.0
#include "technique/plan_context.h"

#include <algorithm>

#include "terms/surface.h"
#include "trace/camera_media.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace technique {

namespace {
PathSet wantedOf(const v1::RenderRequest& request) {
  const bool indirect = request.integrator().indirect() && request.integrator().max_bounces() > 0;
  return PathSet::Emission | PathSet::Direct | (indirect ? PathSet::Indirect : PathSet::None);
}
}  // namespace

PlanContext::PlanContext(const PlanInput& input, Graph& graph)
    : in_(input), graph_(graph), kinds_(materialKinds(*input.effective.scene)), cover_(input.effective.scene->lights.size(), wantedOf(input.request)) {
  view_.camera = input.effective.camera;
  view_.width = int(input.request.width());
  view_.height = int(input.request.height());
  view_.viewSamples = int(input.request.view_samples());
  view_.part = input.apart.seen;
  if (input.window.width) {
    view_.place = {input.window.x, input.window.y, view_.width, view_.height};
    view_.width = input.window.width;
    view_.height = input.window.height;
  }
}

PlanContext PlanContext::otherPicture(const v1::RenderRequest& request, uint32_t passes, const Distinctions& apart) const {
  return PlanContext({request, in_.effective, in_.groups, passes, {}, apart, in_.stop, in_.expand, {}, 0, in_.lensAtTimes}, graph_);
}

Vec3 PlanContext::groupGain(int group) const {
  const auto& members = in_.groups.members[size_t(group)];
  return members.size() == 1 ? in_.effective.gains[size_t(members[0])] : Vec3(in_.groups.scaleOf(group));
}

std::string PlanContext::groupName(int group) const {
  const auto& members = in_.groups.members[size_t(group)];
  return members.size() == 1 ? scene()->lights[size_t(members[0])].name : "cluster of " + std::to_string(members.size());
}

std::vector<LobePart> PlanContext::lobes() const { return in_.apart.lobes ? std::vector{LobePart::Diffuse, LobePart::Specular} : std::vector{LobePart::Both}; }

bool PlanContext::cameraInVolume() {
  if (!kinds_.volumes) return false;
  if (cameraInVolume_ < 0) {
    const std::vector<int> none;
    cameraInVolume_ =
        volumesAround(SceneView(*scene(), Facet::Topology | Facet::Pose | Facet::Bsdf, none), cameraPoint(view_.camera), in_.stop).empty() ? 0 : 1;
  }
  return cameraInVolume_ > 0;
}

NodeId PlanContext::gbuffer() { return source(makeGBufferNode(view_), {}, {}, "gbuffer", scene()); }
NodeId PlanContext::surface() { return source(makeSurfaceNode(view_), {gbuffer()}, {}, "surface", scene()); }

NodeId PlanContext::source(NodePtr node, std::vector<NodeId> inputs, std::vector<int> lights, std::string label, const ScenePtr& scene, bool transient) {
  return graph_.add({std::move(node), std::move(inputs), std::move(lights), std::move(label), 0, scene, transient});
}
NodeId PlanContext::filter(NodePtr node, std::vector<NodeId> inputs, std::string label) {
  return graph_.add({std::move(node), std::move(inputs), {}, std::move(label)});
}

NodeId PlanContext::atPasses(NodeId node, uint32_t passes) {
  GraphNode n = graph_.at(node);
  bool changed = false;
  for (NodeId& input : n.inputs) {
    const NodeId other = atPasses(input, passes);
    changed = changed || other != input;
    input = other;
  }
  if (n.node->traits().extendable && n.blocks != passes) {
    n.blocks = passes;
    changed = true;
  }
  if (!changed) return node;
  n.label += " of " + std::to_string(samplesOf(passes)) + (samplesOf(passes) == 1 ? " sample" : " samples");
  return graph_.add(std::move(n));
}

Result<TermPtr> PlanContext::expand(NodeId node) {
  expanded_.push_back(node);
  GOBO_TRY(graph_.wiring());
  if (bounding()) return TermPtr();
  return in_.expand(graph_, node);
}

void PlanContext::add(Contribution c) {
  if (c.state >= 0 && std::find(states_.begin(), states_.end(), c.state) == states_.end()) states_.push_back(c.state);
  if (c.weight != Vec3(0.0f)) contributions_.push_back(std::move(c));
}

void PlanContext::warn(const std::string& text) {
  if (std::find(warnings_.begin(), warnings_.end(), text) == warnings_.end()) warnings_.push_back(text);
}

std::string withLobe(std::string label, LobePart lobe) {
  return lobe == LobePart::Both ? label : label + (lobe == LobePart::Diffuse ? ":diffuse" : ":specular");
}

PathSet front(LobePart lobe) { return lobe == LobePart::Both ? PathSet::Front : lobe == LobePart::Diffuse ? PathSet::FrontDiffuse : PathSet::FrontSpecular; }

}  // namespace technique
}  // namespace gobo
