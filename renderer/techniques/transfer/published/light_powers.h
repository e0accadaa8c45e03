// SPDX-License-Identifier: Apache-2.0
// Which maxima become lights and what they give (digest of seed 004, B11).
//   Order and number: largest difference first (a greedy fit in the maximum norm), until one adds no more than a Weber fraction of all that were added.
//   Published power: P = E - harmonics at the maximum, times the solid angle of its disk. The harmonics already hold the source's flux, so it counts twice.
//   Residual power: what each disk gives is taken out of the harmonics. P + rest of the harmonics = E at every maximum, a linear system of the lights'
//   number; flux of rest and lights is the map's whatever comes out of it.
#pragma once

#include <cstddef>
#include <vector>

#include "techniques/transfer/published/peaks.h"

namespace gobo::transfer::published {

/// How many of `differences` (largest first, above 0) become lights; 0 < weber < 1. The next one is at most 1 / (k + 1) of the sum, so fewer than 1 / weber.
size_t elbow(const std::vector<double>& differences, double weber);

/// Integral of the Legendre polynomial P_l(cosine of the angle to the axis) over a disk of half angle `radius`, sr: what band l of a disk of radiance 1 has.
double diskCoefficient(int l, double radius);

struct PublishedLight {
  DVec3 direction{0, 1, 0};  ///< unit, towards it, map axes
  double radius = 0;         ///< half angle, radians
  double solidAngle = 0;     ///< 2 pi (1 - cos radius)
  double difference = 0;     ///< luminance, that it was ordered by
  DVec3 seen{0.0};           ///< radiance of the smoothed map there
  DVec3 radiance{0.0};       ///< of its disk, W/m^2/sr
  DVec3 irradiance{0.0};     ///< on a plane facing it: solid angle x radiance, W/m^2
};

/// Their radiance and irradiance by `harmonics` (bands^2 x 3, windowed). Channels are not below 0.
void givePublishedPower(std::vector<PublishedLight>& lights, const std::vector<double>& harmonics, int bands);

/// The same, and takes the lights out of the harmonics `full` (bands^2 x 3, no window), which are returned. `window`: factors by band, of what maxima are
/// compared with; the result has none. Radiances are within 0 and what is seen.
std::vector<double> giveResidualPower(std::vector<PublishedLight>& lights, const std::vector<double>& full, const std::vector<double>& window, int bands);

/// Takes disks of the lights' radiance out of harmonics without a window.
void takeOut(std::vector<double>& harmonics, int bands, const std::vector<PublishedLight>& lights);

}  // namespace gobo::transfer::published
