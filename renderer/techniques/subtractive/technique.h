// SPDX-License-Identifier: Apache-2.0
// Direct light of an environment as its unshadowed light less the shadows of few lights (environment.subtractive; docs/intent.md).
//   environment:split --> the few lights (an expansion) --> subtractive:samples --+
//        |      +--> gloss levels --> subtractive:unshadowed ---------------------+--> subtractive:light, a plane a lobe
//        +--> bright lights, in full resolution, with shadows of their own
#pragma once

#include "technique/technique.h"

namespace gobo {

const Technique& subtractiveShadows();

}  // namespace gobo
