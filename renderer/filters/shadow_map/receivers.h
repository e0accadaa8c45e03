// SPDX-License-Identifier: Apache-2.0
// Receivers: where view samples fall in a shadow map, in blocks that stay in the first-level cache and that loops vectorise over.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "filters/shadow_map/shadow_map.h"
#include "terms/term.h"

namespace gobo {
inline namespace filters {

struct ReceiverBlock {
  static constexpr int kSize = 128;
  float x[kSize], y[kSize];            ///< texel position: centres at whole numbers, inside [0, resolution - 1]
  float d[kSize];                      ///< linear depth, no bias; need not be in [0,1]
  float slopeX[kSize], slopeY[kSize];  ///< change of the surface's depth per texel; 0 unless asked for
  float majorX[kSize], majorY[kSize];  ///< axes of the pixel's footprint, texels; 0 unless asked for
  float minorX[kSize], minorY[kSize];
  int32_t face[kSize];
  int32_t covered[kSize];  ///< 1: the map has something to say; 0: lit
};

/// Receivers a task takes that read so many texels each: whole blocks, 4096 at most, and of some 2 million texels (2 ms), so that a stop is soon seen.
inline size_t receiverGrain(double texels) {
  const double blocks = double(1 << 21) / (std::max(texels, 1.0) * ReceiverBlock::kSize);
  return ReceiverBlock::kSize * size_t(std::clamp(blocks, 1.0, 4096.0 / ReceiverBlock::kSize));
}

/// Which parts of a block are wanted.
struct ReceiverNeeds {
  bool slopes = false, footprints = false;
  bool facing = true;  ///< receivers whose shading normal turns away from the light's centre count as not covered (as ray-traced visibility has it)
};

/// Reads planes P, instance and, as needed, Ng and footprint of a "gbuffer". Immutable; any thread may fill blocks.
class Receivers {
 public:
  /// `gbuffer` must outlive it.
  Receivers(const Term& gbuffer, const LightFrames& frames, int resolution, const ShadowView& view, ReceiverNeeds needs);
  /// What it needs of a node's input.
  static void reads(Wiring& wiring, size_t input, ReceiverNeeds needs);
  size_t size() const { return instance_.size(); }
  /// Fills block[0, count) with elements [begin, begin + count), count <= kSize.
  void fill(size_t begin, int count, ReceiverBlock& block) const;
  /// A part of fill(): `covered` of the first `count` becomes 0 where the surface turns away from the light (needs.facing; as they are without normals).
  void facing(size_t begin, int count, ReceiverBlock& block) const;
  /// Metric planar depth of linear depth d on a face.
  float metric(int face, float d) const { return faces_[face].near + d * faces_[face].range; }

 private:
  struct Face {
    float u[4], v[4], w[4], d[4];
    float near, range;
    Vec3 right, up, forward;
    float scaleX, scaleY;  ///< window units a texel over the depth range
  };
  void slopes(size_t begin, int count, ReceiverBlock& block) const;
  void footprints(size_t begin, int count, ReceiverBlock& block) const;

  std::span<const float> P_, N_, Ng_, footprint_;
  std::span<const uint32_t> instance_;
  Face faces_[6];
  int count_;
  Vec3 origin_;
  bool perspective_;
  float resolution_;
  ShadowView view_;
  ReceiverNeeds needs_;
};

}  // namespace filters
}  // namespace gobo
