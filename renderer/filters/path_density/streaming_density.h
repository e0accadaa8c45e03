// SPDX-License-Identifier: Apache-2.0
// Path density of samples that are not kept: they come twice. A first stream is counted (colour_grid.h); in a second, of the same samples again, as a path
// tracer with the same seed brings them, each is weighed by what was counted around it and added to its pixel. Passes may be of any size; what they are cut
// into changes no bit as long as a pixel's samples come in the same order, nor does the number of threads. The same thresholds as the exact search
// (path_density.h), with sigma from the grid: right for whole cells and bins at the distances of 2 and more where weights are decided, too large for samples
// that have others close by, which are kept either way: in a corner up to 0.8 cells, so that cells are at most 2 h_x. Memory: 48 bytes a bin, 768 a cell of 16,
// and 104 bytes of sums a pixel, however many samples; beside it a pass's own samples. Not here: both terms judged apart, borders corrected,
// densities, a first part. Pixels without a sample are black.
#pragma once

#include "filters/path_density/colour_grid.h"
#include "filters/path_density/path_density.h"

namespace gobo::pathdensity {

struct GridSettings {
  int cell = 2;   ///< pixels along a side of a cell of the film, 1 to 2 h_x
  int bins = 16;  ///< of colour a cell, 8 to 4096
};

class StreamingDensity {
 public:
  /// Errors: InvalidArgument: settings, or a size, that are out of range or of no use here.
  static Result<StreamingDensity> create(int width, int height, const Settings& settings, const GridSettings& grid = {});

  /// A pass of the first stream. Errors: InvalidArgument: of another size, or correlated; ResourceExhausted: 8 million samples of one colour in a cell;
  /// FailedPrecondition: after weigh(); Cancelled. Of no use after an error.
  Status count(const SampleView& pass, const TaskArena& arena, const StopToken& stop = {});
  /// A pass of the second one. Errors: too many neighbours for the samples counted, and as above.
  Status weigh(const SampleView& pass, const TaskArena& arena, const StopToken& stop = {});
  /// Errors: FailedPrecondition: the streams had different numbers of samples; Cancelled.
  Result<Filtered> finish(const TaskArena& arena, const StopToken& stop = {});

  /// What is held between passes.
  size_t bytes() const;
  const ColourGrid& grid() const { return grid_; }

 private:
  StreamingDensity(int width, int height, const Settings& settings, const GridSettings& grid);
  Status checkPass(const SampleView& pass) const;
  bool points(const SampleView& pass, SampleBins& bins, MetricPoints& points, const TaskArena& arena, const StopToken& stop) const;

  /// Sums of a pixel, in the order of its samples.
  struct Pixel {
    double weighed[3] = {}, all[3] = {}, unjudged[3] = {}, weights = 0, samples = 0;
    float best[3] = {}, bestSigma = -1;  ///< the light of least sigma while no sample has a weight; -1: there is none
  };
  int width_, height_;
  Settings settings_;
  LightTerm judged_;
  ColourGrid grid_;
  std::vector<Pixel> pixels_;
  uint64_t counted_ = 0, weighed_ = 0;
  bool weighing_ = false;
};

}  // namespace gobo::pathdensity
