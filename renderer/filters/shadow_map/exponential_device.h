// SPDX-License-Identifier: Apache-2.0
// The exponential shadow map's passes on a Vulkan or OpenGL device: same formulas, same order of sums as
// the cpu loops (equal within 1e-4 in V for maps up to 1024 texels; bit for bit on lavapipe and llvmpipe).
#pragma once

#include <span>

#include "base/stop.h"
#include "device/compute_device.h"
#include "filters/shadow_map/light_frame.h"

namespace gobo::inline filters {

/// e (width x height) from z: encode, filter rows, filter columns. Errors: those of ComputeDevice.
Status deviceEncode(ComputeDevice& device, std::span<const float> z, int width, int height, float c, std::span<const float> weights, std::span<float> e);

/// V of the receivers (positions 3 floats each, instance ~0u means no surface) from a filtered map, in pieces of 2^20 receivers, between which
/// `stop` is polled (Cancelled).
struct DeviceLookup {
  LightFrame frame;
  float c, bias;
  int width, height;
};
Status deviceLookup(ComputeDevice& device, const DeviceLookup& lookup, std::span<const float> map, std::span<const float> positions,
                    std::span<const uint32_t> instances, std::span<float> visibility, const StopToken& stop);

}  // namespace gobo::inline filters
