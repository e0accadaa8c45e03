// SPDX-License-Identifier: Apache-2.0
// Rows of the joint bilateral filter (joint_bilateral.h). Structure of arrays; vectorised.
#pragma once

#include <span>

#include "filters/denoise/similar.h"

namespace gobo::denoise {

/// Planes of width * height. Where nothing is hit all but `hit` and the light is 0: such pixels are alike then.
struct BilateralPlanes {
  int width = 0, height = 0;
  const float* albedo[3] = {};
  const float* unit[3] = {};      ///< normals; 0 where they cancel out
  const float* length = nullptr;  ///< of the mean normal
  const float* place[3] = {};
  const float* footprint = nullptr;
  const float* hit = nullptr;  ///< 1 or 0
  int channels = 0;
  const float* light[6] = {};  ///< a, b
};

/// Row y of all channels; spatial[d]: weight of distance d in x or y, up to `radius`.
void bilateralRow(const BilateralPlanes& k, const Alike& by, const float* spatial, int radius, int y, float* const* out);

}  // namespace gobo::denoise
