// SPDX-License-Identifier: Apache-2.0
// The full surface (trace/surface.h) at a sample of a G-buffer: what a path sees at its first hit. For the surface term, and
// for terms that need more of a material than that term's planes hold. Facets Topology, Pose, Shading, Coverage, Albedo, Bsdf.
// About 0.1 us a look-up, textures apart. Immutable after construction; any thread. The G-buffer must outlive it.
#pragma once

#include "terms/node.h"
#include "trace/accel.h"
#include "trace/surface.h"

namespace gobo {
inline namespace terms {

inline constexpr Facet kSurfaceFacets = Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Albedo | Facet::Bsdf;

class SurfaceReader {
 public:
  SurfaceReader(const SceneView& view, AccelPtr accel, const Term& gbuffer, const Camera& camera);
  /// What it needs of a node's input.
  static void reads(Wiring& w, size_t i) {
    w.reads<uint32_t>(i, "instance").reads<uint32_t>(i, "primitive").reads<float>(i, "bary", {2}).reads<float>(i, "P", {3}).reads<float>(i, "Ng", {3});
  }
  size_t size() const { return instance_.size(); }
  bool hit(size_t i) const { return instance_[i] != kNoHit; }
  void read(size_t i, Surface& out) const;
  /// Unit vector from the view element's point to the viewer.
  Vec3 towardsViewer(size_t i) const;

 private:
  AccelPtr accel_;
  SurfaceTable table_;
  Camera camera_;
  Vec3 eye_, forward_;
  std::span<const uint32_t> instance_, primitive_;
  std::span<const float> bary_, P_, Ng_;
};

}  // namespace terms
}  // namespace gobo
