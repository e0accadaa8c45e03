// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of indirect light (Mehta, Wang, Ramamoorthi, Durand 2013; Wang, UCB/EECS-2013-118, chapter 4), for light of one lobe.
//
// Computes     rows, then columns of the rows' result (line_means.h), each pixel with a Gaussian of its own width beta, over pixels of the same surface.
//              PREDICTED: light L from a distance z bends by at most some L (d / z)^2 from pixel to pixel (of width d), so that a mean of width beta, in
//              pixels, errs by kappa beta^2 c, c = mean(L (d / z)^2) over the samples (trace/curvature_sums.h) of the 20 pixels around; noise of variance V
//              falls to V / (4 pi beta^2). Least of the sum of squares:
//                  beta^6 = V / (8 pi kappa^2 c^2),  kappa = 0.2
//              kappa was fitted to `cornell` and `spheres` at 16 samples, where twice or half of it changes the error by some percent.
//              Specular: what a lobe shows turns with a pixel's way d by d (1/z + 1/D + 2/R), D the camera's distance, R the surface's radius of curvature; it
//              bends by the square of that per angle of the lobe, theta = 3.2 (alpha + 0.02):  c = (sqrt(mean(L (d / z)^2)) + sqrt(mean L) d (1/D + 2/R))^2 /
//              theta^2. BAND_LIMIT: as published, beta = z_min / (2 mu Omega), at least half a pixel, Omega = 2.8 or 3.6 + 0.084 m, m = 2 / alpha^2 - 2
//              (equation 4.4 with the standard deviation of the authors' code; the printed 2 z_min / Omega blurs 4 times as much); z_min the nearest surface
//              seen.
// Inputs       NoisyPicture with curvature (PREDICTED) or nearest (BAND_LIMIT); without them light stays as it is, as it does at pixels that are not even
//              (view_sample_edges.h looks after these).
// Parameters   scale of beta, radius, thresholds of angle and width.
// Cost         4 x 2.5 beta taps of 0.5 ns a pixel and half; 100 bytes a pixel.
// Error        falls with the samples: beta goes as V^(1/6), squared bias and noise as V^(2/3).
// Fails where  shadows of indirect light are sharper than what casts them is far (light through slits); what lies around is seen by less than some
//              hundred samples; mirrors, whose reflection has edges of its own.
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

DenoiserPtr makeAxisAligned(const v1::AxisAlignedDenoise& settings);

/// Half width of the window that curvatures are averaged over: 2.5 standard deviations of 8 pixels.
inline constexpr int kCurvatureRadius = 20;

}  // namespace gobo::denoise
