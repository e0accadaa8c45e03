// SPDX-License-Identifier: Apache-2.0
// Caustics by photons (terms/caustics.h): paths that no camera path finds.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& causticPhotons();

}  // namespace techniques
}  // namespace gobo
