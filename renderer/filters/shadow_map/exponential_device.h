// SPDX-License-Identifier: Apache-2.0
// The exponential shadow map's passes on a Vulkan or OpenGL device: same formulas, same order of sums as
// the cpu loops (equal within 1e-4 in V for maps up to 1024 texels; bit for bit on lavapipe and llvmpipe).
#pragma once

#include <span>

#include "base/stop.h"
#include "filters/resident_planes.h"
#include "filters/shadow_map/light_frame.h"

namespace gobo {
inline namespace filters {

/// Plane B of `result` from plane z of `depth`: encode, filter rows, filter columns. B stays on the device for the lookup. Errors: those of ComputeDevice.
Status deviceEncode(ResidentPlanes& on, const TermPtr& depth, float c, std::span<const float> weights, const std::shared_ptr<Term>& result);

/// V of the receivers (planes P and instance of `gbuffer`, ~0u means no surface) from a filtered map's plane B, in pieces of 2^20 receivers, between which
/// `stop` is polled (Cancelled). Map and receivers are uploaded where they are not on the device already. It knows no normals: that surfaces which turn away
/// from the light are lit is for the caller to see to.
struct DeviceLookup {
  LightFrame frame;
  float c, bias;
};
Status deviceLookup(ResidentPlanes& on, const DeviceLookup& lookup, const TermPtr& map, const TermPtr& gbuffer, std::span<float> visibility,
                    const StopToken& stop);

}  // namespace filters
}  // namespace gobo
