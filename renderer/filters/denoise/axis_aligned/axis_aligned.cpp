// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/axis_aligned/axis_aligned.h"

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "filters/denoise/axis_aligned/line_means.h"
#include "filters/denoise/plane_set.h"
#include "formulas/axis_aligned_indirect.glsl.h"
#include "formulas/formulas.h"
#include "terms/scratch.h"

namespace gobo::denoise {

namespace {

constexpr float kCurvatureWidth = 8.0f;  // pixels

class AxisAligned final : public Denoiser {
 public:
  explicit AxisAligned(const v1::AxisAlignedDenoise& s)
      : scale_(float(s.scale())),
        radius_(int(s.radius_px())),
        widthThreshold_(float(s.width_threshold())),
        cosAngle_(float(std::cos(s.angle_deg() * std::numbers::pi / 180))) {}
  const char* name() const override { return "axis_aligned"; }
  void hashParameters(Hasher& h) const override { h.add(scale_).add(radius_).add(widthThreshold_).add(cosAngle_); }
  int halo() const override { return radius_ + kCurvatureRadius + 1; }
  bool looksAtHalves() const override { return false; }
  double nsPerPixel() const override { return 200.0 + 8.0 * radius_; }
  size_t workingBytes(int width, int height) const override {
    return AlikeFeatures::bytes(width, height) + 15 * sizeof(float) * size_t(width) * size_t(height);
  }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    if (radius_ == 0 || p.curvature.empty()) {
      std::copy(p.a.begin(), p.a.end(), outA.begin());
      if (p.halves) std::copy(p.b.begin(), p.b.end(), outB.begin());
      return true;
    }
    AlikeFeatures alike;
    if (!alike.fill({p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage}, p.width, p.height, arena, stop)) return false;
    const AlikePlanes& k = alike.planes();
    const Scratch<float> width(p.pixels());
    if (!predict(p, k, width.get(), arena, stop)) return false;
    const int channels = p.halves ? 6 : 3;
    const PlaneSet light(channels, p.pixels()), rows(channels, p.pixels());
    bool complete = arena.parallelFor(
        p.pixels(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i)
            for (size_t c = 0; c < size_t(channels); ++c) light[c][i] = c < 3 ? p.a[3 * i + c] : p.b[3 * i + c - 3];
        },
        stop);
    const LineWindow window{width.get(), radius_, cosAngle_, widthThreshold_};
    complete = complete && means(k, window, light, rows, channels, arena, stop);
    return complete && arena.parallelFor(
                           p.pixels(), 1 << 13,
                           [&](size_t begin, size_t end) {
                             for (size_t i = begin; i < end; ++i)
                               for (size_t c = 0; c < size_t(channels); ++c) (c < 3 ? outA : outB)[3 * i + c % 3] = light[c][i];
                           },
                           stop);
  }

 private:
  /// Both directions, in place; `rows` in between. False: stopped.
  static bool means(const AlikePlanes& k, const LineWindow& window, const PlaneSet& light, const PlaneSet& rows, int channels, const TaskArena& arena,
                    const StopToken& stop) {
    for (const bool columns : {false, true}) {
      const PlaneSet &from = columns ? rows : light, &to = columns ? light : rows;
      const bool complete = arena.parallelFor(
          size_t(k.height), 2,
          [&](size_t begin, size_t end) {
            for (size_t y = begin; y < end; ++y) lineMeansRow(k, window, columns, from.data(), channels, int(y), to.data());
          },
          stop);
      if (!complete) return false;
    }
    return true;
  }

  bool usable(const NoisyPicture& p, size_t i) const { return p.coverage[i] >= 1.0f && (p.even.empty() || p.even[i] > 0.0f) && p.footprint[i] > 0.0f; }
  float limited(float pixels) const { return pixels >= kLeastWidth ? std::min(pixels, float(radius_) / kReach) : 0.0f; }

  bool predict(const NoisyPicture& p, const AlikePlanes& k, float* width, const TaskArena& arena, const StopToken& stop) const {
    // Curvature, and for lobes the light itself, averaged over the surface around.
    const int channels = p.alpha.empty() ? 1 : 2;
    const PlaneSet sums(channels, p.pixels()), rows(channels, p.pixels());
    if (!arena.parallelFor(
            p.pixels(), 1 << 13,
            [&](size_t begin, size_t end) {
              for (size_t i = begin; i < end; ++i) {
                const bool used = usable(p, i);
                width[i] = used ? kCurvatureWidth : -1.0f;
                const float light = used ? std::max(channelMean(p.mean, i), 0.0f) : 0.0f;
                sums[0][i] = used ? p.curvature[i] : 0.0f;
                if (channels > 1) sums[1][i] = light;
              }
            },
            stop))
      return false;
    if (!means(k, {width, kCurvatureRadius, cosAngle_, 1.0f}, sums, rows, channels, arena, stop)) return false;
    return arena.parallelFor(
        size_t(p.height), 4,
        [&](size_t begin, size_t end) {
          for (size_t i = begin * size_t(p.width); i < end * size_t(p.width); ++i) {
            if (!usable(p, i)) continue;
            const float d = p.footprint[i];
            float curvature = sums[0][i];
            if (!p.alpha.empty()) {
              const float turning = d / std::max(p.depth[i], 1e-18f) + 2.0f * turned(k, i);
              curvature = formulas::aaSpecularCurvature(curvature, sums[1][i], turning, p.alpha[i]);
            }
            width[i] = limited(scale_ * formulas::aaIndirectPredictedWidth(channelMean(p.variance, i), curvature));
          }
        },
        stop);
  }

  static float channelMean(std::span<const float> rgb, size_t i) { return rgb[3 * i] / 3.0f + rgb[3 * i + 1] / 3.0f + rgb[3 * i + 2] / 3.0f; }

  /// How far the normal turns from a pixel to the next, in radians, per width of a pixel: mean over those next to it on the same surface.
  float turned(const AlikePlanes& k, size_t i) const {
    const int x = int(i % size_t(k.width)), y = int(i / size_t(k.width));
    float sum = 0;
    int others = 0;
    const auto add = [&](bool inside, ptrdiff_t shift) {
      if (!inside) return;
      const size_t q = size_t(ptrdiff_t(i) + shift);
      const Vec3 n(k.unit[0][i], k.unit[1][i], k.unit[2][i]), m(k.unit[0][q], k.unit[1][q], k.unit[2][q]);
      const Vec3 way(k.place[0][q] - k.place[0][i], k.place[1][q] - k.place[1][i], k.place[2][q] - k.place[2][i]);
      const float distance = glm::length(way);
      if (!(glm::dot(n, m) >= cosAngle_) || !(distance > 0.0f)) return;
      sum += glm::length(m - n) * std::min(k.footprint[i] / distance, 1.0f);
      ++others;
    };
    add(x > 0, -1);
    add(x + 1 < k.width, 1);
    add(y > 0, -ptrdiff_t(k.width));
    add(y + 1 < k.height, k.width);
    return others ? sum / float(others) : 0.0f;
  }

  static constexpr float kLeastWidth = 0.3f;  // pixels: less takes hardly anything from the next one
  float scale_;
  int radius_;
  float widthThreshold_, cosAngle_;
};

}  // namespace

DenoiserPtr makeAxisAligned(const v1::AxisAlignedDenoise& settings) { return std::make_shared<AxisAligned>(settings); }

}  // namespace gobo::denoise
