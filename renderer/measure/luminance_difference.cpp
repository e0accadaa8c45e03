// SPDX-License-Identifier: Apache-2.0
#include "measure/luminance_difference.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "base/check.h"

namespace gobo {
inline namespace measure {
namespace {

/// Mean and deviation of value(i) over the chosen pixels: in two passes, the second of which mends the first's rounding.
template <typename Value>
void momentsOf(const std::vector<size_t>& chosen, const Value& value, double& mean, double& deviation) {
  const double n = double(chosen.size());
  double first = 0, rest = 0, squares = 0;
  for (const size_t i : chosen) first += value(i);
  first /= n;
  for (const size_t i : chosen) {
    const double d = value(i) - first;
    rest += d;
    squares += d * d;
  }
  rest /= n;
  mean = first + rest;
  deviation = std::sqrt(std::max(squares / n - rest * rest, 0.0));
}

}  // namespace

std::vector<double> luminancesOf(const Image& image) {
  std::vector<double> out;
  out.reserve(image.pixels());
  for (size_t i = 0; i < image.pixels(); ++i) {
    const float* p = image.data.data() + i * size_t(image.channels);
    out.push_back(image.channels >= 3 ? 0.2126 * double(p[0]) + 0.7152 * double(p[1]) + 0.0722 * double(p[2]) : double(p[0]));
  }
  return out;
}

double displayedByExponential(double luminance, double exposure) { return luminance <= 0 ? 0.0 : -std::expm1(-exposure * luminance); }

double exposureOfHalf(double luminance) { return std::numbers::ln2 / luminance; }

Result<LuminanceDifference> luminanceDifference(std::span<const double> picture, std::span<const double> reference, double exposure,
                                                std::span<const uint8_t> mask) {
  if (picture.size() != reference.size())
    return invalidArgument("pictures differ in size: " + std::to_string(picture.size()) + " and " + std::to_string(reference.size()) + " pixels");
  if (picture.empty()) return invalidArgument("empty picture");
  if (!mask.empty() && mask.size() != picture.size())
    return invalidArgument("mask has " + std::to_string(mask.size()) + " entries for " + std::to_string(picture.size()) + " pixels");
  if (!std::isfinite(exposure) || exposure < 0) return invalidArgument("exposure is " + std::to_string(exposure) + "; finite and not below 0");
  LuminanceDifference out;
  std::vector<size_t> chosen;
  for (size_t i = 0; i < picture.size(); ++i) {
    if (!mask.empty() && mask[i] == 0) continue;
    if (std::isfinite(picture[i]) && std::isfinite(reference[i])) chosen.push_back(i);
    else ++out.nonFinite;
  }
  out.pixels = chosen.size();
  if (chosen.empty()) return out;
  momentsOf(
      chosen, [&](size_t i) { return std::fabs(picture[i] - reference[i]); }, out.mean, out.deviation);
  momentsOf(
      chosen, [&](size_t i) { return std::fabs(displayedByExponential(picture[i], exposure) - displayedByExponential(reference[i], exposure)); }, out.shownMean,
      out.shownDeviation);
  return out;
}

std::vector<uint8_t> edgeMask(std::span<const double> reference, int width, int height, int reach, double share) {
  GOBO_CHECK(width >= 0 && height >= 0 && reference.size() == size_t(width) * size_t(height));
  std::vector<uint8_t> out(reference.size(), 0);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double least = std::numeric_limits<double>::infinity(), most = 0;
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, height - 1); ++v)
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, width - 1); ++u) {
          const double here = reference[size_t(v) * size_t(width) + size_t(u)];
          if (here < least) least = here;
          if (here > most) most = here;
        }
      out[size_t(y) * size_t(width) + size_t(x)] = most - least > share * most;
    }
  return out;
}

}  // namespace measure
}  // namespace gobo
