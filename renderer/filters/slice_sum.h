// SPDX-License-Identifier: Apache-2.0
// Slices of a shutter's interval become one picture of each output.
#pragma once

#include <string>
#include <vector>

#include "terms/node.h"

namespace gobo {

/// An output of every slice: its plane (f32) there, and what the slices are: parts of a mean, or of a sum.
struct SlicePlane {
  std::string plane;
  int channels = 3;
  bool mean = true;
};
/// The plane of output i in the result.
std::string slicedPlane(size_t i);

/// Fold: its inputs are the pictures of the first slice, a plane each, then those of the next. Output: "picture", planes slicedPlane(0), ... Memory: a double
/// accumulator for each output; all that a slice is made of may go before the next one is made. Samples that outputs of one slice dropped are the same ones:
/// the most of them count.
NodePtr makeSliceSumNode(std::vector<SlicePlane> outputs, int width, int height, int slices);

}  // namespace gobo
