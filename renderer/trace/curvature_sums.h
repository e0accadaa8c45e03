// SPDX-License-Identifier: Apache-2.0
// The sink of pictures that also say how fast their indirect light may change along a surface (SplitMode::ByLobeAndCurvature).
// Light L that arrives from a distance z bends by at most some L (d / z)^2 from pixel to pixel, d the width of a pixel at the surface (axis-aligned
// filtering, Mehta et al. 2013: its band limit is Omega / z; Jarosz et al. 2012 have the same of irradiance caches). Summed over samples this is linear
// in the lights, as the picture is, and knows which of the surfaces around are bright; the least distance does not.
// z: from the path's first vertex to the next one, as in trace/first_hit_sink.h; light from outside of the scene adds none. d / z counts as
// at most kMostRatio: one vertex next to the surface says no more than that light changes from pixel to pixel.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "scene/camera.h"
#include "trace/first_way.h"
#include "trace/path_sink.h"
#include "trace/sample_set.h"

namespace gobo {
inline namespace trace {

/// Adds to out[slot * 3 + channel] of the lanes' pixels, as SumSink does; indirect light times (d / z)^2 to the two slots behind those of ByLobe.
class CurvatureSums {
 public:
  static constexpr bool kVertices = true, kLobes = true;
  static constexpr double kMostRatio = 2.0;
  /// Lanes of several pixels in turn, as many of each; `out` null: nobody wants them.
  CurvatureSums(const PathTracerSettings& settings, std::span<double* const> out)
      : each_(kLanes / int(out.size())),
        eye_(settings.camera.toWorld[3]),
        perMetre_(settings.camera.perspective ? pixelFootprint(settings.camera, settings.height, 1.0f) : 0.0),
        everywhere_(settings.camera.perspective ? 0.0 : pixelFootprint(settings.camera, settings.height, 1.0f)) {
    std::copy(out.begin(), out.end(), out_);
  }

  void start(uint64_t, int) {
    std::fill(ways_, ways_ + kLanes, FirstWay{});
    records_.clear();
  }
  void film(int, const Vec2&) {}
  void vertex(int lane, const PathVertex& v) { ways_[lane].vertex(v); }
  void scatter(int lane, const PathScatter& s) { ways_[lane].scatter(s); }
  void contribute(int lane, const PathContribution& c) { records_.push_back({c, lane}); }
  void finish(uint32_t dropped) {
    for (const Record& r : records_) {
      double* const o = out_[r.lane / each_];
      if (!o || (dropped >> r.lane & 1u)) continue;
      forEachSlot(SplitMode::ByLobeAndCurvature, r.light, [&](int slot, const Vec3& value) { add(o, slot, value, 1.0); });
      if (r.light.pathClass != PathClass::Indirect || !ways_[r.lane].arrived()) continue;
      const double bends = perSquare(ways_[r.lane]);
      add(o, r.light.slot + kCurvatureSlot, r.light.value - r.light.specular, bends);
      add(o, r.light.slot + kCurvatureSlot + 1, r.light.specular, bends);
    }
  }

 private:
  /// (d / z)^2.
  double perSquare(const FirstWay& way) const {
    const double width = everywhere_ + perMetre_ * glm::length(DVec3(way.from) - eye_), z = glm::length(DVec3(way.to.position) - DVec3(way.from));
    const double ratio = z > 0.0 ? std::min(width / z, kMostRatio) : kMostRatio;
    return ratio * ratio;
  }
  struct Record {
    PathContribution light;
    int lane = 0;
  };
  static std::vector<Record>& recordBuffer() {  // one a thread: a chunk must not allocate
    static thread_local std::vector<Record> buffer;
    return buffer;
  }
  static void add(double* out, int slot, const Vec3& value, double times) {
    for (int c = 0; c < 3; ++c) out[3 * slot + c] += double(value[c]) * times;
  }
  FirstWay ways_[kLanes];
  int each_;
  DVec3 eye_;
  double perMetre_, everywhere_;  // width of a pixel: per distance from the eye; of a parallel camera
  double* out_[kLanes];
  std::vector<Record>& records_ = recordBuffer();
};

}  // namespace trace
}  // namespace gobo
