// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/transfer_kernels.h"

#include <algorithm>

#include "formulas/stylised_shadow.glsl.h"

namespace gobo {
inline namespace filters {

void styleRun(const float* __restrict D, size_t count, const StyleTransferSettings& s, float* __restrict V) {
  const float inflation = s.inflation, softness = s.softness, brightness = s.brightness, steps = float(s.steps);
  switch (s.transition) {
    case StyleTransition::Smoothstep:
      for (size_t k = 0; k < count; ++k) V[k] = formulas::styledVisibility(D[k], inflation, softness, brightness);
      return;
    case StyleTransition::Quintic:
      for (size_t k = 0; k < count; ++k) V[k] = formulas::styledVisibilityBy(1, steps, D[k], inflation, softness, brightness);
      return;
    case StyleTransition::Staircase:
      for (size_t k = 0; k < count; ++k) V[k] = formulas::styledVisibilityBy(2, steps, D[k], inflation, softness, brightness);
      return;
    case StyleTransition::Curve: {
      const float pieces = float(s.curve.size() - 1);
      for (size_t k = 0; k < count; ++k) {
        const float u = formulas::bandPosition(D[k], inflation, softness), at = formulas::limit(u, 0.0f, 1.0f) * pieces;
        const size_t piece = std::min(size_t(at), s.curve.size() - 2);
        V[k] = formulas::styledVisibilityAlong(s.curve[piece], s.curve[piece + 1], at - float(piece), u, D[k], inflation, softness, brightness);
      }
      return;
    }
  }
}

}  // namespace filters
}  // namespace gobo
