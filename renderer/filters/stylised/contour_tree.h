// SPDX-License-Identifier: Apache-2.0
// What the points of a small patch have to add up of a contour, within a stated error: far pieces of contour as one source each, near ones as they are.
//
// A piece of contour with length l, centroid c and farthest point R from it, seen from a distance d, is replaced by the expansion of the integrand about c to
// second order,
//              l r^-p (1 + p/2 ((p + 2) r^T M r / r^2 - tr M) / r^2),  r = x - c, M the piece's second moment by length, divided by l.
// The rest is at most d^-p e(R/d), e(q) = (1 - q)^-p - 1 - p q - p (p + 1) q^2 / 2, by the generating function of Gegenbauer polynomials. A piece is taken
// whole where that is at most half of `error` of its own d^-p, or of its share by length in a lower bound of the whole sum: what is many times as far as the
// nearest contour hardly counts (|x - y|^-8). Segments that are too near for that become points of a Gauss rule whose own bound holds, or stay segments.
// `error` bounds the sum; D has 1/(p - 1) of it (LOCAL). Guard: pieces carry the cone of their normals; where cones do not decide which of a piece's segments
// points of the patch see, each decides for itself. Pieces that are too near for a large patch are handed on to its parts, which do not start from the root.
// Cost: building O(n log n), 170 bytes a node, about n/2 nodes; a patch some tens of sources. Built by one thread; ties are broken by the segments' order.
#pragma once

#include <array>

#include "filters/stylised/averaged_distance.h"

namespace gobo {
inline namespace filters {

/// Sources by component, for loops over them.
struct PatchSources {
  struct Source {
    DVec3 at{0.0};
    double length = 0;               ///< weight
    std::array<double, 6> moment{};  ///< xx yy zz xy xz yz, over length; 0 for points
    bool point = true;
  };
  std::vector<Source> sources;
  std::vector<uint32_t> near;     ///< segments that every point of the patch sees
  std::vector<uint32_t> guarded;  ///< segments that some may see
  double length = 0;              ///< of what every point sees
  std::vector<int> open;          ///< of the search
  void clear() { sources.clear(), near.clear(), guarded.clear(), open.clear(), length = 0; }
};

/// Points within `radius` of `centre`, with normals within an angle of `axis` whose cosine is `cosine` (1: one normal).
struct Patch {
  DVec3 centre{0.0};
  double radius = 0;
  Vec3 axis{0.0f};
  double angle = 0;  ///< radians
};

class ContourTree {
 public:
  /// `segments` must outlive it. `angle`: largest between normals that see each other, radians. Errors: Cancelled.
  static Result<ContourTree> build(std::span<const ContourSegment> segments, int p, double angle, double error, const StopToken& stop);

  std::span<const ContourSegment> segments() const { return segments_; }
  /// Pieces yet to be looked at: box k as k, or as ~k where every point in question sees it.
  using Pieces = std::vector<int>;
  Pieces all() const { return boxes_.empty() ? Pieces{} : Pieces{0}; }
  /// Adds what `pieces` give to `out`, which is clear.
  void gather(const Patch& patch, const Pieces& pieces, PatchSources& out) const;
  /// Of `pieces` to `out` the sources that lie wholly at `distance` or more from the patch's centre and that every point sees; what is left for parts of the
  /// patch, in pieces that are not much larger than it, goes to `rest`.
  void gatherFar(const Patch& patch, const Pieces& pieces, double distance, PatchSources& out, Pieces& rest) const;

 private:
  struct Box {
    PatchSources::Source source;
    double radius = 0;
    Vec3 axis{0.0f};
    double angle = 0;
    uint32_t first = 0, count = 0;
    int left = -1;  ///< -1: a leaf; else its children are left and left + 1
  };
  enum class Seen : uint8_t { All, None, Some };

  ContourTree() = default;
  /// rest: null where segments may stay such.
  void gatherFrom(const Patch& patch, const Pieces& pieces, double distance, PatchSources& out, Pieces* rest) const;
  Box boxOf(uint32_t first, uint32_t count) const;
  Seen seenFrom(const Patch& patch, const Box& box) const;
  struct Bound {
    double length = 0, farthest = 0;  ///< of the piece that gives most
  };
  Bound least(const Patch& patch) const;
  double allowed(const Bound& bound, double d) const;
  double rest(double q) const;
  bool whole(double q, double most) const;
  void gatherSegment(const Patch& patch, uint32_t segment, const Bound& bound, PatchSources& out) const;

  std::span<const ContourSegment> segments_;
  std::vector<uint32_t> order_;
  std::vector<Box> boxes_;
  int p_ = 8;
  double angle_ = 0, error_ = 0, length_ = 0, surely_ = 2, hardly_ = -2, cubic_ = 0, safe_ = 0;
};

}  // namespace filters
}  // namespace gobo
