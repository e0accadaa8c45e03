// SPDX-License-Identifier: Apache-2.0
// Display transform of finished pictures (engine.h: toneMapped). The curves are in formulas/tone_map.glsl.h.
#include <algorithm>

#include "plan/engine.h"

#include "formulas/tone_map.glsl.h"

namespace gobo {

namespace {

/// PNG has straight alpha, pictures have what adds to the background: the curve is of the colour by itself. Light without a surface in front of
/// nothing (a lamp that is seen) gets as much alpha as it needs to be shown.
Image withStraightAlpha(const Image& linear, const v1::ToneMap& settings) {
  Image colour(linear.width, linear.height, 3), out(linear.width, linear.height, 4);
  out.names = linear.names;
  std::vector<float> alpha(linear.pixels());
  const float scale = formulas::exposureScale(float(settings.exposure()));
  for (size_t p = 0; p < linear.pixels(); ++p) {
    const float* v = linear.data.data() + 4 * p;
    const float most = std::max({v[0], v[1], v[2]}) * scale;
    alpha[p] = std::clamp(std::max(v[3], std::min(most, 1.0f)), 0.0f, 1.0f);
    for (size_t c = 0; c < 3; ++c) colour.data[3 * p + c] = alpha[p] > 0.0f ? v[c] / alpha[p] : 0.0f;
  }
  const Image shown = toneMapped(colour, settings);
  for (size_t p = 0; p < linear.pixels(); ++p) {
    for (size_t c = 0; c < 3; ++c) out.data[4 * p + c] = shown.data[3 * p + c];
    out.data[4 * p + 3] = alpha[p];
  }
  return out;
}

}  // namespace

Image toneMapped(const Image& linear, const v1::ToneMap& settings) {
  using namespace formulas;
  const float scale = exposureScale(float(settings.exposure()));
  if (linear.channels == 4) return withStraightAlpha(linear, settings);
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

}  // namespace gobo
