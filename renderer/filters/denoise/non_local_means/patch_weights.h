// SPDX-License-Identifier: Apache-2.0
// Weights of pixels by how alike the patches around them are in a guide picture: the rows of non_local_means.h, for it and whoever regresses by them.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::denoise {

/// A picture and its variance as planes with a margin at the left and right that repeats the border.
struct GuidePlanes {
  int width = 0, height = 0, margin = 0;
  const float* value[3] = {};     ///< pixel (x, y) at y * stride() + margin + x
  const float* variance[3] = {};
  int stride() const { return width + 2 * margin; }
};

struct PatchSettings {
  int patch = 3;        ///< half width
  float damping = 0.5;  ///< k
};

/// Rows [y0, y1), all columns: w[(y - y0) * width + x] = weight of the pixel at (x + dx, y + dy) for (x, y) by the guide; unspecified where that lies outside.
/// margin >= |dx| + patch. `scratch` grows as needed.
void patchWeights(const GuidePlanes& g, const PatchSettings& s, int dx, int dy, int y0, int y1, float* w, std::vector<float>& scratch);

}  // namespace gobo::denoise
