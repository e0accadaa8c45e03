// SPDX-License-Identifier: Apache-2.0
#include "plan/picture_warnings.h"

#include <cstdio>

#include "plan/auto_exposure.h"

namespace gobo {
inline namespace plan {

namespace {
constexpr double kFarTooBright = 8.0;  // log-average luminance: two stops beyond what an exposure is chosen for
constexpr const char* kPhotometric =
    ": if the scene file's point, spot and directional lights are in candela and lux, request.photometric = true divides them by 683";
}  // namespace

std::string droppedWarning(const std::string& output, const DroppedTotal& dropped) {
  if (dropped.samples == 0) return {};
  return output + ": " + std::to_string(dropped.samples) + " samples in " + std::to_string(dropped.elements) +
         " pixels had a part beyond what a 32-bit float holds and count as black";
}

std::string photometricWarning(const PixelValues& beauty) {
  const std::optional<ChosenExposure> chosen = chooseExposure(beauty);
  if (!chosen || !(chosen->luminance > kFarTooBright)) return {};
  char text[80];
  std::snprintf(text, sizeof text, "the log-average luminance of beauty is %.3g", chosen->luminance);
  return text + std::string(kPhotometric);
}

bool isPhotometricWarning(const std::string& warning) { return warning.ends_with(kPhotometric); }

}  // namespace plan
}  // namespace gobo
