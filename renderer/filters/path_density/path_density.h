// SPDX-License-Identifier: Apache-2.0
// Path-density outlier rejection (DeCoro, Weyrich, Rusinkiewicz 2010, "Density-based outlier rejection in Monte Carlo rendering"): a sample whose light no
// other samples nearby resemble counts less, or not at all.
//   sigma = mean distance (metric.h) to the k nearest other samples
//   w     = 1 for sigma <= soft, 0 for sigma >= hard, a smoothstep between
//   out(pixel) = sum w L / sum w over the samples of the pixel;   rejected = sum L / n - out
// Direct and indirect light may be judged apart and added, so that noisy indirect light costs no direct light.
// What it does where samples are spread evenly, n a pixel (h_x = 1):
//   even light:   sigma = 2/3 sqrt(k / (pi n)). All of it stays while k <= 9 pi n, in corners of the picture a quarter of that: k <= 7 n is asked for
//   a rare colour, of a share q of the samples, 3 h_c or more from the rest: kept for n q >= k / (9 pi), gone for n q <= 4 k / (81 pi)
// So it is biased: what is rare and right (caustics, small highlights) is missing until there are k / (9 pi q) samples a pixel; then it is there. Noise of less
// than some 2 h_c stays: that is for denoisers, behind it. Samples have to be independent: where one follows from another (Markov chains) noise
// corroborates itself.
// Time: neighbour_search.h. Memory: 44 bytes a sample.
#pragma once

#include <limits>
#include <vector>

#include "filters/path_density/metric.h"
#include "filters/path_density/path_samples.h"

namespace gobo::pathdensity {

/// Which light is judged.
enum class Judged : uint8_t {
  Apart,     ///< direct and indirect light, each by itself
  Indirect,  ///< direct light stays as it is: it has little noise, and small lamps and their mirror images look like outliers
  Together,  ///< their sum
};

/// What to do about the border of the picture, where a sample has fewer others around it.
enum class Border : uint8_t {
  Refuse,   ///< ask for as few neighbours as a corner has: k <= 7 n
  Correct,  ///< look for fewer neighbours there, by the share of the disc of 3 h_x that lies in the picture: k <= 28 n
};

struct Settings {
  Metric metric;
  int neighbours = 10;             ///< k
  bool fewer = false;              ///< more neighbours than mostNeighbours(): as many as that, at least one; else they are an error
  float soft = 2.0f, hard = 3.0f;  ///< soft infinite: nothing is rejected
  Judged judged = Judged::Indirect;
  Border border = Border::Refuse;
  int first = 0;              ///< > 0: a picture of the first so many samples of each pixel too, by the weights that they have among all
  bool density = false;       ///< the density map is asked for: every sigma to its end, which takes longer
  float spread = 8.0f;        ///< > 0: rejected light comes back under a Gaussian of that many pixels (spread.h), per term; 0: it does not
  float mostSpread = 1.0f;    ///< of what a pixel has kept
  float treeEpsilon = -1.0f;  ///< >= 0: by the k-d tree with that epsilon, a baseline
};

/// Densities below are taken for 0: sigma counts up to here.
inline constexpr float kMostSigma = 6.0f;

struct Filtered {
  std::vector<float> rgb;       ///< width * height * 3
  std::vector<float> rejected;  ///< RGB; rgb + rejected is the mean of all samples
  std::vector<float> first;     ///< RGB, if asked for; what is kept by them all where they have no weight
  std::vector<float> weight;    ///< mean over the pixel's samples and terms; 1 where there is no sample
  std::vector<float> density;   ///< mean of exp(-sigma^2 / 2) / sqrt(2 pi), if asked for; 0 where there is no sample
  uint64_t allRejected = 0;     ///< pixels (of each term) whose samples were all rejected: the one of least sigma stands for them
  uint64_t empty = 0;           ///< pixels without a sample: they show the mean of the next ones, by squares that grow, and reject nothing
};

/// k up to which even light stays whole, for n samples a pixel.
int mostNeighbours(double samplesPerPixel, int width, int height, const Settings& settings);

/// Of sigma.
float weightOf(float sigma, const Settings& settings);
float densityOf(float sigma);

/// What is wrong with settings for such samples: out of range, correlated samples, no picture.
Status checkSettings(const SampleView& samples, const Settings& settings);
/// Lowers `settings.neighbours` to mostNeighbours() where fewer will do; an error where they are too many.
Status checkNeighbours(double samplesPerPixel, int width, int height, Settings& settings);
/// The same by what `samples` are on average; of no samples nothing is asked.
Status checkNeighbours(const SampleView& samples, Settings& settings);

/// Errors: InvalidArgument with what is wrong: settings out of range, more neighbours than mostNeighbours(), correlated samples; Cancelled.
Result<Filtered> rejectOutliers(const SampleView& samples, const Settings& settings, const TaskArena& arena, const StopToken& stop = {});

/// sigma of each sample in the view's order, to its end: for tests and measurements. Errors: as above, but for the number of neighbours.
Result<std::vector<float>> sigmasOf(const SampleView& samples, const Settings& settings, LightTerm term, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::pathdensity
