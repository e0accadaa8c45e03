// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/first_order/first_order.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <vector>

#include "filters/denoise/first_order/regression.h"
#include "filters/denoise/non_local_means/patch_weights.h"
#include "terms/scratch.h"

namespace gobo::denoise {

namespace {

constexpr int kFitTile = 64, kFitRows = 32;  // pixels of a task: its sums and a row of weights stay in the second cache, those of a row in the first
constexpr int kFitPlanes = kFit + 3;         // and the weighted means, by which predictions are bounded

class FirstOrder final : public Denoiser {
 public:
  explicit FirstOrder(const v1::FirstOrderDenoise& s) : radius_(int(s.radius_px())), patch_{int(s.patch_px()), float(s.damping())} {}
  const char* name() const override { return "first_order"; }
  void hashParameters(Hasher& h) const override { h.add(radius_).add(patch_.patch).add(patch_.damping); }
  int halo() const override { return 2 * radius_ + patch_.patch; }  // of fits around a pixel, and what they look at
  double nsPerPixel() const override { return 40.0 * (2 * radius_ + 1) * (2 * radius_ + 1); }
  size_t workingBytes(int width, int height) const override {
    return sizeof(float) * (12 * size_t(width + 2 * margin()) + size_t(kFitPlanes + kRegressors - 1) * rowStride(width) + size_t(3 * width)) * size_t(height);
  }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    const size_t stride = rowStride(p.width);
    const Scratch<float> values(guideFloats(p, margin()));
    GuidePlanes guides[2];
    if (!makeGuides(p, margin(), values.get(), guides, arena, stop)) return false;
    const Scratch<float> features(size_t(kRegressors - 1) * stride * size_t(p.height));
    if (!fillFeatures(p, features.get(), arena, stop)) return false;
    const Scratch<float> fits(size_t(kFitPlanes) * stride * size_t(p.height));
    for (int h = 0; h < (p.halves ? 2 : 1); ++h) {
      const GuidePlanes &light = guides[h], &guide = guides[p.halves ? 1 - h : 0];
      const Half half{p, light, guide, features.get(), fits.get(), h ? outB : outA};
      if (!tiles(p, arena, stop, [&](const PixelRange& range) { return fit(half, range, stop); })) return false;
      if (!tiles(p, arena, stop, [&](const PixelRange& range) { return predict(half, range, stop); })) return false;
    }
    return true;
  }

 private:
  struct Half {
    const NoisyPicture& p;
    const GuidePlanes &light, &guide;
    const float* features;
    float* fits;  ///< planes
    std::span<float> out;
    size_t at(int planes, int x, int y) const { return size_t(y) * size_t(planes) * rowStride(p.width) + size_t(x); }
    const float* featuresAt(int x, int y) const { return features + at(kRegressors - 1, x, y); }
    float* fitsAt(int x, int y) const { return fits + at(kFitPlanes, x, y); }
  };
  int margin() const { return radius_ + patch_.patch; }

  /// Of features and fits, whose planes lie row by row: (y * planes + k) * stride + x. An odd number of lines of the cache: rows of many planes are read side
  /// by side, and at a distance of a power of two they would put each other out of the first cache.
  static size_t rowStride(int width) { return (size_t(width + 15) / 16 | 1) * 16; }

  bool fillFeatures(const NoisyPicture& p, float* features, const TaskArena& arena, const StopToken& stop) const {
    const size_t width = size_t(p.width), stride = rowStride(p.width);
    return arena.parallelFor(
        size_t(p.height), 8,
        [&](size_t begin, size_t end) {
          for (size_t i = begin * width; i < end * width; ++i) {
            const bool hit = p.coverage[i] > 0;
            float* to = features + i / width * (kRegressors - 1) * stride + i % width;
            for (size_t c = 0; c < 3; ++c) {
              to[c * stride] = hit ? p.albedo[3 * i + c] : 0.0f;
              to[(3 + c) * stride] = hit ? p.normal[3 * i + c] : 0.0f;
            }
            // The logarithm: its differences are relative, at any scale of the scene. Of a window over a surface that faces the viewer by 45 degrees they are
            // about its width in pixels times the angle of a pixel; ten times that is of the size of the other features.
            to[6 * stride] = hit && p.depth[i] > 0 ? 10.0f * float(std::log(double(p.depth[i]))) : 0.0f;
          }
        },
        stop);
  }

  template <typename Body>
  bool tiles(const NoisyPicture& p, const TaskArena& arena, const StopToken& stop, const Body& body) const {
    const int across = (p.width + kFitTile - 1) / kFitTile, down = (p.height + kFitRows - 1) / kFitRows;
    std::atomic<bool> stopped{false};
    return arena.parallelFor(
               size_t(across) * size_t(down), 1,
               [&](size_t tile, size_t) {
                 const int x = int(tile) % across * kFitTile, y = int(tile) / across * kFitRows;
                 if (!body(PixelRange{x, y, std::min(x + kFitTile, p.width), std::min(y + kFitRows, p.height)})) stopped = true;
               },
               stop) &&
           !stopped;
  }

