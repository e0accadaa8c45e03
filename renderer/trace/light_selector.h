// SPDX-License-Identifier: Apache-2.0
// LightSelector: which light next-event estimation asks at a vertex, and with which probability. Immutable; any thread.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/scene.h"
#include "trace/light_tree.h"

namespace gobo {
inline namespace trace {

enum class LightSelection : uint8_t { Tree, Power, Uniform };

class LightSelector {
 public:
  /// nominal[k]: radiometric scale of light k of the view's subset; its luminance is the importance. Lights of luminance 0 are
  /// never drawn. Needs facets Topology, Pose, Emission, Coverage, LightShape, Environment.
  /// `stop` is polled every few thousand triangles, texels or lights; a selector whose building it ended is not to be used.
  void build(const SceneView& view, const std::vector<Vec3>& nominal, LightSelection selection, const StopToken& stop = {});
  /// Draws k (an index into the view's subset), or -1 if no light can contribute. n: see LightBounds::importance.
  int sample(const Vec3& p, const Vec3* n, float u, float& probability) const {
    if (only_ >= 0) {
      probability = 1.0f;
      return only_;
    }
    return sampleMany(p, n, u, probability);
  }
  float probability(const Vec3& p, const Vec3* n, int k) const {
    if (only_ >= 0) return k == only_ ? 1.0f : 0.0f;
    return probabilityMany(p, n, k);
  }
  /// The number of lights that can be drawn.
  int count() const { return count_; }

 private:
  int sampleMany(const Vec3& p, const Vec3* n, float u, float& probability) const;
  float probabilityMany(const Vec3& p, const Vec3* n, int k) const;
  int only_ = -1, count_ = 0;
  LightTree tree_;
  float treeShare_ = 0.0f;      // probability of asking the tree; the rest goes to the table
  std::vector<int> finite_;     // tree index -> k
  std::vector<int> treeIndex_;  // k -> tree index, -1 for lights of the table
  struct Entry {
    float keep = 1.0f;
    int alias = 0;
    int k = 0;
  };
  std::vector<Entry> table_;             // alias table (Vose 1991) over infinite lights, or over all lights without a tree
  std::vector<float> tableProbability_;  // by k
};

}  // namespace trace
}  // namespace gobo
