// SPDX-License-Identifier: Apache-2.0
// A map turned once about a scene, by precomputed transfer: what a turn costs once the transfer is there.
#pragma once

#include <string>

#include "session.h"

namespace gobo::cli {

/// Renders `request` (whose scene `info` describes) under its environment alone, at each of 24 turns of 15 degrees. Prints what the first picture and the turns
/// cost; writes turning-map.png (an APNG) and turning-map.txt (the plan of each picture) to `folder` unless it is empty.
Status turnMap(Session& session, const v1::SceneInfo& info, v1::RenderRequest request, const std::string& folder);

}  // namespace gobo::cli
