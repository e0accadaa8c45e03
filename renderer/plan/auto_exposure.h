// SPDX-License-Identifier: Apache-2.0
// The exposure of a picture for looking at that would otherwise be nearly black or nearly white: lamps in candela, scenes in other units.
#pragma once

#include <optional>
#include <span>

#include "base/image.h"

namespace gobo {
inline namespace plan {

/// Values of a picture where they lie: a copy of a large one takes longer than looking at it.
struct PixelValues {
  std::span<const float> values;
  int channels = 1;
  PixelValues(std::span<const float> all, int each) : values(all), channels(each) {}
  PixelValues(const Image& image) : values(image.data), channels(image.channels) {}
  size_t pixels() const { return values.size() / size_t(channels); }
};

struct ChosenExposure {
  double stops = 0.0;
  double luminance = 0.0;  ///< log-average of what is not black
};
/// Nothing for a picture whose log-average luminance, black pixels aside, lies within 2^-7 .. 2, and for a black one; else what brings it to 0.18, in
/// quarters of a stop. Of larger pictures about 65536 pixels are looked at, always the same ones. `linear`: 1 channel or 3 and more.
std::optional<ChosenExposure> chooseExposure(const PixelValues& linear);

}  // namespace plan
}  // namespace gobo
