// SPDX-License-Identifier: Apache-2.0
// Edge-preserving smoothing of whole pictures: what does not remove outliers, since a spike is an edge. Baselines. RGB, width * height * 3; windows are cut off
// at the border.
#pragma once

#include <vector>

namespace gobo::outliers {

/// sum k(p - q) s(|f(p) - f(q)|) f(q) / sum k s (Tomasi & Manduchi 1998): Gaussians of `space` pixels, cut off at two, and of `range` in the distance of RGB,
/// both > 0. range to infinity: a Gaussian filter; to 0: the picture itself.
std::vector<float> bilateralFilter(const std::vector<float>& rgb, int width, int height, double space = 2.0, double range = 0.1);

/// Perona & Malik 1990: `steps` times f += 1/4 sum over the four neighbours of (f(q) - f(p)) exp(-(|f(q) - f(p)| / edge)^2), |.| the distance of RGB. Keeps the
/// sum.
std::vector<float> anisotropicDiffusion(const std::vector<float>& rgb, int width, int height, int steps = 8, double edge = 0.1);

}  // namespace gobo::outliers
