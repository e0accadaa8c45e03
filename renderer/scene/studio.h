// SPDX-License-Identifier: Apache-2.0
// The light of a scene that has none: a grey room with three soft boxes, so that the first picture of a model shows the model.
#pragma once

#include "scene/environment.h"

namespace gobo {
inline namespace scene {

struct Scene;

/// Something lights the scene: an environment, a lamp, or a surface that is one. What glows by a picture of radiance at most 1 (glTF's emissiveTexture
/// without KHR_materials_emissive_strength) is no lamp: most viewers let it light nothing, and models have their displays and eyes painted with it.
bool hasLamp(const Scene& scene);

/// A grey room, darker below, with a key light in front to the right, a fill to the left and a rim light behind, seen from +Z, glTF's front. A white
/// Lambert surface that faces +Z has radiance 0.9. The same map each time.
EnvironmentPtr studioEnvironment();

}  // namespace scene
}  // namespace gobo
