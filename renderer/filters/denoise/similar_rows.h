// SPDX-License-Identifier: Apache-2.0
// Means over the pixels around one whose surfaces are alike (similar.h), a row at a time. Structure of arrays; vectorised: 2 to 3 ns a tap.
#pragma once

#include <span>

#include "base/task_arena.h"
#include "filters/denoise/similar.h"
#include "terms/scratch.h"

namespace gobo::denoise {

/// Planes of width * height. Where nothing is hit all of them are 0: such pixels are alike.
struct AlikePlanes {
  int width = 0, height = 0;
  const float* albedo[3] = {};
  const float* unit[3] = {};      ///< normals; 0 where they cancel out
  const float* length = nullptr;  ///< of the mean normal
  const float* place[3] = {};
  const float* footprint = nullptr;
  const float* hit = nullptr;  ///< 1 or 0
};

/// Features as planes.
class AlikeFeatures {
 public:
  static constexpr size_t bytes(int width, int height) { return kPlanes * sizeof(float) * size_t(width) * size_t(height); }
  /// False: stopped.
  bool fill(const Features& f, int width, int height, const TaskArena& arena, const StopToken& stop);
  const AlikePlanes& planes() const { return planes_; }

 private:
  static constexpr size_t kPlanes = 12;
  Scratch<float> values_;
  AlikePlanes planes_;
};

inline constexpr int kMostChannels = 6;

/// w[t], t < n: near * similarity(p + t, p + t + shift).
void alikeWeights(const AlikePlanes& k, const Alike& by, size_t p, ptrdiff_t shift, int n, float near, float* w);

/// out[c][y * width + x] = sum_q spatial(|p - q|) similarity(p, q) light[c][q] / sum_q of the weights, for row y and each of `channels` planes (at most
/// kMostChannels). spatial[d]: weight of a distance of d in x or y, up to `radius`.
void alikeMeansRow(const AlikePlanes& k, const Alike& by, const float* spatial, int radius, const float* const* light, int channels, int y, float* const* out);

}  // namespace gobo::denoise
