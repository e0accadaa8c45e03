// SPDX-License-Identifier: Apache-2.0
// One layer of a visibility term and of a G-buffer as the contour reads them.
#pragma once

#include "filters/stylised/contour.h"
#include "terms/term.h"

namespace gobo {

/// Views: the terms must outlive it. `visibility`: null where only surfaces are asked for.
inline ContourInput contourInput(const Term* visibility, const Term& g, size_t layer) {
  const Extent& extent = g.extent();
  const size_t count = size_t(extent.width) * size_t(extent.height);
  ContourInput in;
  in.width = extent.width;
  in.height = extent.height;
  if (visibility) {
    in.channels = visibility->channels("V");
    in.V = visibility->floats("V").subspan(layer * count * size_t(in.channels), count * size_t(in.channels));
  }
  in.P = g.floats("P").subspan(layer * count * 3, count * 3);
  in.N = g.floats("N").subspan(layer * count * 3, count * 3);
  in.Ng = g.floats("Ng").subspan(layer * count * 3, count * 3);
  in.footprint = g.floats("footprint").subspan(layer * count, count);
  in.instance = g.plane<uint32_t>("instance").subspan(layer * count, count);
  return in;
}

}  // namespace gobo
