// SPDX-License-Identifier: Apache-2.0
#include "plan/auto_exposure.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"

namespace gobo {
inline namespace plan {

namespace {
constexpr double kDark = -7.0, kBright = 1.0, kGrey = -2.473931188332412;  // log2: of 1/128, 2, 0.18
constexpr double kMost = 32.0;                                             // tone_map.exposure's range
constexpr size_t kPixels = 65536;                                          // that are looked at: a logarithm of all would cost as much as a JPEG
}  // namespace

std::optional<ChosenExposure> chooseExposure(const PixelValues& linear) {
  double sum = 0.0;
  uint64_t n = 0;
  const size_t step = (linear.pixels() + kPixels - 1) / kPixels | 1;  // odd: goes through the columns of pictures of even width
  for (size_t p = 0; p < linear.pixels(); p += step) {
    const float* v = linear.values.data() + p * size_t(linear.channels);
    const double y = linear.channels >= 3 ? double(luminance(Vec3(v[0], v[1], v[2]))) : double(v[0]);
    if (!(y > 0.0) || !std::isfinite(y)) continue;
    sum += std::log2(y);
    ++n;
  }
  if (n == 0) return std::nullopt;
  const double mean = sum / double(n);
  if (mean >= kDark && mean <= kBright) return std::nullopt;
  return ChosenExposure{std::clamp(std::round((kGrey - mean) * 4.0) / 4.0, -kMost, kMost), std::exp2(mean)};
}

}  // namespace plan
}  // namespace gobo
