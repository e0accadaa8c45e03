// SPDX-License-Identifier: Apache-2.0
// Caustics by photons (terms/caustics.h): paths that no camera path finds.
#pragma once

#include "technique/technique.h"

namespace gobo::inline techniques {

const Technique& causticPhotons();

}  // namespace gobo::inline techniques
