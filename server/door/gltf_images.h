// SPDX-License-Identifier: Apache-2.0
// Pictures of depth sensors and of labels as files (docs/drake.md). Pure functions.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace door {

/// Depth along the camera's axis, metres, 0 where there is nothing, as a sensor with that range tells it: 0 nearer than `least`, infinity
/// beyond `most` and where there is nothing.
void toSensorDepth(std::span<float> depth, double least, double most);

/// Uncompressed little-endian TIFF of one 32-bit float a pixel, rows from the top, one strip.
std::string depthTiff(int width, int height, std::span<const float> depth);

/// 8-bit RGB PNG of the base colours as they stand in the scene file, 255 for 1, white where `depth` is 0. `colours`: three a pixel, 0..1.
Result<std::vector<uint8_t>> labelPng(int width, int height, std::span<const float> colours, std::span<const float> depth);

}  // namespace door
}  // namespace gobo
