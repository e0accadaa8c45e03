// SPDX-License-Identifier: Apache-2.0
// Which object and which material a pixel shows. Input: G-buffer. Output: term "pixels", one plane "id", f32: the index into
// Scene::instances or Scene::materials as a number (exact up to 2^24), -1 where nothing is hit. Taken from view sample 0 of the
// pixel, never averaged: an average of ids names a third object. Lamps without geometry are not seen by the G-buffer. One pass.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace terms {

enum class IdKind : uint8_t { Object, Material };
NodePtr makeIdNode(IdKind kind, int width, int height);

}  // namespace terms
}  // namespace gobo
