// SPDX-License-Identifier: Apache-2.0
// What the rays of a camera with `cullBackFaces` pass as if it were not there: back faces of single-sided materials (glTF 2.0, 3.9.6
// "Double Sided": without it back-face culling is enabled). Outside follows the winding; a mirroring instance turns it over (3.7.4).
// Only while the camera looks straight on: its first rays, through alpha, and behind surfaces that bend nothing (trace/straight.h).
// Light, shadow and bounced rays meet both sides, so a culled wall still shades its room: transport stays the same both ways.
// Never culled: what light goes through (transmission, diffuse transmission, volumes), whose back faces are the way out.
// Immutable after construction; any thread.
#pragma once

#include <vector>

#include "trace/accel.h"
#include "trace/embree.h"

namespace gobo {
inline namespace trace {

/// Facets that BackFaces reads.
inline constexpr Facet kBackFaceFacets = Facet::Topology | Facet::Coverage | Facet::Bsdf;

class BackFaces {
 public:
  BackFaces() = default;  ///< passes nothing
  BackFaces(const SceneView& view, const Accel& accel);
  /// Some instance has back faces that are passed.
  bool any() const { return !sides_.empty(); }

  /// An Embree context for rays that pass them: the rays whose id is kPasses.
  struct Context {
    embree::Context context;
    const BackFaces* faces;
  };
  static constexpr unsigned kPasses = 1;
  void init(Context& c) const;
  static void filter(const RTCFilterFunctionNArguments* args);

 private:
  std::vector<uint8_t> sides_;  // by instance; empty: none is passed
};

/// A camera sees such a material's front only.
bool showsFrontOnly(const Coverage& coverage, const Bsdf& bsdf);

}  // namespace trace
}  // namespace gobo
