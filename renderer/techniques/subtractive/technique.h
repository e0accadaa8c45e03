// SPDX-License-Identifier: Apache-2.0
// Direct light of an environment as its unshadowed light less the shadows of few lights (environment.subtractive; docs/intent.md).
//   environment:split --> the few lights (an expansion) --> subtractive:samples --+
//        |      +--> gloss levels --> subtractive:unshadowed ---------------------+--> subtractive:light, a plane a lobe
//        +--> bright lights, in full resolution, with shadows of their own
// The same of the scene's lights that have shadows.subtractive, all of equal settings together:
//   subtractive_samples (of the lights that give most at each sample) --+
//   unshadowed (of all of them, in full resolution) --------------------+--> subtractive, a plane a lobe
// Of several lights the gains are parameters of all three, which share the light among them: an edit of a gain runs them again, the traced samples too. One
// light alone keeps its gain as the weight of its planes.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& subtractiveShadows();
const Technique& subtractiveLights();

}  // namespace techniques
}  // namespace gobo
