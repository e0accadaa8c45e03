// SPDX-License-Identifier: Apache-2.0
#include "techniques/path_traced/technique.h"

#include <map>

#include "techniques/path_traced/trace_paths.h"
#include "trace/reach.h"

namespace gobo {
inline namespace techniques {

namespace {

bool cameraReaches(const Light& light) { return rayReaches(light.shape, light.cameraVisible, Receiver::Camera, Passage::Open); }

std::string labelOf(PathSet paths) {
  if (paths == PathSet::Emission) return "emission";
  if (contains(paths, PathSet::Direct)) return "direct";
  return "rest (" + names(paths) + ")";
}

class PathTraced final : public Technique {
 public:
  const char* name() const override { return "path_traced"; }
  bool seesThroughLens() const override { return true; }

  Status plan(PlanContext& c) const override {
    if (c.kinds().unlit) GOBO_TRY(traceUnlit(c));
    const std::vector<Light>& lights = c.scene()->lights;
    if (lights.empty()) return {};
    if (!c.indirect()) c.prune("indirect", c.request().integrator().indirect() ? "max_bounces is 0" : "integrator.indirect is false", true);
    std::map<PathSet, std::vector<int>> indirect;                       // by what is left of it
    std::map<PathSet, std::vector<int>, std::greater<PathSet>> others;  // more first
    std::vector<int> all;
    bool alone = true;
    for (int l = 0; l < int(lights.size()); ++l) {
      // The background's part is traced along and taken off: the nodes are those of a picture that shows the map.
      const PathSet background = c.cover().claimedBy(l, kBackgroundTechnique), rest = c.cover().rest(l) | background;
      all.push_back(l);
      alone = alone && rest == c.cover().wanted();
      GOBO_TRY(c.cover().claim(l, rest - background, name()));
      if (overlaps(rest, PathSet::Indirect)) indirect[rest & PathSet::Indirect].push_back(l);
      PathSet other = rest - PathSet::Indirect;
      if (other == PathSet::Emission && !cameraReaches(lights[size_t(l)])) {
        GOBO_TRY(c.cover().bring(l, other - background, name()));  // there is none
        other = PathSet::None;
      }
      if (other != PathSet::None) others[other].push_back(l);
    }
    // Samples one by one are wanted of indirect light alone: what they are taken from is not traced as a whole too.
    if (alone && !c.request().denoise().has_outliers()) { return tracePaths(c, name(), all, c.cover().wanted(), "path_trace"); }
    for (const auto& [paths, of] : indirect) GOBO_TRY(tracePaths(c, name(), of, paths, "indirect"));
    for (const auto& [paths, of] : others) GOBO_TRY(tracePaths(c, name(), of, paths, labelOf(paths)));
    return {};
  }
};

class ClusterDifferences final : public Technique {
 public:
  const char* name() const override { return "cluster_differences"; }
  bool seesThroughLens() const override { return true; }

  Status plan(PlanContext& c) const override {
    for (size_t l = 0; l < c.scene()->lights.size(); ++l) {
      const Vec3 weight = c.effective().gainChanges[l];
      if (weight == Vec3(0.0f) || c.groups().single(c.groups().groupOf[l])) continue;
      GOBO_TRY(traceDifference(c, int(l), weight));
    }
    return {};
  }
};

}  // namespace

const Technique& pathTraced() {
  static const PathTraced technique;
  return technique;
}

const Technique& clusterDifferences() {
  static const ClusterDifferences technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo
