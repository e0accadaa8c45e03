// SPDX-License-Identifier: Apache-2.0
#include "techniques/path_traced/trace_paths.h"

#include <algorithm>

#include "filters/composite.h"
#include "filters/sample_statistics.h"
#include "filters/state_difference.h"
#include "terms/path_trace.h"
#include "trace/reach.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace techniques {

namespace {

struct PathTraceJob {
  std::string label;
  PathSet paths = PathSet::None;
  std::vector<int> lights;
  std::vector<Vec3> nominal;   // by light
  std::vector<int> slotGroup;  // by light: index into groups
  std::vector<int> groups;     // relight groups, ascending
  std::vector<Vec3> weights;   // by group
  bool unlit = false;
};

PathClass classesOf(PathSet paths) {
  return (overlaps(paths, PathSet::Emission) ? PathClass::Emission : PathClass::None) |
         (overlaps(paths, PathSet::Direct) ? PathClass::Direct : PathClass::None) |
         (overlaps(paths, PathSet::Indirect) ? PathClass::Indirect : PathClass::None);
}

LightSelection selectionOf(const v1::Integrator& integrator) {
  switch (integrator.light_selection()) {
    case v1::Integrator::UNIFORM: return LightSelection::Uniform;
    case v1::Integrator::POWER: return LightSelection::Power;
    default: return LightSelection::Tree;
  }
}

/// Slots of the split: emission, direct, indirect, the latter two by lobe if asked for.
PathSet pathsOfSlot(SplitMode split, int slot, PathSet all) {
  if (split == SplitMode::Combined) return all;
  if (slot == 0) return PathSet::Emission;
  if (slot >= kCurvatureSlot) return PathSet::None;
  if (split == SplitMode::DirectIndirect) return slot == 1 ? PathSet::Direct : PathSet::Indirect;
  return (slot <= 2 ? PathSet::Direct : PathSet::Indirect) & (slot % 2 ? PathSet::Diffuse : PathSet::Specular);
}

int streamsOf(const PlanContext& c) { return c.apart().variance ? kVarianceStreams : 1; }

/// The state without what the camera sees of the environment, where the background is another (request/background.h).
Result<NodeId> withoutHidden(PlanContext& c, const PathTraceJob& job, int slotsPerGroup, NodeId state) {
  const int hidden = c.effective().background.hidden;
  const auto at = std::find(job.lights.begin(), job.lights.end(), hidden);
  if (hidden < 0 || at == job.lights.end() || !overlaps(job.paths, PathSet::Emission)) return state;
  const size_t k = size_t(at - job.lights.begin());
  GOBO_ASSIGN(const NodeId seen, traceSeen(c, hidden, job.nominal[k], c.scene(), "environment seen"));
  const int slots = slotsPerGroup * int(job.groups.size());
  return c.filter(makeStateDifferenceNode(c.view().width, c.view().height, slots, job.slotGroup[k] * slotsPerGroup, streamsOf(c)), {state, seen},
                  job.label + " without environment seen");
}

Status addPathTrace(PlanContext& c, const PathTraceJob& job) {
  const PathClass cover = classesOf(job.paths);
  PathTracerSettings s = pathTracerSettings(c, cover);
  s.seed = c.pathSeed();
  s.behindOnly = overlaps(job.paths, PathSet::Direct) && !overlaps(job.paths, PathSet::Front);
  if (s.behindOnly && overlaps(job.paths, PathSet::Indirect)) return internalError("paths that end on a front bring no indirect light (" + job.label + ")");
  s.unlit = job.unlit;
  const int classes = has(cover, PathClass::Emission) + has(cover, PathClass::Direct) + has(cover, PathClass::Indirect);
  const bool scatters = has(cover, PathClass::Direct) || has(cover, PathClass::Indirect);
  const PathSet reached = s.behindOnly ? pathSet(cover) - PathSet::Front : pathSet(cover);
  const PathSet none = c.kinds().translucent ? PathSet::None : PathSet::Behind;  // no surface lets any through
  const bool lobes = (c.apart().lobes && scatters) || reached - job.paths - none != PathSet::None;
  s.split = c.apart().curvature && has(cover, PathClass::Indirect)  ? SplitMode::ByLobeAndCurvature
            : lobes                                                 ? SplitMode::ByLobe
            : (c.apart().classes || c.apart().lobes) && classes > 1 ? SplitMode::DirectIndirect
                                                                    : SplitMode::Combined;
  s.selection = selectionOf(c.request().integrator());
  s.sampler = samplerOf(c.request().integrator());
  s.groups = int(job.groups.size());
  s.groupOf = job.slotGroup;
  s.nominal = job.nominal;
  const auto traced = std::make_shared<const TracedPaths>(TracedPaths{s, streamsOf(c), job.lights, c.scene(), job.label});
  GraphNode n{makePathTraceNode(s, streamsOf(c), c.view(), c.share()), {}, job.lights, job.label, c.passes(), c.scene()};
  const int per = slotsPerGroup(s.split, s.maxBounces);
  GOBO_ASSIGN(const NodeId state, withoutHidden(c, job, per, c.graph().add(std::move(n))));
  const NodeId mean = c.filter(makeResolveNode(c.view().width, c.view().height, per * s.groups), {state}, job.label + ":mean");
  for (size_t g = 0; g < job.groups.size(); ++g) {
    for (int k = 0; k < per; ++k) {
      const PathSet held = (pathsOfSlot(s.split, k, reached) & reached) - none;
      if (!overlaps(held, job.paths)) continue;
      if (!contains(job.paths, held)) return internalError("path tracing cannot leave out " + names(held - job.paths) + " (" + job.label + ")");
      const int slot = int(g) * per + k;
      Contribution light{mean, "s" + std::to_string(slot), job.weights[g], held, job.groups[g], state, slot, traced, {}, {}};
      if (s.split == SplitMode::ByLobeAndCurvature && contains(PathSet::Indirect, held)) light.curvature = "s" + std::to_string(slot + 2);
      c.add(std::move(light));
    }
  }
  return {};
}

}  // namespace

