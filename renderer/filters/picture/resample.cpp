// SPDX-License-Identifier: Apache-2.0
#include <numbers>
#include <vector>

#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

using ResampleKernel = v1::ResampleFilter::Kernel;

/// In spacings, how far a kernel reaches.
double resampleReach(ResampleKernel kernel) {
  switch (kernel) {
    case v1::ResampleFilter::BOX: return 0.5;
    case v1::ResampleFilter::TENT: return 1.0;
    case v1::ResampleFilter::LANCZOS: return 3.0;
    default: return 2.0;
  }
}

double resampleKernelAt(ResampleKernel kernel, double t) {
  const double a = std::abs(t);
  switch (kernel) {
    case v1::ResampleFilter::BOX: return t >= -0.5 && t < 0.5 ? 1.0 : 0.0;  // half open: a point between two samples has one of them
    case v1::ResampleFilter::TENT: return std::max(1.0 - a, 0.0);
    case v1::ResampleFilter::GAUSSIAN: return a < 2.0 ? std::exp(-2.0 * a * a) : 0.0;
    case v1::ResampleFilter::LANCZOS: {
      if (a >= 3.0) return 0.0;
      const double x = std::numbers::pi * t;
      return a < 1e-9 ? 1.0 : 3.0 * std::sin(x) * std::sin(x / 3.0) / (x * x);
    }
    default:  // Mitchell and Netravali's (1988), B = C = 1/3
      if (a < 1.0) return ((7.0 * a - 12.0) * a * a + 16.0 / 3.0) / 6.0;
      if (a < 2.0) return (((-7.0 / 3.0 * a + 12.0) * a - 20.0) * a + 32.0 / 3.0) / 6.0;
      return 0.0;
  }
}

/// A value as a weighted sum of values from `first` on.
struct ResampleTaps {
  int first = 0;
  std::vector<double> weights;
};

/// Weights at the integers around `at` of a kernel that is `scale` wide, with sum 1. even: what lies on the edge of a box is half in it, on either side.
ResampleTaps resampleTaps(double at, double scale, ResampleKernel kernel, bool even) {
  const double reach = resampleReach(kernel) * scale;
  ResampleTaps taps{int(std::ceil(at - reach)), {}};
  double sum = 0.0;
  for (int i = taps.first; i <= int(std::floor(at + reach)); ++i) {
    const double t = (i - at) / scale;
    taps.weights.push_back(even && kernel == v1::ResampleFilter::BOX && std::abs(t) == 0.5 ? 0.5 : resampleKernelAt(kernel, t));
    sum += taps.weights.back();
  }
  for (double& w : taps.weights) w /= sum;
  return taps;
}

/// One direction: samples of n pixels, and pixels of them. Samples lie beyond the ends as far as pixels need them.
struct ResampleGrid {
  std::vector<ResampleTaps> samples;  ///< of mirrored pixels
  std::vector<ResampleTaps> pixels;   ///< of `samples`
};

ResampleGrid resampleGrid(int n, double factor, ResampleKernel kernel, bool prefilter) {
  // Filtered samples stand in the middle of the pixels that are theirs; others are a pixel.
  const double start = prefilter ? 0.5 * (factor - 1.0) : std::floor(0.5 * (factor - 1.0));
  ResampleGrid grid;
  int least = 0, most = 0;
  for (int i = 0; i < n; ++i) {
    grid.pixels.push_back(resampleTaps((i - start) / factor, 1.0, kernel, prefilter));
    const ResampleTaps& t = grid.pixels.back();
    if (i == 0) least = t.first;
    most = std::max(most, t.first + int(t.weights.size()) - 1);
  }
  for (ResampleTaps& t : grid.pixels) t.first -= least;
  for (int s = least; s <= most; ++s) {
    const double at = start + s * factor;
    grid.samples.push_back(prefilter ? resampleTaps(at, factor, kernel, true) : ResampleTaps{int(std::floor(at + 0.5)), {1.0}});
  }
  return grid;
}

