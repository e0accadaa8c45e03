// SPDX-License-Identifier: Apache-2.0
// Which light the estimators reach through which class of path. The one owner of the question: the kernels branch on it, and
// classesNotCovered() (request/material_kinds.h) names what it leaves out. tests/oracle/trace/reach_test.cpp holds every row against light tracing.
// A path is sorted by its end at the light: the last event that is not a delta event (or the camera), and what is between it and the light.
//   shadow ray   next-event estimation: the light is sampled, the connection asked for occluders
//   ray          a sampled direction meets the light
//   photon       the caustics node (trace/photon_tracer.h), where it is asked for
// Ray and shadow ray may both find a light: they are weighted against each other (Veach 1997). Photons have what neither finds.
// Lights with cameraVisible = false are hidden from camera rays and from what sees them as a camera ray would, straight through
// clear panes and boundaries of index 1. They light everything: mirrors and refraction show them, volumes scatter their light.
// A directional light of some angular size is hidden from the camera in the same way, always: a sun belongs in the map that is seen
// behind the scene.
#pragma once

#include <cstdint>

#include "scene/light.h"

namespace gobo {
inline namespace trace {

enum class Receiver : uint8_t { Camera, Surface, Volume };
enum class Passage : uint8_t {
  Open,      ///< nothing but absorption on the way
  Boundary,  ///< boundaries of volumes that bend nothing (index 1) and have no other lobe
  Pane,      ///< delta events that bend nothing, at other surfaces: smooth thin walls
  Specular,  ///< at least one mirror or smooth refraction
};
inline constexpr Receiver kReceivers[] = {Receiver::Camera, Receiver::Surface, Receiver::Volume};
inline constexpr Passage kPassages[] = {Passage::Open, Passage::Boundary, Passage::Pane, Passage::Specular};

/// Shadow rays ask for every kind of light, at surfaces and in volumes, and go on through what bends nothing (trace/straight.h).
constexpr bool shadowRayReaches(LightKind, Receiver from, Passage through) { return from != Receiver::Camera && through != Passage::Specular; }

constexpr bool rayReaches(const LightShape& light, bool cameraVisible, Receiver from, Passage through) {
  if (isDeltaLight(light)) return false;
  return (cameraVisible && light.kind != LightKind::Directional) || from != Receiver::Camera || through == Passage::Specular;
}

constexpr bool photonReaches(const LightShape& light, Receiver from, Passage through) {
  return isDeltaLight(light) && from == Receiver::Surface && !shadowRayReaches(light.kind, from, through);
}

/// Light that the scene has and no estimator finds. What the camera itself does not see is no such light: a hidden lamp by
/// intent, a point, spot or directional one (or its mirror image) because it has no area.
constexpr bool outOfReach(const LightShape& light, bool cameraVisible, Receiver from, Passage through, bool photons) {
  return from != Receiver::Camera && !shadowRayReaches(light.kind, from, through) && !rayReaches(light, cameraVisible, from, through) &&
         !(photons && photonReaches(light, from, through));
}

}  // namespace trace
}  // namespace gobo
