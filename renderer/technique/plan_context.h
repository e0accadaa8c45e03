// SPDX-License-Identifier: Apache-2.0
// PlanContext: what a technique sees of a plan in the making, and by what it adds to it. One per plan; not thread-safe.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gobo/v1/render.pb.h"
#include "request/effective_scene.h"
#include "request/material_kinds.h"
#include "technique/cover.h"
#include "terms/direct_unoccluded.h"
#include "terms/gbuffer.h"
#include "terms/graph.h"
#include "trace/path_tracer.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace technique {

/// What traced a state, for who wants its samples one by one.
struct TracedPaths {
  PathTracerSettings settings;
  int streams = 1;
  std::vector<int> lights;
  ScenePtr scene;
  std::string label;
};

/// A weighted plane of the beauty, and what it holds.
struct Contribution {
  NodeId node = -1;
  std::string plane;
  Vec3 weight{1.0f};
  PathSet paths = PathSet::None;
  int group = -1;     ///< relight group; -1: no light's, or of several
  NodeId state = -1;  ///< path tracing state that it is the mean of, and the slot there; -1: something else
  int slot = 0;
  std::shared_ptr<const TracedPaths> traced;  ///< what brought the slot's light; null: something else
  std::string curvature;                      ///< plane of the same node: how this light bends along surfaces (trace/curvature_sums.h); empty: unknown
  std::vector<int> together;                  ///< relight groups that share the plane, where they are several
};

struct PixelWindow {
  int x = 0, y = 0, width = 0, height = 0;
};

/// The technique that takes over what the camera sees of the environment (techniques/background).
inline constexpr const char* kBackgroundTechnique = "background";

/// What the asked outputs need told apart, and of the camera's first hits. curvature: indirect light by lobe, with how fast it may change along a surface.
struct Distinctions {
  bool classes = false, lobes = false, variance = false, curvature = false;
  GBufferPart seen = GBufferPart::Hits;
};

struct PlanInput {
  const v1::RenderRequest& request;  ///< resolved
  const EffectiveScene& effective;
  const RelightGroups& groups;
  uint32_t passes = 1;  ///< of path tracing nodes (trace/sample_passes.h)
  PixelWindow window;   ///< of the picture; of no width: all of it
  Distinctions apart;
  StopToken stop;
  /// Evaluates a node while planning, whose result decides what follows. Empty: this plan only bounds what the real one will hold, and no node
  /// runs for it.
  std::function<Result<TermPtr>(const Graph&, NodeId)> expand;
  /// Numbers of traced paths, where other pictures have the rest of their sequence; those of the request where there are none.
  SequenceShare share = {};
  uint64_t sharedSeed = 0;
  bool lensAtTimes = false;  ///< the camera has a lens in some moment of the picture, if not in this one
};

class PlanContext {
 public:
  PlanContext(const PlanInput& input, Graph& graph);
  /// The same question of another picture (`request`, which must outlive it), planned into the same graph: of all of its window, in numbers of its own, and
  /// what it brings is not brought here. For techniques that look before they choose.
  PlanContext otherPicture(const v1::RenderRequest& request, uint32_t passes, const Distinctions& apart) const;

  // The question
  const v1::RenderRequest& request() const { return in_.request; }
  const EffectiveScene& effective() const { return in_.effective; }
  const ScenePtr& scene() const { return in_.effective.scene; }
  const RelightGroups& groups() const { return in_.groups; }
  const MaterialKinds& kinds() const { return kinds_; }
  const GBufferSettings& view() const { return view_; }
  uint32_t passes() const { return in_.passes; }
  const SequenceShare& share() const { return in_.share; }
  /// Of traced paths.
  uint64_t pathSeed() const { return in_.share.of > 1 ? in_.sharedSeed : in_.request.seed(); }
  bool lensAtTimes() const { return in_.lensAtTimes || view_.camera.hasLens(); }
  const Distinctions& apart() const { return in_.apart; }
  const StopToken& stop() const { return in_.stop; }
  /// Indirect light is asked for.
  bool indirect() const { return in_.request.integrator().indirect() && in_.request.integrator().max_bounces() > 0; }
  /// Gain of a group of one light; 1 for clusters, whose edits are contributions of their own.
  Vec3 groupGain(int group) const;
  std::string groupName(int group) const;
  /// The parts that direct light is planned in.
  std::vector<LobePart> lobes() const;
  /// Whether the camera is inside a volume, which no technique but path tracing looks out of. O(triangles) when first asked, where there are volumes.
  bool cameraInVolume();

