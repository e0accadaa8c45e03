// SPDX-License-Identifier: Apache-2.0
// Certificate statistics: the error of a picture from a random stratified subset of its pixels, each path traced in two
// independent halves. Pure functions of numbers: who traces the pixels is the caller's business (plan/engine.cpp).
#pragma once

#include <cstdint>
#include <vector>

#include "base/vec.h"

namespace gobo {

/// Stratified random choice of about `fraction` of the pixels of a width x height picture (one jittered pixel per
/// stratum), sorted by index. At least min(64, all) pixels. Depends only on its arguments.
std::vector<uint32_t> certificatePixels(int width, int height, double fraction, uint64_t seed);

struct PixelEvidence { Vec3 picture, halfA, halfB; };   ///< linear radiance

struct CertificateFigures {
  double rmse = 0, rmseLow = 0, rmseHigh = 0;           ///< 95 % interval
  double rmseStandardError = 0;
  double relMse = 0, relMseLow = 0, relMseHigh = 0;
  double unseenArea = 0;                                ///< 3/n
};
/// `evidence` in the order of certificatePixels (so neighbouring strata are neighbours). `seed` drives the bootstrap, if any.
CertificateFigures certify(const std::vector<PixelEvidence>& evidence, uint64_t seed);

}  // namespace gobo
