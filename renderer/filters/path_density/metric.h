// SPDX-License-Identifier: Apache-2.0
// The metric of path density: a sum of two Euclidean distances, on the film and between colours:
//   d(a, b) = |film_a - film_b| / h_x + |colour_a - colour_b| / h_c
// Colours are CIELAB of linear Rec.709 light with white D65 at luminance `white`. L* goes on above white (Y = 10, 100, 1000: 234, 522, 1144), and below
// black as it does above (point symmetry about zero light), so that negative light has a colour too. As a negative control: RGB, 100 at `white`.
#pragma once

#include <span>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "filters/path_density/sample_bins.h"

namespace gobo::pathdensity {

enum class ColourSpace : uint8_t { Lab, Rgb };

struct Metric {
  float filmScale = 1.0f;     ///< h_x in pixels: the width of the pixel filter
  float colourScale = 20.0f;  ///< h_c
  float white = 1.0f;         ///< luminance of white
  ColourSpace space = ColourSpace::Lab;
};

/// Which of a sample's light has the colour.
enum class LightTerm : uint8_t { All, Direct, Indirect };

/// Samples in scaled coordinates: their distances are d. Sorted as bins are.
struct MetricPoints {
  std::vector<float> x, y;     ///< film / h_x
  std::vector<float> l, a, b;  ///< colour / h_c
  size_t size() const { return x.size(); }
};

/// False: stopped.
bool makePoints(const SampleView& samples, const SampleBins& bins, const Metric& metric, LightTerm term, MetricPoints& points, const TaskArena& arena,
                const StopToken& stop);

/// CIELAB (L*, a*, b*) of n colours in place: r, g, b relative to white. Errors of the cube roots: 2e-7.
void labOf(float* r, float* g, float* b, int n);

}  // namespace gobo::pathdensity
