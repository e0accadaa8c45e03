// SPDX-License-Identifier: Apache-2.0
// Named techniques with their parameters, as tables and plots list them.
#pragma once

#include <string>
#include <vector>

#include "gobo/v1/filters.pb.h"

namespace gobo::shadowbench {

struct Setting {
  std::string family;     ///< series of a plot: "convolution"
  std::string parameter;  ///< what is swept and its value: "M=8 bytes"
  v1::ShadowTechnique technique;
  int viewSamples = 1;  ///< rays that supersample the camera (family "rays")
  int bilateral = 0;    ///< radius of the joint bilateral filter on the result; 0: none; -1: 3 a-trous levels
  std::string label() const { return family + " " + parameter; }
};

v1::ShadowTechnique shadowMap(int resolution, int blur);  ///< only `map` set
/// Convolution of order M, exponential with c (logarithmic above 80), ...: on a map.
v1::ShadowTechnique convolution(int order, int resolution, int blur, bool bytes = false);
v1::ShadowTechnique exponential(double c, int resolution, int blur, bool threshold = false);
v1::ShadowTechnique variance(int resolution, int blur, double bleedingReduction = -1);
v1::ShadowTechnique percentageCloser(int resolution, int blur, bool skip = true);  ///< GAUSSIAN
v1::ShadowTechnique percentageCloserTaps(int resolution, int taps);                ///< REGULAR
v1::ShadowTechnique rayTraced(int samples);
v1::ShadowTechnique axisAligned(int samples);               ///< rays of a view sample in a penumbra
v1::ShadowTechnique publishedAxisAligned(int meanSamples);  ///< as its source has it; 0: mu = 1
v1::ShadowTechnique convolutionSoft(int order, int resolution, v1::ShadowMapSettings::Lookup lookup);
v1::ShadowTechnique percentageCloserSoft(int resolution, int search, int filter);  ///< search 0: dense

std::vector<Setting> hardSettings(bool quick);
std::vector<Setting> softSettings(bool quick);

}  // namespace gobo::shadowbench
