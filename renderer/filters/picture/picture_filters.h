// SPDX-License-Identifier: Apache-2.0
// The filters of pictures that requests chain (request.filters, docs/picture_filters.md). Each makes a node of one input and one output of the same shape
// (picture_node.h). Values are linear light, of any sign and size; a result beyond what floats hold is the largest float. None reads the scene.
// Linear ones (traits().linearPerGroup): gaussian, sharpen, resample, color_balance. Costs are those of one core.
#pragma once

#include <array>

#include "filters/picture/picture_node.h"
#include "gobo/v1/filters.pb.h"

namespace gobo {
inline namespace filters {

/// Low pass: convolution with a Gaussian of `sigma` pixels, truncated at 4 sigma. Constant pictures stay to the bit. Tileable, halo ceil(4 sigma).
NodePtr makeGaussianNode(PictureShape shape, double sigma);

/// Unsharp mask I + amount (I - g I), g a Gaussian of `sigma` pixels: kernel (1 + amount) delta - amount g, gain 1 for what is even and
/// 1 + amount (1 - G(w)) at frequency w. May leave the range of its input: negative light is kept, shares are brought back. Tileable as g.
NodePtr makeSharpenNode(PictureShape shape, double sigma, double amount);

/// Median of (2 radius + 1)^2 pixels, by channel. deviations > 0: only values farther from it than so many median absolute deviations become it. Removes any
/// outliers that are less than half of each window. Tileable, halo radius (0 .. 8). O(radius^2).
NodePtr makeMedianNode(PictureShape shape, int radius, double deviations);

/// Bilateral filter (Tomasi, Manduchi 1998): mean of the pixels within 3 sigma, with weight exp(-d^2 / 2 sigma^2) exp(-|c - c'|^2 / 2 range^2), |c - c'| the
/// Euclidean distance of their values over all channels together. range -> infinity: a Gaussian truncated at 3 sigma; range -> 0: the input. A pixel unlike all
/// around it stays as it is. Tileable, halo ceil(3 sigma). O(sigma^2).
NodePtr makeBilateralNode(PictureShape shape, double sigma, double range);

/// Bloom: I + gain K e. e is the part of I above `threshold`: I (Y - T) / Y where its luminance Y is above T, negative channels as 0. K is the
/// distribution of a point's light on a plane behind a small distance, a / (2 pi (r^2 + a^2)^(3/2)) integrated over pixels, a = radius / sqrt(3): half of it
/// within `radius`, a tail that falls with the cube. It is cut at the smaller of 32 radii and the picture's width or height in either direction and scaled to
/// sum 1, so that gain times all excess light is added, none more or less. By Fourier transforms: looks at a whole picture. Holds 16 to 36 bytes a pixel and
/// channel.
NodePtr makeBloomNode(PictureShape shape, double threshold, double gain, double radius);

/// Compression: of the W x H coefficients of each channel's discrete Fourier transform the round(share W H) strongest alone; conjugates, of equal
/// magnitude, stay or go together. The least squared error that so many coefficients can have. Any size, in O(n log n). The picture repeats beyond its
/// borders. Reads a whole picture.
NodePtr makeCompressionNode(PictureShape shape, double share);

/// Taken at points `factor` pixels apart in either direction and put together again by `kernel`. prefilter: each sample is the mean around it under the same
/// kernel, as wide as samples are apart; without it the pixel there, and what is finer than two samples comes back as another frequency. Kernels: BOX (half a
/// spacing to either side), TENT, GAUSSIAN (standard deviation half a spacing, 2 spacings to either side), MITCHELL (B = C = 1/3: Mitchell, Netravali 1988),
/// LANCZOS (3 lobes). Weights are scaled to sum 1 everywhere. Depends on where pixels lie in the picture: of whole pictures.
NodePtr makeResampleNode(PictureShape shape, double factor, v1::ResampleFilter::Kernel kernel, bool prefilter);

/// A colour filter of some density before the lens: each channel times transmittance^density (Bouguer, Lambert): half the density twice is the whole once.
/// keepLuminance: divided by what it lets through of white, so that greys keep their luminance. Three channels. Tileable, halo 0.
NodePtr makeColorBalanceNode(PictureShape shape, const std::array<double, 3>& transmittance, double density, bool keepLuminance);

}  // namespace filters
}  // namespace gobo
