// SPDX-License-Identifier: Apache-2.0
// Ray-traced truth of one light's shadow and errors against it. Two kinds: at the pixel's centre, which is what every technique with one
// view sample is asked for, and over the pixel's area, with camera and light samples drawn jointly. Each has two independent halves:
// (V - A)(V - B) is free of the truth's own noise in the mean. Kept in out/bench/truth as EXR.
#pragma once

#include <string>
#include <vector>

#include "shadow/runner.h"

namespace gobo::shadowbench {

struct TruthImage {
  int width = 0, height = 0, samples = 0;
  /// Visibility weighted as the unshadowed light arrives (terms/visibility.h), in halves; 1 where nothing can be lit.
  std::vector<float> A, B;
  /// Mean visibility over the light, unweighted: the thesis's V_t (eq. 2.26), in halves.
  std::vector<float> flatA, flatB;
  /// Unoccluded weight (area lights: form factor up to a constant), 0 where the light cannot shine.
  std::vector<float> weight;
  size_t pixels() const { return A.size(); }
  float V(size_t p) const { return 0.5f * (A[p] + B[p]); }
};

struct Truth {
  TruthImage centre, pixel;
  std::vector<uint8_t> mask;  ///< a surface at the pixel's centre that the light can shine on
  std::vector<uint8_t> band;  ///< penumbra: truth in (0.02, 0.98), 2 pixels wider, inside the mask
  bool soft = false;
  /// What tables call the error: soft shadows against the centre's truth, hard ones (whose centre is 0 or 1) against the pixel's.
  const TruthImage& main() const { return soft ? centre : pixel; }
  const TruthImage& other() const { return soft ? pixel : centre; }
};

/// `samples` rays a pixel in each kind (a delta light's centre needs one). Reads and writes `folder`; an empty folder keeps nothing.
Result<Truth> makeTruth(Runner& runner, const std::string& name, int samples, const std::string& folder);

struct Errors {
  double rmse = 0, other = 0, penumbra = 0;  ///< against main(), other(), and main() inside the band
  double falseLit = 0, falseDark = 0;        ///< shares of the mask with V > truth + 0.1, V < truth - 0.1
};
Errors errorsOf(const Truth& truth, const std::vector<float>& V);
double rmse(const std::vector<uint8_t>& mask, const std::vector<float>& a, const std::vector<float>& b);
double rmseAgainst(const std::vector<uint8_t>& mask, const std::vector<float>& V, const std::vector<float>& A, const std::vector<float>& B);

/// Mean over the mask of the variance of V over `count` places of the camera inside the pixel.
Result<double> temporalVariance(Runner& runner, const Truth& truth, const v1::ShadowTechnique& t, int count);
/// The truth's own: the covariance over the places of two independent estimates.
Result<double> temporalVarianceOfTruth(Runner& runner, const Truth& truth, int count, int samples);

}  // namespace gobo::shadowbench
