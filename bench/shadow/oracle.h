// SPDX-License-Identifier: Apache-2.0
// The bases of shadow maps in float64: same depth map, same receivers, same kernels as what ships, but no float, no byte, no recurrence and
// no fast sine between. What is left of a basis's error then is the basis's own (digest 11, R4).
#pragma once

#include <vector>

#include "shadow/runner.h"

namespace gobo::shadowbench {

/// V of the Gaussian kernel of t.map.blur for t's own technique: convolution (OFFSET), exponential (any c) or variance.
Result<std::vector<float>> exactBasis(Runner& runner, const v1::ShadowTechnique& t);

/// How far behind the farthest depth of its kernel a receiver lies, in depth ranges: positive in the umbra of the Gaussian kernel alone; -1 where
/// the map does not reach.
Result<std::vector<float>> umbraDepth(Runner& runner, const v1::ShadowTechnique& t);

/// Convolution soft shadows as the thesis has them (8.2, 8.3; search plane at the smallest depth of the kernel) of order M: float64 summed-area
/// tables, exact boxes. Rect and Disk lights. Receivers' own slope over the kernel comes off their depth, at most half way to the nearest
/// blocker.
Result<std::vector<float>> exactConvolutionSoft(Runner& runner, const v1::ShadowTechnique& t, int order);

/// Percentage closer filtering of the Gaussian kernel (bilinear at its ends, as GAUSSIAN) by `taps` points drawn by its density, turned from
/// pixel to pixel: what a shader without pre-filtering does with that many fetches.
Result<std::vector<float>> sampledKernel(Runner& runner, const v1::ShadowTechnique& t, int taps, double* ms);

}  // namespace gobo::shadowbench
