// SPDX-License-Identifier: Apache-2.0
// Visibility of one light by shadow rays: the reference among shadow techniques.
// Term "visibility", domain ViewSample, plane V f32 in [0,1]: the share of the light that a view sample sees, weighted as the unshadowed light
// arrives (cosine at the receiver, foreshortening of the light), so that V times unoccluded irradiance is the direct irradiance.
// V = 1 for background and wherever the light cannot shine anyway (surface turned away, behind the light, outside a spot's cone or
// range, inside a sphere light): the unoccluded light is zero there, and filters see no false edge. A shading normal
// that faces the light on a surface that does not gives V = 0; of a light that the surface's own horizon cuts, the share is of what is above both.
// One ray on Point, Spot and Directional lights without angular size (hard shadows; isDeltaLight()); `samples` Owen-scrambled Sobol points per view sample on
// area lights, each view sample with a scramble of its own. A mesh light counts by area; its emission texture is not read. Cost: one occlusion query per
// sample. Light that comes through a surface from behind is no part of V. Scenes with surfaces that light passes straight on (trace/straight.h: clear panes,
// index 1) have an RGB visibility: V f32x3, what of each channel arrives.
#pragma once

#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace terms {

/// What becomes of light at surfaces that it passes straight on.
enum class Glass : uint8_t {
  Solid,  ///< the scene has none: V has one channel
  Seen,   ///< it is tinted: V has three channels
  Alone,  ///< only that: V (three channels) is the mean tint of what solid surfaces may or may not let through
};

struct VisibilitySettings {
  uint32_t samples = 16;
  uint64_t seed = 0;
  Extent extent;  ///< of the G-buffer
  ViewPlace place;
  Glass glass = Glass::Solid;
  bool hard = false;  ///< of the light's centre, whatever its size: one ray, nothing is drawn (`samples` 1, `seed` does not count)
};
/// Input 0: "gbuffer", or what else has its planes P, N, Ng, footprint, instance. The light is the one in the graph node's `lights`; any kind but Environment.
NodePtr makeVisibilityNode(const VisibilitySettings& settings);

/// Seed of the sample sequence of view sample `element`: independent from pixel to pixel (correlated noise would defeat filters).
uint64_t viewSampleSeed(uint64_t seed, size_t element);

}  // namespace terms
}  // namespace gobo