class ResampleNode final : public PictureNode {
 public:
  ResampleNode(PictureShape shape, double factor, ResampleKernel kernel, bool prefilter)
      : PictureNode(std::move(shape)),
        factor_(factor),
        kernel_(kernel),
        prefilter_(prefilter),
        across_(resampleGrid(this->shape().extent.width, factor, kernel, prefilter)),
        down_(resampleGrid(this->shape().extent.height, factor, kernel, prefilter)) {}
  std::string type() const override { return "resample_filter"; }
  NodeTraits traits() const override {
    return linear(kernel_ == v1::ResampleFilter::BOX || kernel_ == v1::ResampleFilter::TENT || kernel_ == v1::ResampleFilter::GAUSSIAN);
  }
  size_t workingBytes() const override {
    const size_t channels = size_t(shape().channels), columns = across_.samples.size();
    return channels * columns * (size_t(shape().extent.height) * 2 + down_.samples.size()) * sizeof(double);
  }

 protected:
  void hashSettings(Hasher& h) const override { h.add(factor_).add(int(kernel_)).add(prefilter_); }
  double nsPerValue() const override { return 4.0 + 8.0 * resampleReach(kernel_); }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    const PictureShape& s = shape();
    const size_t channels = size_t(s.channels), height = size_t(s.extent.height), columns = across_.samples.size(), rows = down_.samples.size();
    const size_t row = s.row(), narrow = columns * channels;
    std::vector<double> across(height * narrow), samples(rows * narrow), spread(height * narrow);
    const auto passes = [&](size_t count, const std::function<void(size_t)>& line) {
      const bool complete = ctx.arena->parallelFor(
          count, 4,
          [&](size_t b, size_t e) {
            for (size_t y = b; y < e && !ctx.stop.stopRequested(); ++y) line(y);
          },
          ctx.stop);
      return complete && !ctx.stop.stopRequested();
    };
    /// A line as a weighted sum of lines.
    const auto combine = [&](const ResampleTaps& t, const std::vector<double>& from, int n, bool mirror, double* to) {
      std::fill_n(to, narrow, 0.0);
      for (size_t k = 0; k < t.weights.size(); ++k) {
        const int at = t.first + int(k);
        const double* line = from.data() + size_t(mirror ? mirrored(at, n) : at) * narrow;
        for (size_t j = 0; j < narrow; ++j) to[j] += t.weights[k] * line[j];
      }
    };
    for (size_t layer = 0; layer < size_t(s.extent.layers); ++layer) {
      const float* from = in.data() + layer * height * row;
      const auto take = [&](size_t y) {
        for (size_t x = 0; x < columns; ++x)
          for (size_t c = 0; c < channels; ++c) {
            const ResampleTaps& t = across_.samples[x];
            double sum = 0.0;
            for (size_t k = 0; k < t.weights.size(); ++k)
              sum += t.weights[k] * double(from[y * row + size_t(mirrored(t.first + int(k), s.extent.width)) * channels + c]);
            across[y * narrow + x * channels + c] = sum;
          }
      };
      const auto put = [&](size_t y) {
        combine(down_.pixels[y], samples, 0, false, spread.data() + y * narrow);
        for (size_t x = 0; x < size_t(s.extent.width); ++x)
          for (size_t c = 0; c < channels; ++c) {
            const ResampleTaps& t = across_.pixels[x];
            double sum = 0.0;
            for (size_t k = 0; k < t.weights.size(); ++k) sum += t.weights[k] * spread[y * narrow + (size_t(t.first) + k) * channels + c];
            out[(layer * height + y) * row + x * channels + c] = finite(sum);
          }
      };
      if (!passes(height, take)) return pictureStopped();
      if (!passes(rows, [&](size_t y) { combine(down_.samples[y], across, s.extent.height, true, samples.data() + y * narrow); })) return pictureStopped();
      if (!passes(height, put)) return pictureStopped();
    }
    return {};
  }

 private:
  double factor_;
  ResampleKernel kernel_;
  bool prefilter_;
  ResampleGrid across_, down_;
};

}  // namespace

NodePtr makeResampleNode(PictureShape shape, double factor, v1::ResampleFilter::Kernel kernel, bool prefilter) {
  return std::make_shared<ResampleNode>(std::move(shape), factor, kernel, prefilter);
}

}  // namespace filters
}  // namespace gobo
