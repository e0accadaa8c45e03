// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/wavelet/wavelet.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "filters/denoise/wavelet/wavelet_kernels.h"
#include "terms/scratch.h"

namespace gobo::denoise {

namespace {

constexpr size_t kWaveletRows = 4;  // a task
constexpr float kLuminance[3] = {0.2126f, 0.7152f, 0.0722f};
constexpr double kMostVariance = 1e36;  // of a value up to 1e18

float luminanceOf(const float* rgb) { return kLuminance[0] * rgb[0] + kLuminance[1] * rgb[1] + kLuminance[2] * rgb[2]; }

/// Share of its variance that a level's taps have in common if all weights are those of the spline: such that variance falls as that of the whole
/// cascade does.
std::vector<float> correlations(int levels) {
  constexpr double kTaps[5] = {0.0625, 0.25, 0.375, 0.25, 0.0625};
  std::vector<float> share;
  std::vector<double> cascade{1.0};
  double before = 1, apart = 0;
  for (int level = 0; level < levels; ++level) {
    const size_t spacing = size_t(1) << level;
    std::vector<double> next(cascade.size() + 4 * spacing);
    for (size_t i = 0; i < cascade.size(); ++i)
      for (size_t k = 0; k < 5; ++k) next[i + k * spacing] += cascade[i] * kTaps[k];
    cascade = std::move(next);
    double squares = 0;
    for (double v : cascade) squares += v * v;
    const double falls = squares * squares / before;  // in both directions
    if (level == 0) apart = falls;
    share.push_back(float((falls - apart) / (1 - apart)));
    before = squares * squares;
  }
  return share;
}

class Wavelet final : public Denoiser {
 public:
  Wavelet(const v1::WaveletDenoise& s, WaveletGuide guide)
      : levels_(int(s.levels())),
        luminance_(float(s.luminance())),
        power_(float(s.normal_power())),
        plane_(s.plane_px()),
        guide_(guide),
        correlated_(correlations(levels_)) {}
  const char* name() const override { return "wavelet"; }
  void hashParameters(Hasher& h) const override { h.add(levels_).add(luminance_).add(power_).add(plane_).add(int(guide_)); }
  int halo() const override { return 2 * ((1 << levels_) - 1); }  // 2 * 2^level each; the blur of the variance does not reach as far as the taps
  double nsPerPixel() const override { return 100.0 * levels_; }
  size_t workingBytes(int width, int height) const override { return kMostPlanes * sizeof(float) * size_t(width) * size_t(height); }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    Work work(p);
    if (!surface(p, work, arena, stop)) return false;
    if (!p.halves) return filter(p, work, {{p.a, outA}}, p.mean, 1.0, arena, stop);
    if (guide_ == WaveletGuide::Mean) return filter(p, work, {{p.a, outA}, {p.b, outB}}, p.mean, 1.0, arena, stop);
    return filter(p, work, {{p.a, outA}}, p.a, double(p.shareOfA), arena, stop) && filter(p, work, {{p.b, outB}}, p.b, 1.0 - double(p.shareOfA), arena, stop);
  }

 private:
  static constexpr int kSurfacePlanes = 9;  // facing 4, place 3, perPlane, perSigma
  static constexpr int kSetPlanes = 8;      // seven channels and the variance
  static constexpr int kMostPlanes = kSurfacePlanes + 2 * kSetPlanes;
  struct Work {
    explicit Work(const NoisyPicture& p) : pixels(p.pixels()), planes(kMostPlanes * p.pixels()) {}
    float* plane(int k) const { return planes.get() + size_t(k) * pixels; }
    float* set(int which, int k) const { return plane(kSurfacePlanes + which * kSetPlanes + k); }
    float* perSigma() const { return plane(8); }
    size_t pixels;
    Scratch<float> planes;
  };
  struct Half {
    std::span<const float> in;
    std::span<float> out;
  };

