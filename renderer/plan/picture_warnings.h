// SPDX-License-Identifier: Apache-2.0
// What is said of a picture once it is there, for whoever makes it: the engine, or the frame put together from parts (server/jobs/frame_parts.h).
#pragma once

#include <optional>
#include <string>

#include "plan/auto_exposure.h"
#include "terms/dropped_samples.h"

namespace gobo {
inline namespace plan {

/// Empty where nothing was dropped.
std::string droppedWarning(const std::string& output, const DroppedTotal& dropped);
/// Of a beauty whose lights are as the file has them: that it is so bright that their unit may be another one; empty where it is not. The mean is over pixels:
/// where no part of a picture is too bright the whole is not, but for what auto_exposure.h leaves out of large ones.
std::string photometricWarning(const PixelValues& beauty);
/// Whether `warning` is one of those.
bool isPhotometricWarning(const std::string& warning);

}  // namespace plan
}  // namespace gobo
