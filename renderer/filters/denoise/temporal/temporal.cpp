// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/temporal/temporal.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/temporal/neighbourhood.h"

namespace gobo::denoise {

namespace {

constexpr double kMostLight = 1e18;        // as in noisy_picture.h
constexpr double kMostLightSpread = 1e36;  // of its variance
constexpr double kLeastWeight = 0.01;      // of the earlier pixels together: less is hardly the same place
constexpr double kMostFrames = 4096;

struct History {
  double light[3] = {0, 0, 0}, variance[3] = {0, 0, 0}, frames = 0;
};

History historyOf(const EarlierPixels& earlier, std::span<const float> light, std::span<const float> variance, std::span<const float> frames) {
  History h;
  double weights = 0, inverse = 0;
  for (int k = 0; k < earlier.count; ++k) {
    const size_t q = earlier.at[k];
    if (!(frames[q] > 0.0f)) continue;  // nothing finite was seen there yet
    const double w = earlier.weight[k];
    weights += w;
    inverse += w / double(frames[q]);
    for (size_t c = 0; c < 3; ++c) {
      h.light[c] += w * double(light[3 * q + c]);
      h.variance[c] += w * double(variance[3 * q + c]);
    }
  }
  if (weights < kLeastWeight) return {};
  h.frames = weights / inverse;
  for (size_t c = 0; c < 3; ++c) {
    h.light[c] /= weights;
    h.variance[c] /= weights;
  }
  return h;
}

double knownVariance(float v) { return std::isnan(v) ? 0.0 : std::clamp(double(v), 0.0, kMostLightSpread); }

}  // namespace

bool TemporalAccumulator::add(const TemporalFrame& frame, const TaskArena& arena, const StopToken& stop) {
  const NoisyPicture& p = frame.picture;
  const SeenSurfaces seen{p.width, p.height, p.position, p.normal, p.coverage, p.footprint, frame.object};
  const bool goesOn = last_.width == p.width && last_.height == p.height;
  const SeenSurfaces before = last_.seen();
  const Reprojection reprojection(frame.camera, seen, last_.camera, before, settings_.surface);
  State next;
  next.light.resize(3 * p.pixels());
  next.variance.resize(3 * p.pixels());
  next.frames.resize(p.pixels());
  const bool complete = arena.parallelFor(
      p.pixels(), 1 << 10,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          History h;
          if (goesOn) h = historyOf(reprojection.of(i), last_.light, last_.variance, last_.frames);
          const bool known = std::isfinite(p.mean[3 * i]) && std::isfinite(p.mean[3 * i + 1]) && std::isfinite(p.mean[3 * i + 2]);
          if (known && h.frames > 0 && settings_.clampDeviations > 0.0f) {
            const LightRange range = lightAround(seen, p.mean, i, settings_.clampRadius, settings_.surface);
            for (size_t c = 0; c < 3; ++c) {
              const double off = double(settings_.clampDeviations) * std::sqrt(std::max(range.variance[c], knownVariance(p.variance[3 * i + c])));
              h.light[c] = std::clamp(h.light[c], range.mean[c] - off, range.mean[c] + off);
            }
          }
          const double share = known ? std::max(1.0 / (h.frames + 1.0), double(settings_.leastShare)) : 0.0;
          for (size_t c = 0; c < 3; ++c) {
            const double x = known ? double(p.mean[3 * i + c]) : 0.0;
            const double rest = 1.0 - share, v = rest * rest * h.variance[c] + share * share * knownVariance(p.variance[3 * i + c]);
            next.light[3 * i + c] = float(std::clamp(h.light[c] + share * (x - h.light[c]), -kMostLight, kMostLight));
            next.variance[3 * i + c] = float(v);
          }
          next.frames[i] = float(std::min(h.frames + (known ? 1.0 : 0.0), kMostFrames));
        }
      },
      stop);
  if (!complete) return false;
  next.width = p.width;
  next.height = p.height;
  next.camera = frame.camera;
  const auto copy = [](std::span<const float> from) { return std::vector<float>(from.begin(), from.end()); };
  next.position = copy(p.position);
  next.normal = copy(p.normal);
  next.coverage = copy(p.coverage);
  next.footprint = copy(p.footprint);
  next.object = copy(frame.object);
  last_ = std::move(next);
  return true;
}

NoisyPicture TemporalAccumulator::picture(const NoisyPicture& now) const {
  NoisyPicture p = now;
  p.mean = p.a = p.b = last_.light;
  p.variance = last_.variance;
  p.halves = false;
  return p;
}

}  // namespace gobo::denoise
