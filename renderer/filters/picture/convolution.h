// SPDX-License-Identifier: Apache-2.0
// Symmetric separable convolution of a picture with mirrored borders. float64 sums; each value is the same sum in the same order wherever it lies, so that a
// part of a picture has the bits of the whole. O(values * radius).
#pragma once

#include <vector>

#include "filters/picture/picture_node.h"

namespace gobo {
inline namespace filters {

/// Half of a symmetric kernel, its middle first: a Gaussian of standard deviation `sigma` pixels, sampled, to 4 sigma (its variance is 0.1 % short then), of
/// sum 1 over both halves. sigma 0: {1}.
std::vector<double> gaussianKernel(double sigma);

/// Errors: Cancelled.
Status convolve(std::span<const float> in, std::span<float> out, const PictureShape& shape, std::span<const double> kernel, const RunContext& ctx);
/// Bytes that it holds beside both.
size_t convolutionBytes(const PictureShape& shape);
/// Time of a value.
double convolutionNs(size_t kernel);

}  // namespace filters
}  // namespace gobo
