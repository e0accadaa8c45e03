// SPDX-License-Identifier: Apache-2.0
// ScreenSequence: the points of view samples, dealt out of one Owen-scrambled Sobol sequence along a Morton curve over the picture (Ahmed &
// Wonka 2020, "Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical ordering of pixels").
//
// A view sample's points are as well spread as ever: `stride` consecutive indices. Those of a 2x2, 4x4, ... block of pixels are so too, so that
// the errors of neighbours cancel where a filter takes their mean. The first points of a view sample are an aligned part of its stride, another
// in every pixel: its own shuffle decides which. Beyond 2^32 / stride view samples the sequence is used again.
#pragma once

#include "base/sobol.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace terms {

/// Even bits of the result: those of x; odd bits: those of y.
inline uint32_t mortonIndex(uint32_t x, uint32_t y) {
  auto spread = [](uint32_t v) {
    v &= 0xffffu;
    v = (v | v << 8) & 0x00ff00ffu;
    v = (v | v << 4) & 0x0f0f0f0fu;
    v = (v | v << 2) & 0x33333333u;
    return (v | v << 1) & 0x55555555u;
  };
  return spread(x) | spread(y) << 1;
}

class ScreenSequence {
 public:
  /// `samples`: the most that any view sample takes; strides are powers of two not below it.
  ScreenSequence(uint64_t seed, const Extent& view, const ViewPlace& place, uint32_t samples)
      : seed_(hash64(0x5c4ee2ull, seed)),
        film_(view, place),
        width_(size_t(place.whole() ? view.width : place.filmWidth)),
        height_(size_t(place.whole() ? view.height : place.filmHeight)) {
    while (stride_ < samples) stride_ *= 2;
  }

  /// Point `i` of element `e` of the view.
  SobolSampler operator()(size_t e, uint32_t i) const {
    const size_t at = film_(e), x = at % width_, row = at / width_, y = row % height_, layer = row / height_;
    return SobolSampler(layer == 0 ? seed_ : hash64(seed_, layer), mortonIndex(uint32_t(x), uint32_t(y)) * stride_ + i);
  }

 private:
  uint64_t seed_;
  FilmElements film_;
  size_t width_, height_;
  uint32_t stride_ = 1;
};

}  // namespace terms
}  // namespace gobo
