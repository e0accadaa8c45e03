// SPDX-License-Identifier: Apache-2.0
// A shadow drawn in lines or dots of the picture.
//
// Computes     Coverage c = (1 - S) / (1 - dark) of each view sample's tone S becomes lines (HATCHING), two crossed families of them (CROSS) or dots
// (STIPPLING) that cover
//              c of the area and are `dark`; between them there is light. Lines and dots are one pixel's box wide at their borders: no aliases. The mean over a
//              period is the tone: exact for lines, within 1 % for dots.
// Inputs       0: the styled visibility, plane V of 1 or 3 channels (of three the largest is the tone, and all are scaled alike); then, where brightness
// varies,
//              "style_parameters" (plane brightness): of the style, then of each layer in layerShares.
// Output       term "visibility", plane V, in [0, 1].
// Parameters   spacing (pixels), angle (radians, counter-clockwise from the horizontal), dark: what a full shadow keeps of the light. With layers dark is
//              ownShare * brightness + rest.
// Identity     Where S is 1 V is 1, where S is dark it is dark: a hard shadow stays as it is.
// Windows      by the pixel's place in the film: a part has the bits of the whole.
// Cost         20 to 60 operations a sample.
#pragma once

#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

enum class StylePattern : uint8_t { Hatching, CrossHatching, Stippling };

struct StylePatternSettings {
  Extent extent;
  ViewPlace place;
  StylePattern pattern = StylePattern::Hatching;
  float spacing = 8, angle = 0.78539816f;
  float brightness = 0;           ///< of the first layer
  double ownShare = 1, rest = 0;  ///< 1, 0 without layers
  bool varyingBrightness = false;
  std::vector<double> layerShares{};  ///< of each further layer whose brightness varies: of the mean; `rest` is without it
};
NodePtr makeStylePatternNode(const StylePatternSettings& settings);

/// Share of the pixel about (x, y) that is drawn where the tone asks for `coverage` 0..1.
float patternAt(StylePattern pattern, float spacing, float angle, float x, float y, float coverage);

}  // namespace filters
}  // namespace gobo
