// SPDX-License-Identifier: Apache-2.0
// Screen motion between two moments of a scene. Input: G-buffer of the later one. Output: term "pixels", plane "motion", f32x2: where the
// surface point that view sample 0 of the pixel sees is now, minus where it was seen before, in pixels, x right, y DOWN (as rows count).
// The point keeps its instance (by name), triangle and barycentrics: camera, instance transforms and vertices (skins, morphs) all count.
// An instance that was not there, or had other triangles, counts as at rest. Background moves as something infinitely far
// (0 for orthographic cameras); what was behind the earlier camera gives 0. A scene at rest gives exact zeros. Double arithmetic; one pass.
#pragma once

#include "terms/gbuffer.h"

namespace gobo {
inline namespace terms {

struct MotionSettings {
  GBufferSettings view;   ///< now
  ScenePtr earlierScene;  ///< sealed; its topology and pose are part of the key
  Camera earlierCamera;
};
NodePtr makeMotionNode(const MotionSettings& settings);

}  // namespace terms
}  // namespace gobo