  // Nodes
  Graph& graph() { return graph_; }
  NodeId gbuffer();
  NodeId surface();
  NodeId source(NodePtr node, std::vector<NodeId> inputs, std::vector<int> lights, std::string label, const ScenePtr& scene, bool transient = false);
  NodeId filter(NodePtr node, std::vector<NodeId> inputs, std::string label);
  /// What `node` would be if the extendable nodes behind it had only so many passes; the same node if none is.
  NodeId atPasses(NodeId node, uint32_t passes);
  /// The node's result, now: it decides what is planned next. Null while only bounding(): then plan for the largest that it may say.
  Result<TermPtr> expand(NodeId node);
  bool bounding() const { return !in_.expand; }
  const std::vector<NodeId>& expanded() const { return expanded_; }
  /// While bounding: bytes that may be held beside what the nodes say.
  void reserve(uint64_t bytes) { reserved_ += bytes; }
  uint64_t reserved() const { return reserved_; }

  /// Radiance term, plane "s0": share of each pixel's samples that see a transparent background. -1: there is none.
  NodeId clear() const { return clear_; }
  void setClear(NodeId node) { clear_ = node; }

  // What it brings
  Cover& cover() { return cover_; }
  const Cover& cover() const { return cover_; }
  /// Of weight 0: left out.
  void add(Contribution c);
  const std::vector<Contribution>& contributions() const { return contributions_; }
  /// Light below zero that a technique cut off: what is to be added to its planes to have it again is the negative of these.
  void addNegative(Contribution c) { negative_.push_back(std::move(c)); }
  const std::vector<Contribution>& negative() const { return negative_; }
  /// While claiming: these paths of a light of a cluster are brought at the gains that the request gives it, and not at the cluster's.
  void claimAtGains(int light, PathSet paths) { atGains_.resize(scene()->lights.size(), PathSet::None), atGains_[size_t(light)] = paths; }
  PathSet atGains(int light) const { return atGains_.empty() ? PathSet::None : atGains_[size_t(light)]; }
  /// Path tracing states of the beauty.
  const std::vector<NodeId>& states() const { return states_; }
  void prune(std::string label, std::string reason, bool approximate = false) { graph_.prune(std::move(label), std::move(reason), approximate); }
  void warn(const std::string& text);
  const std::vector<std::string>& warnings() const { return warnings_; }
  /// Paths that nothing finds, in words.
  void miss(std::string what) { missing_.push_back(std::move(what)); }
  const std::vector<std::string>& missing() const { return missing_; }

 private:
  PlanInput in_;
  Graph& graph_;
  MaterialKinds kinds_;
  GBufferSettings view_;
  Cover cover_;
  int cameraInVolume_ = -1;  // not asked yet
  NodeId clear_ = -1;
  std::vector<Contribution> contributions_, negative_;
  std::vector<PathSet> atGains_;
  std::vector<NodeId> states_, expanded_;
  std::vector<std::string> warnings_, missing_;
  uint64_t reserved_ = 0;
};

/// "label:diffuse" for a part.
std::string withLobe(std::string label, LobePart lobe);
/// The part of direct light at the seen side that a lobe holds.
PathSet front(LobePart lobe);

}  // namespace technique
}  // namespace gobo
