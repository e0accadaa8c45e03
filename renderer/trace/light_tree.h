// SPDX-License-Identifier: Apache-2.0
// LightTree: a bounding volume hierarchy over finite lights that picks one with probability close to its contribution
// (Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"; the conservative importance
// is pbrt-v4's, eq. 12.x of section 12.6.3). Immutable after build; any thread may sample. Cost: O(log n) node pairs a draw,
// O(depth) for the probability of a given light.
#pragma once

#include <cstdint>
#include <vector>

#include "base/stop.h"
#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// Bounds of one light or a cluster: where it is, which way its normals and its emission go, how much it emits (W, any scale).
struct LightBounds {
  Vec3 lo{3.0e38f}, hi{-3.0e38f};
  Vec3 axis{0, 0, 1};
  float cosNormals = 1.0f;    ///< cosine of the half angle of the cone of normals around `axis`
  float cosEmission = -1.0f;  ///< cosine of the emission angle beyond the normals' cone (pi/2 for a one-sided area light)
  float power = 0.0f;
  bool twoSided = false;
  static LightBounds join(const LightBounds& a, const LightBounds& b);
  /// Conservative importance at p; n (unit) is the receiver's normal, or null where light may arrive from both sides.
  /// 0 only if no light of the cluster can reach a receiver facing n.
  float importance(const Vec3& p, const Vec3* n) const;
};

class LightTree {
 public:
  /// bounds[i].power must be >= 0; lights of power 0 are left out and never drawn.
  /// `stop` is polled at every node of many lights; a tree whose building it ended is not to be used.
  void build(const std::vector<LightBounds>& bounds, const StopToken& stop = {});
  bool empty() const { return nodes_.empty() && only_ < 0; }
  /// Draws a light for a receiver: its index into `bounds`, or -1 if none can contribute. u in [0,1).
  int sample(const Vec3& p, const Vec3* n, float u, float& probability) const;
  /// The probability with which sample(p, n, .) gives `light`.
  float probability(const Vec3& p, const Vec3* n, int light) const;
  const LightBounds& bounds() const { return root_; }

 private:
  /// LightBounds as importance() wants it: 48 bytes, nothing left to derive. Both children of a node lie together.
  struct Cluster {
    Vec3 centre{0.0f};
    float radius2 = 0;
    Vec3 axis{0, 0, 1};
    float cosNormals = 1, sinNormals = 0, cosEmission = -1, power = 0;
    bool twoSided = false, everywhere = false;  // everywhere: some normal points at every receiver
    Cluster() = default;
    explicit Cluster(const LightBounds& b);
    float importance(const Vec3& p, const Vec3* n) const;
  };
  friend struct LightBounds;
  struct Node {
    Cluster child[2];
    int next[2] = {-1, -1};  // node, or ~light
    int parent = -1;         // 2 * node + which child
  };
  LightBounds root_;
  std::vector<Node> nodes_;  // inner nodes; none when there is one light
  int only_ = -1;            // the light when there is one
  std::vector<int> leafOf_;  // by light: 2 * node + which child; -1: power 0
  LightBounds buildNode(const std::vector<LightBounds>& bounds, std::vector<int>& order, int begin, int end, int parent, const StopToken& stop);
};

}  // namespace trace
}  // namespace gobo