SamplerKind samplerOf(const v1::Integrator& integrator) {
  switch (integrator.sampler()) {
    case v1::Integrator::HALTON: return SamplerKind::Halton;
    case v1::Integrator::INDEPENDENT: return SamplerKind::Independent;
    default: return SamplerKind::Sobol;
  }
}

PathTracerSettings pathTracerSettings(const PlanContext& c, PathClass cover) {
  PathTracerSettings s;
  const v1::Integrator& i = c.request().integrator();
  s.camera = c.view().camera;
  s.width = c.view().filmWidth();
  s.height = c.view().filmHeight();
  s.blockSize = int(kBlockSamples);
  s.viewSamples = i.at_view_samples() ? c.view().viewSamples : 0;
  s.maxBounces = has(cover, PathClass::Indirect) ? int(i.max_bounces()) : 0;
  s.rouletteStart = int(i.russian_roulette_start());
  s.seed = c.request().seed();
  s.cover = cover;
  return s;
}

Status tracePaths(PlanContext& c, const char* technique, const std::vector<int>& lights, PathSet paths, const std::string& label) {
  PathTraceJob job;
  job.label = label;
  job.paths = paths;
  job.lights = lights;
  const RelightGroups& groups = c.groups();
  for (int l : lights) job.groups.push_back(groups.groupOf[size_t(l)]);
  std::sort(job.groups.begin(), job.groups.end());
  job.groups.erase(std::unique(job.groups.begin(), job.groups.end()), job.groups.end());
  for (int l : lights) {
    job.slotGroup.push_back(int(std::lower_bound(job.groups.begin(), job.groups.end(), groups.groupOf[size_t(l)]) - job.groups.begin()));
    job.nominal.push_back(groups.nominal[size_t(l)]);
  }
  for (int g : job.groups) job.weights.push_back(c.groupGain(g));
  for (int l : lights) GOBO_TRY(c.cover().bring(l, paths - c.cover().claimedBy(l, kBackgroundTechnique), technique));
  // A lobe of which only what is behind is asked for, beside another's front: the front's slots hold both sides.
  PathSet behind = PathSet::None;
  for (const PathSet lobe : {PathSet::Diffuse, PathSet::Specular})
    if (c.kinds().translucent && overlaps(paths, PathSet::Front) && !overlaps(paths, PathSet::Front & lobe)) behind = behind | (paths & PathSet::Behind & lobe);
  if (behind != PathSet::None) {
    PathTraceJob apart = job;
    apart.paths = behind;
    apart.label += " behind";
    job.paths = paths - behind;
    GOBO_TRY(addPathTrace(c, job));
    return addPathTrace(c, apart);
  }
  return addPathTrace(c, job);
}

Status traceDifference(PlanContext& c, int light, const Vec3& weight) {
  const Light& l = c.scene()->lights[size_t(light)];
  PathTraceJob job;
  job.label = "difference:" + l.name;
  // All classes at once, whatever technique the cluster uses for its own direct light.
  job.paths = c.cover().wanted() - c.cover().claimedBy(light, kBackgroundTechnique) - c.atGains(light);
  if (job.paths == PathSet::None || (job.paths == PathSet::Emission && !rayReaches(l.shape, l.cameraVisible, Receiver::Camera, Passage::Open))) return {};
  job.lights = {light};
  job.nominal = {Vec3(nominalScalar(l))};
  job.slotGroup = {0};
  job.groups = {c.groups().groupOf[size_t(light)]};
  job.weights = {weight};
  const PathSet behind = job.paths & PathSet::Behind;
  if (behind == PathSet::None || overlaps(job.paths, PathSet::Front) || !overlaps(job.paths, PathSet::Indirect)) return addPathTrace(c, job);
  // The front is another technique's: paths for what is behind alone end there, and those of indirect light go on.
  PathTraceJob apart = job;
  apart.paths = behind;
  apart.label += " behind";
  job.paths = job.paths - behind;
  GOBO_TRY(addPathTrace(c, job));
  return addPathTrace(c, apart);
}

Result<NodeId> traceSeen(PlanContext& c, int light, const Vec3& nominal, const ScenePtr& scene, const std::string& label) {
  PathTracerSettings s = pathTracerSettings(c, PathClass::Emission);
  s.seed = c.pathSeed();
  s.sampler = samplerOf(c.request().integrator());
  s.groupOf = {0};
  s.nominal = {nominal};
  return c.graph().add({makePathTraceNode(s, streamsOf(c), c.view(), c.share()), {}, {light}, label, c.passes(), scene});
}

Status traceUnlit(PlanContext& c) {
  PathTraceJob job;
  job.label = "unlit";
  job.paths = PathSet::Emission | (c.indirect() ? PathSet::Indirect : PathSet::None);
  job.groups = {-1};
  job.weights = {Vec3(1.0f)};
  job.unlit = true;
  return addPathTrace(c, job);
}

}  // namespace techniques
}  // namespace gobo