  /// For each row of offsets: weigh(dx, dy, range at that offset in the picture, weights), then for each row and offset add(dx, dy, x0, x1, y, its weights).
  /// A pixel meets its offsets in order, and what a row of pixels needs of a row of neighbours stays in the first cache for all of them. False: stopped.
  template <typename Weigh, typename Add>
  bool offsets(const NoisyPicture& p, const PixelRange& range, const StopToken& stop, const Weigh& weigh, const Add& add) const {
    const size_t stride = size_t(range.width()) * size_t(range.height());
    std::vector<float> weights(size_t(2 * radius_ + 1) * stride);
    for (int dy = -radius_; dy <= radius_; ++dy) {
      const auto at = [&](int dx) {
        return PixelRange{std::max(range.x0, -dx), std::max(range.y0, -dy), std::min(range.x1, p.width - dx), std::min(range.y1, p.height - dy)};
      };
      const auto of = [&](int dx) { return weights.data() + size_t(dx + radius_) * stride; };
      if (at(0).height() <= 0) continue;
      for (int dx = -radius_; dx <= radius_; ++dx) {
        if (stop.stopRequested()) return false;
        if (at(dx).width() > 0) weigh(dx, dy, at(dx), of(dx));
      }
      for (int y = at(0).y0; y < at(0).y1; ++y)
        for (int dx = -radius_; dx <= radius_; ++dx) {
          const PixelRange in = at(dx);
          if (in.width() > 0) add(dx, dy, in.x0, in.x1, y, of(dx) + size_t(y - in.y0) * size_t(in.width()));
        }
    }
    return true;
  }

  bool fit(const Half& h, const PixelRange& range, const StopToken& stop) const {
    const size_t stride = rowStride(h.p.width);
    std::vector<float> sums(size_t(kSums * kFitTile) * size_t(range.height()), 0.0f), scratch;  // row by row as well
    const auto sumsAt = [&](int x, int y) { return sums.data() + size_t(y - range.y0) * kSums * kFitTile + size_t(x - range.x0); };
    const auto weigh = [&](int dx, int dy, const PixelRange& in, float* w) { patchWeights(h.guide, patch_, dx, dy, in, w, scratch); };
    const bool complete = offsets(h.p, range, stop, weigh, [&](int dx, int dy, int x0, int x1, int y, const float* w) {
      const size_t lit = size_t(y + dy) * size_t(h.light.stride()) + size_t(h.light.margin + x0 + dx);
      const float* light[3];
      for (int c = 0; c < 3; ++c) light[c] = h.light.value[c] + lit;
      addNeighbours(h.featuresAt(x0, y), h.featuresAt(x0 + dx, y + dy), stride, light, w, x1 - x0, kFitTile, sumsAt(x0, y));
    });
    if (!complete) return false;
    for (int y = range.y0; y < range.y1; ++y)
      for (int x = range.x0; x < range.x1; ++x) {
        const float* sum = sumsAt(x, y);
        float *fits = h.fitsAt(x, y), coefficients[kFit];
        solveFit(sum, kFitTile, coefficients);
        for (size_t k = 0; k < kFit; ++k) fits[k * stride] = coefficients[k];
        for (size_t c = 0; c < 3; ++c) fits[(kFit + c) * stride] = sum[(kProducts + c * kRegressors) * kFitTile] / sum[0];
      }
    return true;
  }

  /// Pixel q of the range from the fits at p = q + (dx, dy), whose weights are those of p for q.
  bool predict(const Half& h, const PixelRange& range, const StopToken& stop) const {
    const size_t stride = rowStride(h.p.width);
    std::vector<float> sums(size_t(4 * kFitTile) * size_t(range.height()), 0.0f), scratch;
    const auto sumsAt = [&](int x, int y) { return sums.data() + size_t(y - range.y0) * 4 * kFitTile + size_t(x - range.x0); };
    const auto weigh = [&](int dx, int dy, const PixelRange& in, float* w) {
      patchWeights(h.guide, patch_, -dx, -dy, {in.x0 + dx, in.y0 + dy, in.x1 + dx, in.y1 + dy}, w, scratch);
    };
    const bool complete = offsets(h.p, range, stop, weigh, [&](int dx, int dy, int x0, int x1, int y, const float* w) {
      addPredictions(h.featuresAt(x0, y), h.featuresAt(x0 + dx, y + dy), stride, h.fitsAt(x0 + dx, y + dy), stride, w, x1 - x0, kFitTile, sumsAt(x0, y));
    });
    if (!complete) return false;
    for (int y = range.y0; y < range.y1; ++y)
      for (int x = range.x0; x < range.x1; ++x) {
        const float* sum = sumsAt(x, y);
        for (size_t c = 0; c < 3; ++c) h.out[3 * (size_t(y) * size_t(h.p.width) + size_t(x)) + c] = sum[c * kFitTile] / sum[3 * kFitTile];
      }
    return true;
  }

  int radius_;
  PatchSettings patch_;
};

}  // namespace

DenoiserPtr makeFirstOrder(const v1::FirstOrderDenoise& settings) { return std::make_shared<FirstOrder>(settings); }

}  // namespace gobo::denoise
