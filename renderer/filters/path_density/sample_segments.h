// SPDX-License-Identifier: Apache-2.0
// Mean shift on samples (Comaniciu & Meer 2002; the source names it as a way on): from its own place and colour each sample goes to the mean place and colour
// of the samples within two windows, on the film and in colour, until it stays; samples near each other whose ways end in colours near each other are one
// segment, and with them what is joined to either. As a rejection of outliers: a sample counts by how many others its segment has, c, with sigma = 2 sqrt(k /
// c), so that k others are enough and 4 k / 9 too few, as in a disc of radius 3 of even light (path_density.h). A rare colour whose samples reach each other is
// one segment however thin, and stays: that is the difference to a density. Time: every step looks at all samples of the window on the film. Memory: some 70
// bytes a sample beside the samples. The same bits for any number of threads.
#pragma once

#include "filters/path_density/path_density.h"

namespace gobo::pathdensity {

struct SegmentSettings {
  float film = 1.5f;    ///< radius of the window on the film, h_x; (0, 8]
  float colour = 1.0f;  ///< and in colour, h_c; > 0
  float join = 0.5f;    ///< what is near: that share of both windows; (0, 1]
  int most = 10;        ///< steps, >= 0
};

struct Segments {
  std::vector<uint32_t> of;    ///< of each sample in the view's order: the first sample of its segment
  std::vector<uint32_t> size;  ///< of each sample: how many its segment has, itself too
};

/// Errors: InvalidArgument: settings out of range; Cancelled.
Result<Segments> segmentSamples(const SampleView& samples, const Settings& settings, const SegmentSettings& segments, LightTerm term, const TaskArena& arena,
                                const StopToken& stop = {});

/// As rejectOutliers(). Borders are not corrected.
Result<Filtered> rejectSmallSegments(const SampleView& samples, const Settings& settings, const SegmentSettings& segments, const TaskArena& arena,
                                     const StopToken& stop = {});

}  // namespace gobo::pathdensity
