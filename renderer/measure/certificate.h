// SPDX-License-Identifier: Apache-2.0
// Certificate statistics: the error of a picture from a random stratified subset of its pixels, each path traced in two
// independent halves. Pure functions of numbers: who traces the pixels is the caller's business (plan/engine.cpp).
// Derivation and measured coverage: docs/certificate.md.
//
// What is claimed, at 95 % over the choice of pixels and the noise of the halves. Let e_i be pixel i's squared error against
// the converged truth (mean over R, G, B; for relMSE each channel divided by truth^2 + 1e-2), N the number of pixels, and for a set S of pixels
//     T(S) = sqrt(1/N * sum of e_i over the pixels outside S)          (T(empty) is the RMSE of the picture).
// The certificate holds if T(S) lies in [rmseLow, rmseHigh] for some S of at most unseenArea * N pixels, where S may take a
// part of a pixel's error; that is, if
//     rmseLow <= T(empty)   and   T(the unseenArea * N pixels of largest e_i) <= rmseHigh.
// So rmseLow bounds the whole picture, and rmseHigh everything but an area unseenArea, which holds no drawn pixel with 5 %
// chance and so may hide an error of any size. Where the error does not hide in so small an area the interval also holds
// T(empty) itself at that rate.
// Blind spot: light that the reference's own halves practically never find (a caustic hit by one path in 10^6) is an error
// of the reference, not of the picture, and no figure here can show it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/vec.h"

namespace gobo {

/// Stratified random choice of about `fraction` of the pixels of a width x height picture, sorted by index: n =
/// round(fraction * N) pixels, at least min(64, N), at most N, all different. The pixels in a boustrophedon of nearly square
/// blocks are a ring that is cut into n strata at a random place; one pixel is drawn per stratum. Every pixel has the same
/// chance n/N exactly, so plain means are unbiased. Depends only on its arguments. Empty for an empty picture.
std::vector<uint32_t> certificatePixels(int width, int height, double fraction, uint64_t seed);

struct PixelEvidence { Vec3 picture, halfA, halfB; };   ///< linear radiance

struct CertificateFigures {
  double rmse = 0, rmseLow = 0, rmseHigh = 0;           ///< 95 % interval
  double rmseStandardError = 0;                         ///< sqrt(m + se) - sqrt(m), m = max(MSE, 0): se / (2 RMSE) for small se
  double relMse = 0, relMseLow = 0, relMseHigh = 0;
  double unseenArea = 0;                                ///< 3/n, at most 1 (plus the share of evidence that is not finite)
  size_t nonFinite = 0;                                 ///< evidence with a NaN or Inf: left out of the other figures
};
/// `evidence` in any order. The result depends on nothing else; `seed` is kept for methods that resample.
/// The halves must be independent and unbiased; they may be far noisier than the error sought. The RMSE's interval
/// is the square root of the MSE's. relMSE divides by a noisy truth, which biases it; its interval is the hull of
/// those of two estimators of different bias (measure/halves.h), widened on either side by half their distance.
CertificateFigures certify(const std::vector<PixelEvidence>& evidence, uint64_t seed);

}  // namespace gobo
