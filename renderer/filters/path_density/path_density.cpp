// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/path_density.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>

#include "filters/path_density/composite.h"
#include "filters/path_density/neighbour_search.h"
#include "filters/path_density/product_tree.h"
#include "formulas/path_density.glsl.h"

namespace gobo::pathdensity {

namespace {

constexpr float kBorderDisc = 3.0f;  // h_x: the radius of k neighbours at which even light begins to be rejected (sigma = 2)

std::string numberText(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", v);
  return text;
}

/// Area of the disc of `radius` around (x, y) that lies in [0, width] x [0, height]; Simpson's rule over y.
double discInside(double x, double y, double radius, double width, double height) {
  const double y0 = std::max(0.0, y - radius), y1 = std::min(height, y + radius);
  constexpr int kStrips = 32;
  double sum = 0;
  for (int i = 0; i <= kStrips; ++i) {
    const double v = y0 + (y1 - y0) * i / kStrips, half = std::sqrt(std::max(0.0, radius * radius - (v - y) * (v - y)));
    const double chord = std::max(0.0, std::min(width, x + half) - std::max(0.0, x - half));
    sum += chord * (i == 0 || i == kStrips ? 1 : i % 2 ? 4 : 2);
  }
  return sum * (y1 - y0) / (3 * kStrips);
}

Status checkRange(const char* name, double v, double lo, double hi) {
  if (v >= lo && v <= hi) return {};
  return invalidArgument(std::string("path density: ") + name + " = " + numberText(v) + " is not in [" + numberText(lo) + ", " + numberText(hi) + "]");
}
/// k of a sample: fewer near the border where that is corrected.
class NeighbourCount {
 public:
  NeighbourCount(const SampleView& v, const Settings& s)
      : width_(v.width),
        height_(v.height),
        radius_(double(kBorderDisc) * double(s.metric.filmScale)),
        k_(s.neighbours),
        correct_(s.border == Border::Correct) {}
  int at(float x, float y) const {
    if (!correct_ || (x >= radius_ && y >= radius_ && x <= width_ - radius_ && y <= height_ - radius_)) return k_;
    const double share = discInside(double(x), double(y), radius_, width_, height_) / (M_PI * radius_ * radius_);
    return std::max(1, int(std::lround(share * k_)));
  }

 private:
  double width_, height_, radius_;
  int k_;
  bool correct_;
};

/// sigma of every sample, sorted; between the bounds.
struct Sigmas {
  const SampleView& samples;
  const SampleBins& bins;
  const Settings& settings;
  const TaskArena& arena;
  const StopToken& stop;

  bool measure(const MetricPoints& points, const OutcomeBounds& bounds, std::vector<float>& sigma) const {
    sigma.resize(points.size());
    const NeighbourCount count(samples, settings);
    const NeighbourSearch search(bins, points, settings.metric.filmScale);
    const auto tree = settings.treeEpsilon >= 0 ? std::make_unique<ProductTree>(points) : nullptr;
    return arena.parallelFor(
               points.size(), 1 << 11,
               [&](size_t begin, size_t end) {
                 NeighbourSearch::Scratch scratch;
                 for (size_t i = begin; i < end; ++i) {
                   if ((i & 63) == 0 && stop.stopRequested()) break;
                   const size_t at = bins.order[i];
                   const int k = count.at(samples.film[2 * at], samples.film[2 * at + 1]);
                   sigma[i] = tree ? treeMean(*tree, i, k, scratch) : search.meanDistance(i, k, bounds, scratch);
                 }
               },
               stop) &&
           !stop.stopRequested();
  }
  /// To its end.
  float exact(const NeighbourSearch& search, size_t i, NeighbourSearch::Scratch& scratch) const {
    const size_t at = bins.order[i];
    return search.meanDistance(i, NeighbourCount(samples, settings).at(samples.film[2 * at], samples.film[2 * at + 1]), {}, scratch);
  }

