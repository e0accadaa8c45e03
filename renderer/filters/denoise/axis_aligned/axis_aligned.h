// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of indirect light (Mehta, Wang, Ramamoorthi, Durand 2013; Wang, UCB/EECS-2013-118, chapter 4), for light of one lobe.
//
// Computes     rows, then columns of the rows' result (line_means.h), each pixel with a Gaussian of its own width beta, over pixels of the same surface.
//              Light L from a distance z bends by at most some L (d / z)^2 from pixel to pixel (of width d), so that a mean of width beta, in pixels, errs
//              by kappa beta^2 c, c = mean(L (d / z)^2) over the samples of the 20 pixels around (trace/curvature_sums.h); noise of variance V falls to
//              V / (4 pi beta^2). The sum of both, squared, is least at
//                  beta^6 = V / (8 pi kappa^2 c^2),  kappa = 0.2
//              kappa was fitted to `cornell`, `spheres` and `atrium` at 16 samples, where half or twice of it changes the error by some percent. The source
//              takes beta = z_min / (2 mu Omega) of the nearest surface, whatever light that sends and however many samples there are.
//              Specular: what a lobe shows turns with a pixel's way d by d (1/z + 1/D + 2/R), D the camera's distance, R the surface's radius of curvature; it
//              bends by the square of that per angle of the lobe, theta = 3.2 (alpha + 0.02):
//                  c = (sqrt(mean(L (d / z)^2)) + sqrt(mean L) d (1/D + 2/R))^2 / theta^2
// Inputs       NoisyPicture with curvature; without it light stays as it is, as it does at pixels that are not even (view_sample_edges.h looks after
//              these).
// Parameters   scale of beta, radius, thresholds of angle and width.
// Cost         4 x 2.5 beta taps of some 0.5 ns a pixel; 100 bytes a pixel.
// Error        falls with the samples: beta goes as V^(1/6), squared bias and noise as V^(2/3).
// Fails where  shadows of indirect light have edges far from what casts them (light through slits); mirrors, whose reflections have edges of their own.
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

DenoiserPtr makeAxisAligned(const v1::AxisAlignedDenoise& settings);

/// Half width of the window that curvatures are averaged over: 2.5 standard deviations of 8 pixels.
inline constexpr int kCurvatureRadius = 20;

}  // namespace gobo::denoise
