// SPDX-License-Identifier: Apache-2.0
// A path's first scattered ray, for sinks that ask where it ends: the way from the first vertex to the next one. Surfaces that it passes straight on are no
// end; a ray into a scattering volume ends at its first event there.
#pragma once

#include "trace/path_sink.h"

namespace gobo {
inline namespace trace {

struct FirstWay {
  Vec3 from{0.0f};         ///< the path's first vertex
  PathVertex to;           ///< what its ray met; Escape where it left the scene
  bool scattered = false;  ///< at the first vertex
  bool ended = false;      ///< `to` is known

  void vertex(const PathVertex& v) {
    if (!scattered) {
      from = v.position;
    } else if (!ended) {
      ended = true;
      to = v;
    }
  }
  /// True at the event that the way begins with.
  bool scatter(const PathScatter& s) {
    if (over_) return false;
    if (s.passed) {  // where it went straight on was no end
      ended = false;
      return false;
    }
    over_ = scattered;
    scattered = true;
    return !over_;
  }
  /// Met, and inside the scene.
  bool arrived() const { return ended && to.kind != VertexKind::Escape; }

 private:
  bool over_ = false;  // went on from there
};

}  // namespace trace
}  // namespace gobo
