// SPDX-License-Identifier: Apache-2.0
// Path tracing as a technique: it claims nothing and gets what nobody else claimed. One node brings everything where nobody claimed anything;
// else one for indirect light, and one for each part of the rest that some lights have in common.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& pathTraced();
/// Edits of lights inside a cluster, as differences to what the cluster holds (request/effective_scene.h, gainChanges).
const Technique& clusterDifferences();

}  // namespace techniques
}  // namespace gobo