  bool surface(const NoisyPicture& p, const Work& work, const TaskArena& arena, const StopToken& stop) const {
    float* planes[8];
    for (int k = 0; k < 8; ++k) planes[k] = work.plane(k);
    return arena.parallelFor(
        p.pixels(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const bool hit = p.coverage[i] > 0;
            const float *n = &p.normal[3 * i], *x = &p.position[3 * i];
            const double length = std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1] + double(n[2]) * n[2]);
            const float scale = hit && length > 1e-12 ? float(1.0 / length) : 0.0f;
            for (int c = 0; c < 3; ++c) planes[c][i] = n[c] * scale;
            planes[3][i] = hit ? 0.0f : 1.0f;
            for (int c = 0; c < 3; ++c) planes[4 + c][i] = hit ? x[c] : 0.0f;
            planes[7][i] = hit && p.footprint[i] > 0 ? float(std::min(1.0 / (plane_ * double(p.footprint[i])), 1e30)) : 0.0f;
          }
        },
        stop);
  }

  /// `share`: of the samples that the guide is of.
  bool filter(const NoisyPicture& p, const Work& work, std::initializer_list<Half> halves, std::span<const float> guide, double share, const TaskArena& arena,
              const StopToken& stop) const {
    const int channels = 3 * int(halves.size()) + 1, guideAt = channels - 1, varianceAt = channels;
    bool complete = arena.parallelFor(
        work.pixels, 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            int at = 0;
            for (const Half& half : halves)
              for (size_t c = 0; c < 3; ++c) work.set(0, at++)[i] = half.in[3 * i + c];
            work.set(0, guideAt)[i] = luminanceOf(&guide[3 * i]);
            // Channels err together, mostly: a path is too bright in all of them.
            double deviation = 0;
            for (size_t c = 0; c < 3; ++c) deviation += double(kLuminance[c]) * std::sqrt(std::max(double(p.variance[3 * i + c]), 0.0));
            work.set(0, varianceAt)[i] = float(std::min(deviation * deviation / share, kMostVariance));
          }
        },
        stop);
    for (int level = 0; level < levels_ && complete; ++level) {
      WaveletLevel k;
      k.width = p.width;
      k.height = p.height;
      k.spacing = 1 << level;
      k.power = power_;
      for (int c = 0; c < 4; ++c) k.facing[c] = work.plane(c);
      for (int c = 0; c < 3; ++c) k.place[c] = work.plane(4 + c);
      k.perPlane = work.plane(7);
      k.perSigma = work.perSigma();
      k.channels = channels;
      for (int c = 0; c < channels; ++c) {
        k.in[c] = work.set(level & 1, c);
        k.out[c] = work.set(~level & 1, c);
      }
      k.correlated = correlated_[size_t(level)];
      k.variance = work.set(level & 1, varianceAt);
      k.varianceOut = work.set(~level & 1, varianceAt);
      complete = arena.parallelFor(
          size_t(p.height), 4 * kWaveletRows,
          [&](size_t begin, size_t end) {
            for (size_t y = begin; y < end; ++y) perSigmaRow(k.facing[3], k.variance, p.width, p.height, int(y), luminance_, work.perSigma());
          },
          stop);
      complete = complete && arena.parallelFor(
                                 size_t(p.height), kWaveletRows,
                                 [&](size_t begin, size_t end) {
                                   for (size_t y = begin; y < end; ++y) waveletRow(k, int(y));
                                 },
                                 stop);
    }
    return complete && arena.parallelFor(
                           work.pixels, 1 << 13,
                           [&](size_t begin, size_t end) {
                             int at = 0;
                             for (const Half& half : halves)
                               for (size_t c = 0; c < 3; ++c, ++at)
                                 for (size_t i = begin; i < end; ++i) half.out[3 * i + c] = work.set(levels_ & 1, at)[i];
                           },
                           stop);
  }

  int levels_;
  float luminance_, power_;
  double plane_;
  WaveletGuide guide_;
  std::vector<float> correlated_;  // by level
};

}  // namespace

DenoiserPtr makeWavelet(const v1::WaveletDenoise& settings, WaveletGuide guide) { return std::make_shared<Wavelet>(settings, guide); }

}  // namespace gobo::denoise