 private:
  float treeMean(const ProductTree& tree, size_t i, int k, NeighbourSearch::Scratch& scratch) const {
    tree.nearest(i, k, settings.treeEpsilon, scratch.neighbours);
    double sum = 0;
    for (const Neighbour& n : scratch.neighbours) sum += double(n.distance);
    return scratch.neighbours.empty() ? 0.0f : float(sum / double(scratch.neighbours.size()));
  }
};

}  // namespace

int mostNeighbours(double samplesPerPixel, int width, int height, const Settings& s) {
  // Where fewest are near: in a corner; corrected counts are right for the whole disc everywhere.
  const double radius = double(kBorderDisc) * double(s.metric.filmScale), disc = M_PI * radius * radius;
  const double area = s.border == Border::Correct ? disc : discInside(0, 0, radius, width, height);
  // The law's constants are for soft = 2: sigma grows as the root of k.
  const double soft = std::min(double(s.soft) / 2, 1e3);
  return int(std::min(area * samplesPerPixel * soft * soft, 1e9));
}

Status checkSettings(const SampleView& v, const Settings& s) {
  GOBO_TRY(checkRange("film scale", double(s.metric.filmScale), 1e-3, 1e3));
  GOBO_TRY(checkRange("colour scale", double(s.metric.colourScale), 1e-3, 1e6));
  GOBO_TRY(checkRange("white", double(s.metric.white), double(1e-12f), 1e12));  // the float's own value, which is below 1e-12
  GOBO_TRY(checkRange("neighbours", s.neighbours, 1, 1 << 20));
  GOBO_TRY(checkRange("first samples", s.first, 0, 1 << 30));
  GOBO_TRY(checkRange("spread", double(s.spread), 0, 1000));
  GOBO_TRY(checkRange("most spread", double(s.mostSpread), 0, 1e6));
  if (!(s.soft >= 0) || !(s.hard >= s.soft))
    return invalidArgument("path density: thresholds " + numberText(double(s.soft)) + " and " + numberText(double(s.hard)) + " are not 0 <= soft <= hard");
  if (v.width < 1 || v.height < 1) return invalidArgument("path density: a picture of " + std::to_string(v.width) + " x " + std::to_string(v.height));
  if (v.size() >= 0xffffffffu) return invalidArgument("path density: more than 2^32 - 2 samples");
  if (v.correlated)
    return invalidArgument(
        "path density: the samples are correlated (a Markov chain's): one resembles the next whatever it shows, so that noise would pass for light");
  return {};
}

Status checkNeighbours(double perPixel, int width, int height, Settings& s) {
  const bool all = std::isinf(s.soft);
  const int most = mostNeighbours(perPixel, width, height, s);
  if (s.fewer) s.neighbours = std::clamp(most, 1, s.neighbours);
  if (!all && !s.fewer && s.neighbours > most)
    return invalidArgument("path density: " + std::to_string(s.neighbours) + " neighbours are too many for " + numberText(perPixel) +
                           " samples a pixel: even light would be rejected from " + std::to_string(most) + " on" +
                           (s.border == Border::Refuse ? " (in the corners of the picture; four times as many pass with borders corrected)" : ""));
  return {};
}

float weightOf(float sigma, const Settings& s) { return formulas::densityRamp(sigma, s.soft, s.hard); }
float densityOf(float sigma) { return sigma >= kMostSigma ? 0.0f : 0.39894228f * std::exp(-0.5f * sigma * sigma); }

Result<std::vector<float>> sigmasOf(const SampleView& samples, const Settings& settings, LightTerm term, const TaskArena& arena, const StopToken& stop) {
  GOBO_TRY(checkSettings(samples, settings));
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  MetricPoints points;
  std::vector<float> sorted, sigma(samples.size());
  if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) || !Sigmas{samples, bins, settings, arena, stop}.measure(points, {}, sorted))
    return Status(Code::Cancelled, "stopped");
  for (size_t i = 0; i < sigma.size(); ++i) sigma[bins.order[i]] = sorted[i];
  return sigma;
}

Status checkNeighbours(const SampleView& samples, Settings& settings) {
  if (samples.size() == 0) return {};
  return checkNeighbours(double(samples.size()) / (double(samples.width) * double(samples.height)), samples.width, samples.height, settings);
}

Result<Filtered> rejectOutliers(const SampleView& samples, const Settings& asked, const TaskArena& arena, const StopToken& stop) {
  GOBO_TRY(checkSettings(samples, asked));
  Settings settings = asked;
  GOBO_TRY(checkNeighbours(samples, settings));
  const bool all = std::isinf(settings.soft);
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  Composite composite(samples, bins, settings);
  const Sigmas sigmas{samples, bins, settings, arena, stop};
  OutcomeBounds bounds{settings.soft, settings.hard};
  if (settings.density) bounds = {-1.0f, std::max(settings.hard, kMostSigma)};
  MetricPoints points;
  std::vector<float> sigma;
  const auto add = [&](LightTerm term, bool judged) {
    if (!judged) sigma.assign(samples.size(), 0.0f);
    else if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) || !sigmas.measure(points, bounds, sigma)) return false;
    const auto exact = [&](size_t i, NeighbourSearch::Scratch& scratch) {
      return sigmas.exact(NeighbourSearch(bins, points, settings.metric.filmScale), i, scratch);
    };
    return composite.add(term, sigma, exact, judged, arena, stop);
  };
  const bool judges = !all || settings.density;
  bool complete = true;
  if (settings.judged == Judged::Together) complete = add(LightTerm::All, judges);
  else complete = (samples.direct.empty() || add(LightTerm::Direct, judges && settings.judged == Judged::Apart)) && add(LightTerm::Indirect, judges);
  if (!complete) return Status(Code::Cancelled, "stopped");
  return composite.finish();
}

}  // namespace gobo::pathdensity
