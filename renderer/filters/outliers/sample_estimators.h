// SPDX-License-Identifier: Apache-2.0
// Estimators of a pixel from its samples that resist outliers: what path density (filters/path_density) is measured against. All by channel, in double; pixels
// without a sample are black. Pictures are RGB, width * height * 3.
#pragma once

#include <cstdint>
#include <vector>

#include "base/task_arena.h"
#include "filters/path_density/sample_bins.h"

namespace gobo::outliers {

using pathdensity::SampleBins;
using pathdensity::SampleView;

/// How they run: row by row on these threads, on the caller's where there are none. A result is of no use once `stop` has fired.
struct Rows {
  const TaskArena* arena = nullptr;
  StopToken stop = {};
};

/// Of all samples: no outlier is resisted.
std::vector<float> meanPicture(const SampleView& samples, const SampleBins& bins, const Rows& rows = {});

/// The mean without the lowest and the highest `share` of the samples (Lee & Redner 1990), fractions of a sample counting as that. 0: the mean; 0.5: the
/// median. Withstands up to `share` of outliers; loses energy wherever light is skewed.
std::vector<float> trimmedMean(const SampleView& samples, const SampleBins& bins, double share, const Rows& rows = {});

/// Adaptive median of means (G-MoN; Buisine, Delepoulle, Renaud 2021, "Firefly removal in Monte Carlo rendering with adaptive median of means"): samples go
/// round robin into M buckets, M the largest odd number up to `buckets` and the number of samples. Of the sorted means floor(G M / 2) are left out at each end,
/// G their Gini coefficient: none where they are alike, all but the median where one holds all.
std::vector<float> adaptiveMedianOfMeans(const SampleView& samples, const SampleBins& bins, int buckets = 21, const Rows& rows = {});

/// Gini coefficient of values sorted upwards, in [0, 1]; 0 if their sum is not positive.
double giniCoefficient(const std::vector<double>& sorted);

/// After Zirr, Hanika & Dachsbacher 2018, "Re-weighting firefly samples for improved finite-sample Monte Carlo estimates": samples are split by luminance into
/// cascades `base` apart, each between its two neighbours, and a cascade of a pixel counts by how many samples of about its brightness the 3 x 3 pixels around
/// have had: not at all for one, fully from `enough` on. The lowest cascade always counts, the highest reach 3e38. All energy comes back as samples grow.
struct Reweighting {
  float start = 1.0f;   ///< luminance of the lowest cascade
  float base = 8.0f;    ///< > 1
  float enough = 4.0f;  ///< samples, > 1
};
std::vector<float> reweightedMean(const SampleView& samples, const SampleBins& bins, const Reweighting& settings = {}, const Rows& rows = {});
/// The same of some of the samples, cascades counting by what all of them say.
std::vector<float> reweightedPart(const SampleView& samples, const SampleBins& bins, const SampleBins& part, const Reweighting& settings = {},
                                  const Rows& rows = {});
/// Bytes that either holds at most beside its result, of so many samples in each pixel, whatever the threads. Smaller starts hold more.
uint64_t reweightingBytes(int width, int height, uint64_t samples, const Reweighting& settings);

}  // namespace gobo::outliers
