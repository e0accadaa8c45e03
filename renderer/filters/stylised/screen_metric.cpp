// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/screen_metric.h"

#include "terms/term.h"

namespace gobo {
inline namespace filters {

PictureSurface::PictureSurface(int width, int height, float pixel) {
  const size_t w = size_t(width), count = w * size_t(height);
  P_.resize(3 * count);
  N_.resize(3 * count);
  for (size_t e = 0; e < count; ++e) {
    P_[3 * e] = (float(e % w) + 0.5f) * pixel;
    P_[3 * e + 1] = (float(e / w) + 0.5f) * pixel;
    N_[3 * e + 2] = 1;
  }
  footprint_.assign(count, pixel);
  instance_.assign(count, 0u);
  input_.width = width;
  input_.height = height;
  input_.P = P_;
  input_.N = input_.Ng = N_;
  input_.footprint = footprint_;
  input_.instance = instance_;
}

const ContourInput& PictureSurface::visible(const Term& visibility, const Term& gbuffer, size_t layer, int level, int levels) {
  const size_t count = instance_.size(), channels = size_t(visibility.channels("V"));
  const auto V = visibility.floats("V").subspan(layer * count * channels, count * channels);
  const auto instance = gbuffer.plane<uint32_t>("instance").subspan(layer * count, count);
  ContourInput seen;
  seen.channels = int(channels);
  seen.V = V;
  V_.resize(count);
  for (size_t e = 0; e < count; ++e) V_[e] = instance[e] == ~0u ? 1.0f : seen.visibility(e);
  input_.V = V_;
  input_.level = (float(level) + 0.5f) / float(levels);
  input_.several = levels > 1;
  return input_;
}

}  // namespace filters
}  // namespace gobo
