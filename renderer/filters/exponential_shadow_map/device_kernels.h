// SPDX-License-Identifier: Apache-2.0
// The exponential shadow map's passes on a Vulkan or OpenGL device: same formulas, same order of sums as the cpu loops.
#pragma once

#include <span>

#include "base/stop.h"
#include "device/compute_device.h"
#include "filters/exponential_shadow_map/exponential_shadow_map_kernels.h"

namespace gobo {

/// e (width x height) from z: encode, filter rows, filter columns. Errors: those of ComputeDevice.
Status deviceEncode(ComputeDevice& device, std::span<const float> z, int width, int height, float c, std::span<const float> weights, std::span<float> e);

/// As lookupExponential, in pieces of 2^20 receivers, between which `stop` is polled (Cancelled). p.count is ignored.
Status deviceLookup(ComputeDevice& device, ExponentialLookupParameters p, std::span<const float> map, std::span<const float> positions,
                    std::span<const uint32_t> instances, std::span<float> visibility, const StopToken& stop);

}  // namespace gobo
