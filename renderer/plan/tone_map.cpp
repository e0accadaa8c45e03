// SPDX-License-Identifier: Apache-2.0
// Display transform of finished pictures (engine.h: toneMapped). The curves are in formulas/tone_map.glsl.h.
#include <algorithm>

#include "plan/engine.h"

#include "formulas/tone_map.glsl.h"

namespace gobo {

Image toneMapped(const Image& linear, const v1::ToneMap& settings) {
  const float scale = formulas::exposureScale(float(settings.exposure()));
  Image out = linear;
  const auto curve = settings.curve();
  for (float& v : out.data) {
    const float x = v * scale;
    v = curve == v1::ToneMap::LINEAR ? formulas::toneMapLinear(x) : curve == v1::ToneMap::REINHARD ? formulas::toneMapReinhard(x) : formulas::toneMapFilmic(x);
  }
  return out;
}

}  // namespace gobo
