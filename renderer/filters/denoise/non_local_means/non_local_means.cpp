// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/non_local_means/non_local_means.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <vector>

#include "filters/denoise/non_local_means/patch_weights.h"
#include "filters/denoise/non_local_means/weighted_rows.h"
#include "filters/denoise/similar_rows.h"
#include "terms/scratch.h"

namespace gobo::denoise {

namespace {

constexpr int kNonLocalRows = 16;  // of a task

class NonLocalMeans final : public Denoiser {
 public:
  explicit NonLocalMeans(const v1::NonLocalMeansDenoise& s)
      : radius_(int(s.radius_px())), patch_{int(s.patch_px()), float(s.damping())}, features_(float(s.features())) {}
  const char* name() const override { return "non_local_means"; }
  void hashParameters(Hasher& h) const override { h.add(radius_).add(patch_.patch).add(patch_.damping).add(features_); }
  int halo() const override { return radius_ + patch_.patch; }
  double nsPerPixel() const override { return 12.0 * (2 * radius_ + 1) * (2 * radius_ + 1); }
  size_t workingBytes(int width, int height) const override {
    return AlikeFeatures::bytes(width, height) + 12 * sizeof(float) * size_t(width + 2 * halo()) * size_t(height);
  }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    AlikeFeatures alike;
    if (!alike.fill({p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage}, p.width, p.height, arena, stop)) return false;
    const Scratch<float> values(guideFloats(p, halo()));
    const int halves = p.halves ? 2 : 1;
    GuidePlanes guides[2];
    bool complete = makeGuides(p, halo(), values.get(), guides, arena, stop);
    std::atomic<bool> stopped{false};
    complete = complete && arena.parallelFor(
                               size_t(p.height + kNonLocalRows - 1) / kNonLocalRows, 1,
                               [&](size_t tile, size_t) {
                                 const int y0 = int(tile) * kNonLocalRows;
                                 if (!rows(p, alike.planes(), guides, halves, y0, std::min(y0 + kNonLocalRows, p.height), outA, outB, stop)) stopped = true;
                               },
                               stop);
    return complete && !stopped;
  }

 private:
  bool rows(const NoisyPicture& p, const AlikePlanes& alike, const GuidePlanes* guides, int halves, int y0, int y1, std::span<float> outA,
            std::span<float> outB, const StopToken& stop) const {
    const size_t width = size_t(p.width), pixels = width * size_t(y1 - y0);
    std::vector<float> sums(size_t(halves) * 4 * pixels, 0.0f), weights(size_t(halves) * pixels), likeness(width), scratch;
    const auto sum = [&](int h, int c) { return sums.data() + size_t(4 * h + c) * pixels; };
    // Twice as wide as the joint bilateral filter's for features = 1: colours decide most.
    // Below a millionth nothing but equal features is alike; the square of less would be none, and 0 times its inverse no number.
    const float f = features_ > 0 ? 1.0f / std::max(features_ * features_, 1e-12f) : 0.0f;
    const Alike by{10.0f * f, 8.0f * f, 0.05f * f};
    for (int dy = -radius_; dy <= radius_; ++dy) {
      const int first = std::max(y0, -dy), last = std::min(y1, p.height - dy);  // whose neighbour is in the picture
      if (first >= last) continue;
      for (int dx = -radius_; dx <= radius_; ++dx) {
        if (stop.stopRequested()) return false;
        const int left = std::max(0, -dx), count = std::min(p.width, p.width - dx) - left;
        if (count <= 0) continue;
        for (int h = 0; h < halves; ++h) {
          const GuidePlanes& guide = guides[halves - 1 - h];  // the other half
          patchWeights(guide, patch_, dx, dy, {0, first, p.width, last}, weights.data() + size_t(h) * pixels, scratch);
        }
        for (int y = first; y < last; ++y) {
          const size_t at = size_t(y) * width + size_t(left), to = size_t(y - y0) * width + size_t(left);
          alikeWeights(alike, by, at, ptrdiff_t(dy) * p.width + dx, count, 1.0f, likeness.data());
          for (int h = 0; h < halves; ++h) {
            float* w = weights.data() + size_t(h) * pixels + size_t(y - first) * width + size_t(left);
            multiplyRow(likeness.data(), count, w);
            const size_t q = size_t(y + dy) * size_t(guides[h].stride()) + size_t(guides[h].margin + left + dx);
            for (int c = 0; c < 3; ++c) addWeightedRow(w, guides[h].value[c] + q, count, sum(h, c) + to);
            addRow(w, count, sum(h, 3) + to);
          }
        }
      }
    }
    for (int h = 0; h < halves; ++h) {
      const std::span<float> out = h ? outB : outA;
      for (size_t i = 0; i < pixels; ++i)
        for (int c = 0; c < 3; ++c) out[3 * (size_t(y0) * width + i) + size_t(c)] = sum(h, c)[i] / sum(h, 3)[i];
    }
    return true;
  }

  int radius_;
  PatchSettings patch_;
  float features_;
};

}  // namespace

DenoiserPtr makeNonLocalMeans(const v1::NonLocalMeansDenoise& settings) { return std::make_shared<NonLocalMeans>(settings); }

}  // namespace gobo::denoise
