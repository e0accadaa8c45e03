// SPDX-License-Identifier: Apache-2.0
// Exponential shadow map (T. Annen, T. Mertens, H.-P. Seidel, E. Flerackers, J. Kautz, "Exponential Shadow Maps", GI 2008;
// Annen's thesis, ch. 7).
// Computes: visibility of a light from one depth map seen from it. With d the receiver's and z the blocker's linear depth and
// d >= z, the shadow test is e^{-c (d - z)}, a product, so filtering e^{c z} filters the *result* of the test:
//   V = clamp(e^{-c d} [w * e^{c z}], 0, 1)          (eq. 7.2), w a Gaussian of radius `blur`, sigma = (2 blur + 1) / 4 texels
// Three nodes: light_depth_map (source) -> exponential_shadow_encode (e^{c (z - 1)} and the separable Gaussian; taps beyond the
// map repeat its rim) -> exponential_shadow_lookup (bilinear, per view sample). Encoding about the far plane keeps every value in
// [1.8e-35, 1] for c <= 80, so sums over any kernel stay finite: no tiling, no logarithm.
// Parameters: resolution 1..8192 texels a side; c 1..80; blur 0..64 texels; bias 0..1 in units of the light's depth range.
// Cost: resolution^2 rays; encode and filter 8 + 8 (2 blur + 1) flops per texel and 3 passes of 4 bytes; lookup 16 bytes in, 4
// out and about 90 flops per view sample.
// Memory: 4 bytes per texel for each of depth map, filtered map and a scratch copy.
// Error: hard shadows only, of a point at the light's centre (area lights get no penumbra beyond the blur). Light leaks where
// blocker and receiver are close: V = e^{-c g} at a gap g (in depth ranges), half at ln 2 / c. Where the kernel reaches a surface
// *behind* the receiver by more than ln(taps) / c, V saturates to lit (thesis 7.2): shadow rims next to a drop fray. Receivers
// tilted to the light are never darkened below e^{-c (slope of a texel)}; bias covers that.
// Outside the map (beyond the cone, beyond 75 degrees for area lights, behind the light) V = 1. Damaged texels (NaN, infinities)
// count as "nothing hit", damaged positions as lit.
#pragma once

#include <memory>

#include "filters/exponential_shadow_map/light_frame.h"
#include "terms/node.h"

namespace gobo {

class ComputeDevice;

/// Source, term "light_depth_map": LightTexel, plane z f32 in [0,1], 1 where nothing is hit; closer than `near` reads 0. One ray
/// through each texel's centre.
NodePtr makeLightDepthMapNode(const LightFrame& frame, int resolution);

/// Filter, term "exponential_shadow_map": LightTexel, plane E f32 in (0,1]. Input: a term with plane z. `device` null: cpu.
NodePtr makeExponentialShadowEncodeNode(float c, int blur, int resolution, std::shared_ptr<ComputeDevice> device = nullptr);

struct ExponentialShadowLookup { LightFrame frame; float c = 60.0f, bias = 0.001f; };
/// Filter, term "visibility": domain and extent of the G-buffer, plane V f32 in [0,1]; 1 where the G-buffer has no surface.
/// Inputs: "gbuffer" (planes P, instance), "exponential_shadow_map". `viewSamples`: elements expected, for admission.
/// The devices agree within 1e-4 in V for maps up to 1024 texels (tests/unit/filters/exponential_shadow_devices_test.cpp; bit
/// for bit on lavapipe and llvmpipe).
NodePtr makeExponentialShadowLookupNode(const ExponentialShadowLookup& lookup, size_t viewSamples, std::shared_ptr<ComputeDevice> device = nullptr);

}  // namespace gobo
