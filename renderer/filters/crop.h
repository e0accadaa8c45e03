// SPDX-License-Identifier: Apache-2.0
// Filter: a window of a pixel term, without what was made around it. Every plane is copied; one pass over the window.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Input: a term over `around`. Output: its type, domain and planes over width x height pixels of every layer, of which the first is its (x, y).
NodePtr makeCropNode(const Extent& around, int x, int y, int width, int height);

}  // namespace filters
}  // namespace gobo
