// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/streaming_density.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "filters/path_density/spread.h"

namespace gobo::pathdensity {

namespace {

Status stoppedStream() { return {Code::Cancelled, "stopped"}; }
float floatOf(double v) { return float(std::clamp(v, -3.4e38, 3.4e38)); }

}  // namespace

Result<StreamingDensity> StreamingDensity::create(int width, int height, const Settings& settings, const GridSettings& grid) {
  SampleView none;
  none.width = width;
  none.height = height;
  GOBO_TRY(checkSettings(none, settings));
  if (grid.cell < 1 || double(grid.cell) > std::max(1.0, 2 * double(settings.metric.filmScale)))
    return invalidArgument("streaming density: cells of " + std::to_string(grid.cell) + " pixels are not from one pixel to two film scales");
  if (grid.bins < ColourGrid::kFewestBins || grid.bins > 4096)
    return invalidArgument("streaming density: " + std::to_string(grid.bins) + " bins a cell are not in [" + std::to_string(ColourGrid::kFewestBins) +
                           ", 4096]");
  if (settings.judged == Judged::Apart || settings.border == Border::Correct || settings.density || settings.first > 0 || settings.treeEpsilon >= 0)
    return invalidArgument("streaming density: terms judged apart, corrected borders, density maps, first samples and trees are for stored samples");
  return StreamingDensity(width, height, settings, grid);
}

StreamingDensity::StreamingDensity(int width, int height, const Settings& settings, const GridSettings& grid)
    : width_(width),
      height_(height),
      settings_(settings),
      judged_(settings.judged == Judged::Together ? LightTerm::All : LightTerm::Indirect),
      grid_(width, height, grid.cell, grid.bins),
      pixels_(size_t(width) * size_t(height)) {}

size_t StreamingDensity::bytes() const { return grid_.bytes() + pixels_.capacity() * sizeof(Pixel); }

Status StreamingDensity::checkPass(const SampleView& pass) const {
  if (pass.width != width_ || pass.height != height_)
    return invalidArgument("streaming density: a pass of " + std::to_string(pass.width) + " x " + std::to_string(pass.height) + " pixels for a picture of " +
                           std::to_string(width_) + " x " + std::to_string(height_));
  return checkSettings(pass, settings_);
}

bool StreamingDensity::points(const SampleView& pass, SampleBins& bins, MetricPoints& points, const TaskArena& arena, const StopToken& stop) const {
  bins = binSamples(pass, stop);
  return !stop.stopRequested() && makePoints(pass, bins, settings_.metric, judged_, points, arena, stop);
}

Status StreamingDensity::count(const SampleView& pass, const TaskArena& arena, const StopToken& stop) {
  GOBO_TRY(checkPass(pass));
  if (weighing_) return {Code::FailedPrecondition, "streaming density: samples to count after some were weighed"};
  SampleBins bins;
  MetricPoints p;
  if (!points(pass, bins, p, arena, stop)) return stoppedStream();
  std::atomic<bool> full{false};
  const bool complete = arena.parallelFor(
      size_t(grid_.rows()), 1,
      [&](size_t row, size_t) {
        const int y0 = int(row) * grid_.cell(), y1 = std::min(y0 + grid_.cell(), height_);
        for (int y = y0; y < y1 && !stop.stopRequested(); ++y)
          for (int x = 0; x < width_; ++x)
            for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i)
              if (!grid_.add(x, y, gridColourOf(p.l[i], p.a[i], p.b[i]))) full = true;
      },
      stop);
  if (!complete || stop.stopRequested()) return stoppedStream();
  if (full) return {Code::ResourceExhausted, "streaming density: a cell has more samples of one colour than it can count"};
  counted_ += pass.size();
  return {};
}

