// SPDX-License-Identifier: Apache-2.0
// Display transform of finished pictures (engine.h: toneMapped). The curves are in formulas/tone_map.glsl.h.
#include "plan/engine.h"
#include "plan/straight_alpha.h"

#include "formulas/tone_map.glsl.h"

namespace gobo {
inline namespace plan {

Image toneMapped(const Image& linear, const v1::ToneMap& settings) {
  using namespace formulas;
  const float scale = exposureScale(float(settings.exposure()));
  if (linear.channels == 4) {
    const StraightAlpha straight = straightAlpha(linear, scale);
    return withAlpha(toneMapped(straight.colour, settings), straight.alpha, linear.names);
  }
  Image out = linear;
  const auto curve = settings.curve();
  if (curve == v1::ToneMap::ACES || curve == v1::ToneMap::PBR_NEUTRAL) {
    const int channels = linear.channels, colours = channels >= 3 ? 3 : 1;
    for (size_t p = 0; p < linear.pixels(); ++p) {
      float* o = out.data.data() + p * channels;
      const float r = o[0] * scale, g = colours == 3 ? o[1] * scale : r, b = colours == 3 ? o[2] * scale : r;
      const bool aces = curve == v1::ToneMap::ACES;
      o[0] = aces ? toneMapAcesRed(r, g, b) : toneMapNeutral(r, r, g, b);
      if (colours == 1) continue;
      o[1] = aces ? toneMapAcesGreen(r, g, b) : toneMapNeutral(g, r, g, b);
      o[2] = aces ? toneMapAcesBlue(r, g, b) : toneMapNeutral(b, r, g, b);
    }
    return out;
  }
  for (float& v : out.data) {
    const float x = v * scale;
    v = curve == v1::ToneMap::LINEAR ? toneMapLinear(x) : curve == v1::ToneMap::REINHARD ? toneMapReinhard(x) : toneMapFilmic(x);
  }
  return out;
}

}  // namespace plan
}  // namespace gobo
