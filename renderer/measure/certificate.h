// SPDX-License-Identifier: Apache-2.0
// Certificate statistics: the error of a picture from some of its pixels (measure/certificate_pixels.h), each path traced in
// four independent parts. Pure functions of numbers: who traces the pixels is the caller's business (plan/certify_picture.h).
// Derivation and measured coverage: docs/certificate.md.
//
// What is claimed, at 95 % (2.5 % on each side) over the choice of pixels and the noise of the parts. e_i: pixel i's squared error
// against the converged truth (mean over R, G, B; for relMSE each channel divided by truth^2 + 1e-2), N pixels,
//     T(S) = sqrt(1/N * sum of e_i over the pixels outside S)          (T(empty) is the RMSE of the picture):
//   rmseLow <= T(empty)
//   T(the unseenArea * N pixels of largest e_i) <= rmseHighTrimmed      whatever these pixels hold
//   T(empty) <= rmseHigh                                               if no undrawn pixel is worse than the worst one that was drawn by chance,
//                                                                      and no light that the reference missed in a drawn one than half as much again as what it
//                                                                      found
// An area unseenArea holds no drawn pixel with a chance of 5 %, so an error of any size may hide there; rmseHigh charges all of it
// with the largest squared error that a pixel drawn by chance (not for certain) showed. Where every pixel is drawn, it is 0.
// Blind spot: light that the reference's own parts practically never find (a caustic hit by one path in 10^6) is an error
// of the reference, not of the picture, and no figure here can show it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/vec.h"
#include "measure/parts.h"

namespace gobo {
inline namespace measure {

struct PixelEvidence {
  Vec3 picture;       ///< linear radiance
  TruthParts parts;   ///< independent, unbiased, made alike; may be far noisier than the error sought
  double chance = 1;  ///< with which the pixel was drawn; 1: certain
};

struct CertificateFigures {
  double rmse = 0, rmseLow = 0, rmseHigh = 0;  ///< 95 % interval
  double rmseHighTrimmed = 0;                  ///< without the worst unseenArea of the picture
  double rmseStandardError = 0;                ///< sqrt(m + se) - sqrt(m), m = max(MSE, 0): se / (2 RMSE) for small se
  double relMse = 0, relMseLow = 0, relMseHigh = 0, relMseHighTrimmed = 0;
  double unseenArea = 0;  ///< share of the picture, at most 1 (plus what evidence that is not finite stands for)
  size_t certain = 0;     ///< evidence of chance 1
  size_t nonFinite = 0;   ///< evidence with a NaN or Inf: left out of the other figures
};

/// `evidence` in any order; `pixels` of the whole picture. The RMSE's interval is the square root of the MSE's
/// (measure/confidence.h, drawnInterval). relMSE divides by a noisy truth, which biases it; its interval is the hull of those of
/// two estimators of different bias (measure/parts.h), widened on either side by their distance.
CertificateFigures certify(const std::vector<PixelEvidence>& evidence, uint64_t pixels);

}  // namespace measure
}  // namespace gobo
