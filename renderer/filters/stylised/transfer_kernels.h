// SPDX-License-Identifier: Apache-2.0
// The transfer's loop over a run of elements.
#pragma once

#include <cstddef>

#include "filters/stylised/transfer.h"

namespace gobo {
inline namespace filters {

void styleRun(const float* D, size_t count, const StyleTransferSettings& s, float* V);

}  // namespace filters
}  // namespace gobo
