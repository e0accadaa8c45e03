// SPDX-License-Identifier: Apache-2.0
// Median of visibility: the worked example of a filter (docs/add_a_filter.md) and of a kernel (docs/add_a_kernel.md). Each view sample becomes the
// median of the 3 x 3 around it; neighbours of another instance, and those outside the picture, count as the sample itself. It takes away single wrong
// rays and keeps straight edges; a corner loses its point. 60 comparisons a sample, 4 bytes in, 4 out.
#pragma once

#include <memory>

#include "device/compute_device.h"
#include "terms/node.h"

namespace gobo {

/// Filter, term "visibility", plane V f32. Inputs: a "visibility" with one channel V, the "gbuffer" of the same extent. `device` null: cpu.
NodePtr makeMedianNode(const Extent& extent, ComputeDevicePtr device = nullptr);

}  // namespace gobo
