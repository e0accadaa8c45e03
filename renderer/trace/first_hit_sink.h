// SPDX-License-Identifier: Apache-2.0
// The sink of what filters of indirect light ask of a sample (axis-aligned filtering, Mehta et al. 2013): how far its first scattered ray goes, and
// what arrives along it.
//   distance       from the path's first vertex to the next one, along the first scattered ray: surfaces that it passes straight on are no end;
//                  infinity where it leaves the scene, -1 where there is none (no surface, or the path ended at the first: absorbed or
//                  cut by roulette). A ray into a scattering volume ends at its first event there
//   indirect       radiance of class Indirect that the sample sends to the camera, by lobe of the first event
//   weight         f |cos| / pdf of the first event, by lobe; their sum is its BSDF weight. White and diffuse where that event is in a
//                  volume. On a Lambert surface the diffuse one is the albedo
//   demodulated()  indirect / weight: the radiance that arrives along the first scattered ray (divided by the chance to survive roulette there, and
//                  dimmed by volumes in front of the first surface). Both lobes bring the same, so mean(weight[lobe] * demodulated) is the
//                  mean of indirect[lobe] up to float rounding; filtering demodulated() and multiplying by the albedo later keeps textures sharp
#pragma once

#include <limits>
#include <vector>

#include "trace/first_way.h"
#include "trace/path_sink.h"
#include "trace/sample_set.h"

namespace gobo {
inline namespace trace {

struct FirstHitSample {
  static constexpr float kNone = -1.0f;
  uint64_t sample = 0;  ///< of its pixel and stream
  Vec2 film{0.0f};      ///< pixels
  float distance = kNone;
  float pdf = 0;         ///< solid-angle density of the first scattered ray; 0 for delta events, or if there is none
  Vec3 direction{0.0f};  ///< of that ray; zero if there is none
  Vec3 diffuseWeight{0.0f}, specularWeight{0.0f};
  Vec3 indirectDiffuse{0.0f}, indirectSpecular{0.0f};

  Vec3 demodulated() const {
    const Vec3 weight = diffuseWeight + specularWeight, light = indirectDiffuse + indirectSpecular;
    Vec3 arriving(0.0f);
    for (int c = 0; c < 3; ++c) arriving[c] = weight[c] > 0.0f ? light[c] / weight[c] : 0.0f;
    return arriving;
  }
};

/// 100 bytes a sample. Takes any number of blocks; samples() are in order of tracing, dropped ones left out.
class FirstHitSink {
 public:
  static constexpr bool kVertices = true, kLobes = true;
  const std::vector<FirstHitSample>& samples() const { return samples_; }
  void clear() { samples_.clear(); }

  void start(uint64_t sample, int count) {
    count_ = count;
    for (int i = 0; i < count; ++i) {
      lanes_[i] = {};
      lanes_[i].record.sample = sample + uint64_t(i);
    }
  }
  void film(int lane, const Vec2& position) { lanes_[lane].record.film = position; }
  void vertex(int lane, const PathVertex& v) { lanes_[lane].way.vertex(v); }
  void scatter(int lane, const PathScatter& s) {
    Lane& l = lanes_[lane];
    if (!l.way.scatter(s)) return;
    l.record.pdf = s.pdf;
    l.record.direction = s.direction;
    l.record.specularWeight = s.weight * s.specularPart;
    l.record.diffuseWeight = s.weight - l.record.specularWeight;
  }
  void contribute(int lane, const PathContribution& c) {
    if (c.pathClass != PathClass::Indirect) return;
    lanes_[lane].record.indirectSpecular += c.specular;
    lanes_[lane].record.indirectDiffuse += c.value - c.specular;
  }
  void finish(uint32_t dropped) {
    for (int i = 0; i < count_; ++i) {
      const FirstWay& way = lanes_[i].way;
      if (dropped >> i & 1u) continue;
      samples_.push_back(lanes_[i].record);
      if (way.ended) samples_.back().distance = way.arrived() ? glm::length(way.to.position - way.from) : std::numeric_limits<float>::infinity();
    }
  }

 private:
  struct Lane {
    FirstHitSample record;
    FirstWay way;
  };
  Lane lanes_[kLanes];
  int count_ = 0;
  std::vector<FirstHitSample> samples_;
};

}  // namespace trace
}  // namespace gobo
