// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/transfer_kernels.h"

#include "formulas/stylised_shadow.glsl.h"

namespace gobo {

void styleRun(const float* __restrict D, size_t count, const StyleTransferSettings& s, float* __restrict V) {
  for (size_t k = 0; k < count; ++k) V[k] = formulas::styledVisibility(D[k], s.inflation, s.softness, s.brightness);
}

}  // namespace gobo