Status StreamingDensity::weigh(const SampleView& pass, const TaskArena& arena, const StopToken& stop) {
  GOBO_TRY(checkPass(pass));
  if (!weighing_) {
    if (counted_ > 0) GOBO_TRY(checkNeighbours(double(counted_) / (double(width_) * double(height_)), width_, height_, settings_));
    grid_.settle(arena);
    weighing_ = true;
  }
  SampleBins bins;
  MetricPoints p;
  if (!points(pass, bins, p, arena, stop)) return stoppedStream();
  const bool rejects = !std::isinf(settings_.soft);
  const auto pixel = [&](int x, int y, ColourGrid::Scratch& scratch) {
    Pixel& sums = pixels_[size_t(y) * size_t(width_) + size_t(x)];
    for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) {
      const size_t at = bins.order[i];
      // What no weight is decided by is worth its distance only while the pixel has nothing better.
      const float reject = sums.weights > 0 ? settings_.hard : std::max(settings_.hard, kMostSigma);
      const float sigma = rejects ? grid_.meanDistance(pass.film[2 * at], pass.film[2 * at + 1], gridColourOf(p.l[i], p.a[i], p.b[i]), settings_.neighbours,
                                                       settings_.metric.filmScale, {settings_.soft, reject}, scratch)
                                  : 0.0f;
      const double w = double(weightOf(sigma, settings_));
      const bool best = sums.weights <= 0 && w <= 0 && (sums.bestSigma < 0 || sigma < sums.bestSigma);
      if (best) sums.bestSigma = sigma;
      sums.weights += w;
      sums.samples += 1;
      for (size_t c = 0; c < 3; ++c) {
        const double direct = double(pass.directAt(3 * at + c)), light = double(pass.indirect[3 * at + c]) + (judged_ == LightTerm::All ? direct : 0.0);
        sums.weighed[c] += w * light;
        sums.all[c] += light;
        if (judged_ != LightTerm::All) sums.unjudged[c] += direct;
        if (best) sums.best[c] = floatOf(light);
      }
    }
  };
  const bool complete = arena.parallelFor(
      size_t(height_), 1,
      [&](size_t y, size_t) {
        ColourGrid::Scratch scratch;
        for (int x = 0; x < width_ && !stop.stopRequested(); ++x) pixel(x, int(y), scratch);
      },
      stop);
  if (!complete || stop.stopRequested()) return stoppedStream();
  weighed_ += pass.size();
  return {};
}

Result<Filtered> StreamingDensity::finish(const TaskArena& arena, const StopToken& stop) {
  if (counted_ != weighed_)
    return Status(Code::FailedPrecondition,
                  "streaming density: " + std::to_string(counted_) + " samples were counted and " + std::to_string(weighed_) + " weighed");
  Filtered out;
  std::vector<double> kept(3 * pixels_.size(), 0.0), rejected(kept.size(), 0.0);
  out.weight.assign(pixels_.size(), 1.0f);
  for (size_t i = 0; i < pixels_.size(); ++i) {
    const Pixel& p = pixels_[i];
    if (p.samples <= 0) {
      ++out.empty;
      continue;
    }
    out.weight[i] = float(p.weights / p.samples);
    if (p.weights <= 0) ++out.allRejected;
    for (size_t c = 0; c < 3; ++c) {
      kept[3 * i + c] = p.weights > 0 ? p.weighed[c] / p.weights : double(p.best[c]);
      // Exactly nothing where every sample is whole.
      rejected[3 * i + c] = p.weights >= p.samples ? 0.0 : p.all[c] / p.samples - kept[3 * i + c];
    }
  }
  if (settings_.spread > 0 && !spreadRejected(kept, rejected, width_, height_, double(settings_.spread), double(settings_.mostSpread), arena, stop))
    return stoppedStream();
  out.rgb.resize(kept.size());
  out.rejected.resize(kept.size());
  for (size_t i = 0; i < kept.size(); ++i) {
    const Pixel& p = pixels_[i / 3];
    out.rgb[i] = floatOf(kept[i] + (p.samples > 0 ? p.unjudged[i % 3] / p.samples : 0.0));
    out.rejected[i] = floatOf(rejected[i]);
  }
  return out;
}

}  // namespace gobo::pathdensity
