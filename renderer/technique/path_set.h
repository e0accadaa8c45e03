// SPDX-License-Identifier: Apache-2.0
// PathSet: an exact set of path classes. Techniques claim sets by light (technique/cover.h), planes of the beauty hold sets, outputs show sets.
// The path tracer's coarser PathClass (trace/path_class.h) is a union of these.
//   Emission   light that the camera sees without a scattering event
//   Direct     one scattering event, at the first surface, by a non-delta lobe: on the side that is seen (front), or through it (behind)
//   Indirect   everything else that ends on a light and that the path tracer finds
//   Caustic    indirect paths that only light tracing finds: from a light that no ray can hit through delta events (trace/reach.h)
// Lobes are those of the first event.
#pragma once

#include <cstdint>
#include <string>

#include "trace/path_class.h"

namespace gobo {
inline namespace technique {

enum class PathSet : uint16_t {
  None = 0,
  Emission = 1 << 0,
  FrontDiffuse = 1 << 1,
  FrontSpecular = 1 << 2,
  BehindDiffuse = 1 << 3,
  BehindSpecular = 1 << 4,
  IndirectDiffuse = 1 << 5,
  IndirectSpecular = 1 << 6,
  CausticDiffuse = 1 << 7,
  CausticSpecular = 1 << 8,
  Front = FrontDiffuse | FrontSpecular,
  Behind = BehindDiffuse | BehindSpecular,
  Direct = Front | Behind,
  Indirect = IndirectDiffuse | IndirectSpecular,
  Caustic = CausticDiffuse | CausticSpecular,
  Diffuse = FrontDiffuse | BehindDiffuse | IndirectDiffuse | CausticDiffuse,
  Specular = FrontSpecular | BehindSpecular | IndirectSpecular | CausticSpecular,
  All = Emission | Direct | Indirect | Caustic,
};
constexpr PathSet operator|(PathSet a, PathSet b) { return PathSet(uint16_t(a) | uint16_t(b)); }
constexpr PathSet operator&(PathSet a, PathSet b) { return PathSet(uint16_t(a) & uint16_t(b)); }
constexpr PathSet operator-(PathSet a, PathSet b) { return PathSet(uint16_t(a) & ~uint16_t(b)); }
constexpr bool overlaps(PathSet a, PathSet b) { return (a & b) != PathSet::None; }
constexpr bool contains(PathSet set, PathSet part) { return (set & part) == part; }
/// Some paths of `part` are in the set and some are not.
constexpr bool cuts(PathSet set, PathSet part) { return overlaps(set, part) && !contains(set, part); }

constexpr PathSet pathSet(PathClass c) {
  return (has(c, PathClass::Emission) ? PathSet::Emission : PathSet::None) | (has(c, PathClass::Direct) ? PathSet::Direct : PathSet::None) |
         (has(c, PathClass::Indirect) ? PathSet::Indirect : PathSet::None);
}

/// "emission, direct front diffuse, ...", for messages.
std::string names(PathSet set);

}  // namespace technique
}  // namespace gobo
