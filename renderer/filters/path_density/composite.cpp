// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/composite.h"

#include <algorithm>
#include <atomic>

#include "filters/path_density/spread.h"

namespace gobo::pathdensity {

namespace {

constexpr double kMostOut = 3.4e38;  // a float holds it

}  // namespace

Composite::Composite(const SampleView& samples, const SampleBins& bins, const Settings& settings) : samples_(samples), bins_(bins), settings_(settings) {
  const size_t pixels = size_t(samples.width) * size_t(samples.height);
  sumKept_.assign(3 * pixels, 0.0);
  sumFirst_.assign(settings.first > 0 ? 3 * pixels : 0, 0.0);
  sumRejected_.assign(3 * pixels, 0.0);
  weight_.assign(pixels, 0.0);
  density_.assign(settings.density ? pixels : 0, 0.0);
}

bool Composite::add(LightTerm term, const std::vector<float>& sigma, const ExactSigma& exact, bool judged, const TaskArena& arena, const StopToken& stop) {
  if (judged) ++terms_;
  kept_.assign(sumKept_.size(), 0.0);
  first_.assign(sumFirst_.size(), 0.0);
  rejected_.assign(sumKept_.size(), 0.0);
  std::atomic<uint64_t> allRejected{0};
  const auto light = [&](size_t i, size_t c) {
    const double direct = term == LightTerm::Indirect ? 0.0 : double(samples_.directAt(3 * i + c));
    return direct + (term == LightTerm::Direct ? 0.0 : double(samples_.indirect[3 * i + c]));
  };
  const auto pixel = [&](int x, int y, NeighbourSearch::Scratch& scratch) {
    const size_t begin = bins_.pixelBegin(x, y), end = bins_.pixelEnd(x, y), p = size_t(y) * size_t(samples_.width) + size_t(x);
    if (begin == end) return;
    double weights = 0, weightsOfFirst = 0, density = 0, kept[3] = {}, first[3] = {}, missing[3] = {};
    for (size_t i = begin; i < end; ++i) {
      const double w = double(weightOf(sigma[i], settings_));
      weights += w;
      if (settings_.density) density += double(densityOf(sigma[i]));
      for (size_t c = 0; c < 3; ++c) kept[c] += w * light(bins_.order[i], c);
      if (i + 1 - begin != size_t(settings_.first)) continue;
      weightsOfFirst = weights;
      std::copy_n(kept, 3, first);
    }
    if (weights > 0) {
      for (double& k : kept) k /= weights;
    } else {
      ++allRejected;
      size_t best = begin;
      float least = exact(begin, scratch);
      for (size_t i = begin + 1; i < end; ++i) {
        const float s = exact(i, scratch);
        if (s < least) least = s, best = i;
      }
      for (size_t c = 0; c < 3; ++c) kept[c] = light(bins_.order[best], c);
    }
    // sum L / n - kept, as the sum over what is missing of how far it is from what is kept: exactly 0 where nothing is.
    const bool whole = weights >= double(end - begin);
    for (size_t i = begin; i < end && !whole; ++i) {
      const double m = weights > 0 ? 1.0 - double(weightOf(sigma[i], settings_)) : 1.0;
      for (size_t c = 0; c < 3; ++c) missing[c] += m * (light(bins_.order[i], c) - kept[c]);
    }
    const double n = double(end - begin);
    for (size_t c = 0; c < 3; ++c) {
      kept_[3 * p + c] = kept[c];
      if (settings_.first > 0) first_[3 * p + c] = weightsOfFirst > 0 ? first[c] / weightsOfFirst : kept[c];
      rejected_[3 * p + c] = missing[c] / n;
    }
    if (!judged) return;
    weight_[p] += weights / n;
    if (settings_.density) density_[p] += density / n;
  };
  const bool complete = arena.parallelFor(
      size_t(samples_.height), 1,
      [&](size_t y, size_t) {
        NeighbourSearch::Scratch scratch;
        for (int x = 0; x < samples_.width; ++x) {
          if ((x & 15) == 0 && stop.stopRequested()) return;
          pixel(x, int(y), scratch);
        }
      },
      stop);
  out_.allRejected += allRejected;
  if (!complete || stop.stopRequested()) return false;
  const std::vector<double> before = settings_.first > 0 ? kept_ : std::vector<double>();
  if (judged && settings_.spread > 0 &&
      !spreadRejected(kept_, rejected_, samples_.width, samples_.height, double(settings_.spread), double(settings_.mostSpread), arena, stop))
    return false;
  for (size_t i = 0; i < sumFirst_.size(); ++i) sumFirst_[i] += before[i] != 0 ? first_[i] * (kept_[i] / before[i]) : first_[i];
  for (size_t i = 0; i < sumKept_.size(); ++i) {
    sumKept_[i] += kept_[i];
    sumRejected_[i] += rejected_[i];
  }
  return true;
}

/// The mean of what is in the smallest square around an empty pixel that holds anything: 3 x 3, 5 x 5, 9 x 9 ...
void Composite::fillEmpty() {
  const int width = samples_.width, height = samples_.height;
  const auto full = [&](int x, int y) { return bins_.pixelBegin(x, y) < bins_.pixelEnd(x, y); };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (full(x, y)) continue;
      const size_t p = size_t(y) * size_t(width) + size_t(x);
      ++out_.empty;
      out_.weight[p] = 1;
      double sum[3] = {};
      size_t found = 0;
      for (int r = 1; found == 0 && r < 2 * std::max(width, height); r *= 2)
        for (int v = std::max(y - r, 0); v <= std::min(y + r, height - 1); ++v)
          for (int u = std::max(x - r, 0); u <= std::min(x + r, width - 1); ++u) {
            if (!full(u, v)) continue;
            ++found;
            for (size_t c = 0; c < 3; ++c) sum[c] += sumKept_[3 * (size_t(v) * size_t(width) + size_t(u)) + c];
          }
      for (size_t c = 0; c < 3 && found > 0; ++c) out_.rgb[3 * p + c] = float(std::clamp(sum[c] / double(found), -kMostOut, kMostOut));
      for (size_t c = 0; c < 3 && !out_.first.empty(); ++c) out_.first[3 * p + c] = out_.rgb[3 * p + c];
    }
}

Filtered Composite::finish() {
  const auto toFloats = [](const std::vector<double>& from, double scale) {
    std::vector<float> to(from.size());
    for (size_t i = 0; i < from.size(); ++i) to[i] = float(std::clamp(from[i] * scale, -kMostOut, kMostOut));
    return to;
  };
  out_.rgb = toFloats(sumKept_, 1.0);
  out_.first = toFloats(sumFirst_, 1.0);
  out_.rejected = toFloats(sumRejected_, 1.0);
  out_.weight = toFloats(weight_, 1.0 / std::max(terms_, 1));
  if (terms_ == 0) std::fill(out_.weight.begin(), out_.weight.end(), 1.0f);
  out_.density = toFloats(density_, 1.0 / std::max(terms_, 1));
  fillEmpty();
  return std::move(out_);
}

}  // namespace gobo::pathdensity
