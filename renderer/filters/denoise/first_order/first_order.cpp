// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/first_order/first_order.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <vector>

#include "filters/denoise/first_order/regression.h"
#include "filters/denoise/non_local_means/patch_weights.h"

namespace gobo::denoise {

namespace {

constexpr int kFitTile = 64, kFitRows = 16;  // pixels of a task: its sums stay in the second cache
constexpr int kFitPlanes = kFit + 3;         // and the weighted means, by which predictions are bounded

class FirstOrder final : public Denoiser {
 public:
  explicit FirstOrder(const v1::FirstOrderDenoise& s) : radius_(int(s.radius_px())), patch_{int(s.patch_px()), float(s.damping())} {}
  const char* name() const override { return "first_order"; }
  void hashParameters(Hasher& h) const override { h.add(radius_).add(patch_.patch).add(patch_.damping); }
  int halo() const override { return 2 * radius_ + patch_.patch; }  // of fits around a pixel, and what they look at
  double nsPerPixel() const override { return 40.0 * (2 * radius_ + 1) * (2 * radius_ + 1); }
  size_t workingBytes(int width, int height) const override {
    return sizeof(float) * (12 * size_t(width + 2 * margin()) + size_t(kFitPlanes + 7 + 3) * size_t(width)) * size_t(height);
  }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    const size_t pixels = p.pixels();
    const auto values = std::make_unique_for_overwrite<float[]>(guideFloats(p, margin()));
    GuidePlanes guides[2];
    if (!makeGuides(p, margin(), values.get(), guides, arena, stop)) return false;
    const auto features = std::make_unique_for_overwrite<float[]>(size_t(kRegressors - 1) * pixels);
    if (!fillFeatures(p, features.get(), arena, stop)) return false;
    const auto fits = std::make_unique_for_overwrite<float[]>(size_t(kFitPlanes) * pixels);
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
  };
  int margin() const { return radius_ + patch_.patch; }

  bool fillFeatures(const NoisyPicture& p, float* features, const TaskArena& arena, const StopToken& stop) const {
    const size_t pixels = p.pixels();
    return arena.parallelFor(
        pixels, 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const bool hit = p.coverage[i] > 0;
            for (size_t c = 0; c < 3; ++c) {
              features[c * pixels + i] = hit ? p.albedo[3 * i + c] : 0.0f;
              features[(3 + c) * pixels + i] = hit ? p.normal[3 * i + c] : 0.0f;
            }
            // The logarithm: its differences are relative, at any scale of the scene. Of a window over a surface that faces the viewer by 45 degrees they are
            // about its width in pixels times the angle of a pixel; ten times that is of the size of the other features.
            features[6 * pixels + i] = hit && p.depth[i] > 0 ? 10.0f * float(std::log(double(p.depth[i]))) : 0.0f;
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

  /// For each offset: rows of the range whose pixel at that offset is in the picture. False: stopped.
  template <typename Body>
  bool offsets(const NoisyPicture& p, const PixelRange& range, const StopToken& stop, const Body& body) const {
    for (int dy = -radius_; dy <= radius_; ++dy)
      for (int dx = -radius_; dx <= radius_; ++dx) {
        if (stop.stopRequested()) return false;
        const PixelRange in{std::max(range.x0, -dx), std::max(range.y0, -dy), std::min(range.x1, p.width - dx), std::min(range.y1, p.height - dy)};
        if (in.width() > 0 && in.height() > 0) body(dx, dy, in);
      }
    return true;
  }

  bool fit(const Half& h, const PixelRange& range, const StopToken& stop) const {
    const size_t stride = size_t(range.width()) * size_t(range.height()), width = size_t(h.p.width), pixels = h.p.pixels();
    std::vector<float> sums(size_t(kSums) * stride, 0.0f), weights(stride), scratch;
    const bool complete = offsets(h.p, range, stop, [&](int dx, int dy, const PixelRange& in) {
      patchWeights(h.guide, patch_, dx, dy, in, weights.data(), scratch);
      for (int y = in.y0; y < in.y1; ++y) {
        const size_t p = size_t(y) * width + size_t(in.x0), q = size_t(y + dy) * width + size_t(in.x0 + dx);
        const size_t lit = size_t(y + dy) * size_t(h.light.stride()) + size_t(h.light.margin + in.x0 + dx);
        const float *own[kRegressors - 1], *other[kRegressors - 1], *light[3];
        for (size_t j = 0; j + 1 < kRegressors; ++j) {
          own[j] = h.features + j * pixels + p;
          other[j] = h.features + j * pixels + q;
        }
        for (int c = 0; c < 3; ++c) light[c] = h.light.value[c] + lit;
        addNeighbours(own, other, light, weights.data() + size_t(y - in.y0) * size_t(in.width()), in.width(), stride,
                      sums.data() + size_t(y - range.y0) * size_t(range.width()) + size_t(in.x0 - range.x0));
      }
    });
    if (!complete) return false;
    for (int y = range.y0; y < range.y1; ++y)
      for (int x = range.x0; x < range.x1; ++x) {
        const size_t t = size_t(y - range.y0) * size_t(range.width()) + size_t(x - range.x0), p = size_t(y) * width + size_t(x);
        float coefficients[kFit];
        solveFit(&sums[t], stride, coefficients);
        for (size_t k = 0; k < kFit; ++k) h.fits[k * pixels + p] = coefficients[k];
        for (size_t c = 0; c < 3; ++c) h.fits[(kFit + c) * pixels + p] = sums[(kProducts + c * kRegressors) * stride + t] / sums[t];
      }
    return true;
  }

  /// Pixel q of the range from the fits at p = q + (dx, dy), whose weights are those of p for q.
  bool predict(const Half& h, const PixelRange& range, const StopToken& stop) const {
    const size_t stride = size_t(range.width()) * size_t(range.height()), width = size_t(h.p.width), pixels = h.p.pixels();
    std::vector<float> sums(4 * stride, 0.0f), weights(stride), scratch;
    const bool complete = offsets(h.p, range, stop, [&](int dx, int dy, const PixelRange& in) {
      patchWeights(h.guide, patch_, -dx, -dy, {in.x0 + dx, in.y0 + dy, in.x1 + dx, in.y1 + dy}, weights.data(), scratch);
      for (int y = in.y0; y < in.y1; ++y) {
        const size_t q = size_t(y) * width + size_t(in.x0), p = size_t(y + dy) * width + size_t(in.x0 + dx);
        const float *at[kRegressors - 1], *from[kRegressors - 1];
        for (size_t j = 0; j + 1 < kRegressors; ++j) {
          at[j] = h.features + j * pixels + q;
          from[j] = h.features + j * pixels + p;
        }
        addPredictions(at, from, h.fits + p, pixels, weights.data() + size_t(y - in.y0) * size_t(in.width()), in.width(), stride,
                       sums.data() + size_t(y - range.y0) * size_t(range.width()) + size_t(in.x0 - range.x0));
      }
    });
    if (!complete) return false;
    for (int y = range.y0; y < range.y1; ++y)
      for (int x = range.x0; x < range.x1; ++x) {
        const size_t t = size_t(y - range.y0) * size_t(range.width()) + size_t(x - range.x0);
        for (size_t c = 0; c < 3; ++c) h.out[3 * (size_t(y) * width + size_t(x)) + c] = sums[c * stride + t] / sums[3 * stride + t];
      }
    return true;
  }

  int radius_;
  PatchSettings patch_;
};

}  // namespace

DenoiserPtr makeFirstOrder(const v1::FirstOrderDenoise& settings) { return std::make_shared<FirstOrder>(settings); }

}  // namespace gobo::denoise
