// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filter of a noisy visibility term.
//
// Computes     V'(x) = sum w(x-x', beta(x)) V(x') / sum w, w = exp(-|D|^2 / (2 beta^2)), in two passes (rows, then columns of the rows'
//              result), each pixel using its own beta in both (Wang, UCB/EECS-2013-118, equations 3.2, 3.3, 3.7; Mehta, Wang,
//              Ramamoorthi 2012). |D| is the distance on the plane through the pixel that is parallel to the
//              light, onto which the other pixel is moved along its line to the light's centre: that far visibility is the same in the first
//              order (the source drops the part along the plane's normal, which is the same for receivers parallel to the light, and takes walls
//              that stand upright on the plane for one point; to a light at infinity the lines are parallel); beta = 1/(k Omega). A tap counts if it
//              is filterable, |beta' - beta| <= betaThreshold max(beta, beta'), the normals differ by at most `angle`, and it is
//              within 6 beta in space. The centre tap always counts, so there is no 0/0.
// Inputs       0: any ViewSample term with plane "V" (f32, one channel or RGB: each by the same weights); 1: "gbuffer" (P, N, instance, footprint);
//              2: term with plane "Omega" (f32, rad/m; 0 = leave this pixel alone), see terms/shadow_slopes.h.
// Output       term "visibility", plane "V" with as many channels. Layers are filtered each on its own.
//              Fourth order: each pass takes the intercept of the least-squares fit of c0 + c1 |D|^2 with those weights, whose kernel has no second
//              moment (Fan & Gijbels 1996, local polynomials, even part), and the result is limited to 0..1.
// Parameters   k (1..8), radiusPx (0..64; 0 = identity), betaThreshold (0..1), angle (radians, 0..pi), the light's frame.
// Cost         about 2 (2 r + 1) taps of 30 flops per pixel, r = min(ceil(3 beta / pixel step), radiusPx); 44 bytes per pixel of
//              scratch for one layer. Pixels without an occluder cost nothing.
// Error        Widens a penumbra of standard deviation sigma s to sigma s sqrt(1 + 1/(k^2 mu^2)) (5.4 % at k = 3, mu = 1); noise
//              variance falls by d^2 / (4 pi beta^2). The fourth order at the same beta: a tenth of the squared bias in penumbras of uniform
//              lights, 2.85 times the variance (formulas/axis_aligned.glsl.h).
// Fails where  beta jumps (streaks along rows and columns); the pilot rays missed a small occluder; beta / pixel > radius / 3 leaves
//              noise; pixels near the picture's border see one side only; strongly foreshortened receivers weigh near pixels more;
//              rectangles much longer than wide (one sigma stands for both axes).
// Determinism  bit-identical for any number of threads, and for tiles with a halo of radiusPx + 1.
#pragma once

#include "terms/node.h"
#include "terms/shadow_light.h"

namespace gobo {
inline namespace filters {

/// Literal modes: what the source and its released code did otherwise, for reproducing and taking apart (filters/axis_aligned/literal.h). No request has them.
enum class AxisAlignedDistance : uint8_t {
  Line,        ///< as above
  LightPlane,  ///< of the difference, what is left without its part along the plane's normal: as published
  World,       ///< in space
};
enum class AxisAlignedThresholds : uint8_t {
  ScaleFree,  ///< as above
  Report,     ///< the first alone: neither normals nor a reach in space
  Code,       ///< the released code's: band limits within 10 rad/m, `angle`, and a square distance in space below 10 m^2; it changes with the scene's unit
};
inline constexpr float kCodeOmegaThreshold = 10.0f, kCodeReach2 = 10.0f;

struct AxisAlignedFilterSettings {
  ShadowLightFrame light;
  float k = 3.0f;
  int radiusPx = 32;
  float betaThreshold = 0.75f;
  float angle = 0.34906585f;  ///< radians (20 degrees)
  bool fourthOrder = false;   ///< no second moment
  bool exact2d = false;       ///< reference mode: the full 2-D gather in one pass, O(r^2) per pixel (tests and ablation)
  AxisAlignedDistance distance = AxisAlignedDistance::Line;
  AxisAlignedThresholds thresholds = AxisAlignedThresholds::ScaleFree;
  float cut = 0;  ///< no weight beyond this many beta (the code: sqrt 6); 0: wherever the window ends

  bool literal() const { return distance != AxisAlignedDistance::Line || thresholds != AxisAlignedThresholds::ScaleFree || cut > 0; }
};
inline constexpr int kAxisAlignedMaxRadius = 64;

NodePtr makeAxisAlignedFilter(const AxisAlignedFilterSettings& settings);
/// Of a node that makeAxisAlignedFilter made (CHECKed).
const AxisAlignedFilterSettings& settingsOfAxisAlignedFilter(const Node& node);

}  // namespace filters
}  // namespace gobo
