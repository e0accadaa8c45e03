// SPDX-License-Identifier: Apache-2.0
// Planes of a picture, apart: loops over one channel vectorise.
#pragma once

#include <span>
#include <vector>

#include "terms/scratch.h"

namespace gobo::denoise {

class PlaneSet {
 public:
  PlaneSet(int channels, size_t pixels) : values_(size_t(channels) * pixels) {
    for (int c = 0; c < channels; ++c) at_.push_back(values_.get() + size_t(c) * pixels);
  }
  float* const* data() const { return at_.data(); }
  std::span<const float* const> in() const { return {at_.data(), at_.size()}; }
  std::span<float* const> out() const { return {at_.data(), at_.size()}; }
  float* operator[](size_t c) const { return at_[c]; }

 private:
  Scratch<float> values_;
  std::vector<float*> at_;
};

}  // namespace gobo::denoise
