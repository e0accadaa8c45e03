// SPDX-License-Identifier: Apache-2.0
// Slices of a shutter's interval become one picture of each output.
#pragma once

#include <string>
#include <vector>

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// A plane (f32) of every slice, and what the slices are together.
struct SlicePlane {
  enum class How {
    Sum,
    Mean,
    MeanOfEven,    ///< of slices 0, 2, 4, ... alone: half of the samples, of moments between those of the other half
    MeanOverSeen,  ///< each slice by its share in plane `with` (one channel, How::Mean, values of at least 0); 0 where that is none
    MeanOfSeen,    ///< slices without a share in `with` count as 0; 1 where none has any
    Least,
    Ranked  ///< pairs (id, coverage): the mean coverage of each id, ranked anew (filters/rank_sums.h)
  };
  std::string plane;
  int channels = 3;
  How how = How::Mean;
  int with = -1;  ///< the index of another plane
};
/// The plane of output i in the result.
std::string slicedPlane(size_t i);

/// Fold: its inputs are the pictures of the first slice, a plane each, then those of the next. Output: "picture", planes slicedPlane(0), ... Memory: a double
/// accumulator for each channel of an output (96 bytes a pixel of a Ranked one); all that a slice is made of may go before the next one is made. Samples that
/// outputs of one slice dropped are the same ones: the most of them count.
NodePtr makeSliceSumNode(std::vector<SlicePlane> outputs, int width, int height, int slices);

struct NamedPlane {
  std::string name;
  int channels = 3;
};
/// Input: a slice sum. Output: `term`, whose planes are slicedPlane(first), slicedPlane(first + 1), ... there: copies by the names that filters know.
NodePtr makeSlicePartNode(std::string term, std::vector<NamedPlane> planes, size_t first, int width, int height);

}  // namespace filters
}  // namespace gobo
