// SPDX-License-Identifier: Apache-2.0
// Cover: who brings which paths of which light into the beauty. Techniques claim before anybody plans; the path tracer gets the rest. What two
// techniques claim, what is brought twice or unclaimed, and what is claimed and never brought are errors in the program (Internal), found while
// planning: no picture holds a path twice or silently lacks one.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "technique/path_set.h"

namespace gobo {
inline namespace technique {

class Cover {
 public:
  /// `wanted`: what the request asks for of each light.
  Cover(size_t lights, PathSet wanted) : lights_(lights), wanted_(wanted) {}
  /// `technique` outlives this (a literal).
  Status claim(int light, PathSet paths, const char* technique);
  /// Paths that the technique claimed are in a plane now, or there are none of them.
  Status bring(int light, PathSet paths, const char* technique);
  PathSet wanted() const { return wanted_; }
  PathSet claimed(int light) const;
  /// Wanted and nobody's.
  PathSet rest(int light) const { return wanted_ - claimed(light); }
  PathSet claimedBy(int light, const char* technique) const;
  Status complete() const;

 private:
  struct Claim {
    const char* technique;
    PathSet claimed = PathSet::None, brought = PathSet::None;
  };
  Claim* find(int light, const char* technique);
  std::vector<std::vector<Claim>> lights_;
  PathSet wanted_;
};

}  // namespace technique
}  // namespace gobo
