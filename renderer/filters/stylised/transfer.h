// SPDX-License-Identifier: Apache-2.0
// Transfer of a stylised shadow: the cheap last stage, all that inflation, softness, brightness and how light rises re-run.
//
// Computes     S(x) = b + (1 - b) step(i - s/2, i + s/2, D(x)), a step at D = i where s = 0 (formulas/stylised_shadow.glsl.h); with layers the mean of each
// one's by their
//              weights, the first one's being 1. In [b, 1], 1 where D = 1e30, and never less for greater b; but for staircases that formulas bend, never
//              greater for greater i.
// Curve        t within the band in straight lines between the curve's values, not necessarily rising; 0 before the band and 1 behind it.
// Inputs       First the distances that layers are of, plane D (filters/stylised/distance_field.h); then, where `tinted`, a visibility (plane V of 3 channels);
// then,
//              where something varies, "style_parameters" (planes of the fields that do): of the first layer, then of each further one that has any.
// Output       term "visibility", plane V. Of three channels: S V where the light arrives (a channel of V is at least 1/2), and S itself where it did not: what
//              is made light in a shadow has no colour of glass.
// Parameters   inflation and softness in the units of D, softness >= 0; brightness 0 .. 1.
// Identity     Hard visibility and i = s = b = 0: S = V to the bit, for D carries the sign of V.
// Cost         8 bytes and 10 operations an element and layer.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

enum class StyleTransition : uint8_t { Smoothstep, Quintic, Staircase, Curve };

struct StyleTransferLayer {
  float inflation = 0, softness = 0, brightness = 0;
  double weight = 1;
  int distance = 0;  ///< index of its input
  bool varyingInflation = false, varyingSoftness = false, varyingBrightness = false;
  bool varies() const { return varyingInflation || varyingSoftness || varyingBrightness; }
};

struct StyleTransferSettings {
  float inflation = 0, softness = 0, brightness = 0;
  StyleTransition transition = StyleTransition::Smoothstep;
  int steps = 4;                           ///< of a staircase
  std::vector<float> curve;                ///< of a curve, 2 values or more, each 0 .. 1: t at equal steps of the band
  std::vector<StyleTransferLayer> layers;  ///< beside the first one, which is of input 0
  int distances = 1;
  bool tinted = false;
  bool varyingInflation = false, varyingSoftness = false, varyingBrightness = false;
  bool varies() const { return varyingInflation || varyingSoftness || varyingBrightness; }
};

NodePtr makeStyleTransferNode(const StyleTransferSettings& settings);

}  // namespace filters
}  // namespace gobo
