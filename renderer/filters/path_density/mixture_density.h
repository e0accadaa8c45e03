// SPDX-License-Identifier: Apache-2.0
// Path density by a compact density: each tile of the film a mixture of few Gaussians over film and colour (gaussian_mixture.h), as the source foresees for
// more samples than can be stored: a mean and a covariance stand for them. The density is asked for as the number of samples around one, under a Gaussian K on
// the film and in colour, which a mixture has in closed form; a sample leaves itself out of its tile's mixture by its own share r_j of each component:
//   c(x) = sum_j (N_j - r_j) sqrt(|K| / |S_j + K|) exp(-(x - m_j)^T (S_j + K)^-1 (x - m_j) / 2)
// over the tile and those around it. K has a variance of 4.5 on the film, under which even light of n samples a pixel has c = 9 pi n, as many as lie in the
// disc of radius 3; so that
//   sigma = 2 sqrt(k / c)
// is the exact search's 2/3 sqrt(k / (pi n)) there, and the same thresholds keep the same even light. The colour's variance is 1 (h_c).
// Memory of the density: 472 bytes a component with what is worked out once, 59 a pixel with 8 in tiles of 8 x 8; it does not grow with samples, but fitting it
// reads them several times.
#pragma once

#include "filters/path_density/gaussian_mixture.h"
#include "filters/path_density/path_density.h"

namespace gobo::pathdensity {

struct MixtureSettings {
  int tile = 8;    ///< pixels along a side, 4 to 64: c looks no further than the next tile
  MixtureFit fit;  ///< of a tile
};

/// sigma of each sample in the view's order; at most 1e6. Errors: as rejectOutliers(), and settings out of range.
Result<std::vector<float>> mixtureSigmasOf(const SampleView& samples, const Settings& settings, const MixtureSettings& mixture, LightTerm term,
                                           const TaskArena& arena, const StopToken& stop = {});

/// As rejectOutliers(). `components`, if there is: how many Gaussians with a weight there were. Errors: as above; borders are not corrected here.
Result<Filtered> rejectByMixture(const SampleView& samples, const Settings& settings, const MixtureSettings& mixture, const TaskArena& arena,
                                 const StopToken& stop = {}, uint64_t* components = nullptr);

}  // namespace gobo::pathdensity
