// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <functional>
#include <numbers>

#include "base/vec.h"
#include "filters/picture/fourier.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

using fourier::Complex;

constexpr double kBloomTail = 32.0;  // radii that the kernel reaches at most

/// One axis of the transform: a mirrored picture repeats after twice its size, and where that is no fast length a longer one has what the kernel reaches.
struct BloomAxis {
  int size = 1, reach = 0;
  size_t length = 1;
  bool repeats = true;
  BloomAxis(int n, double radius) : size(n), reach(std::min(n, int(std::ceil(kBloomTail * radius)))) {
    const size_t twice = 2 * size_t(n), apart = fourier::fastSize(size_t(n) + 2 * size_t(reach));
    repeats = fourier::isFast(twice) && twice <= apart;
    length = repeats ? twice : apart;
  }
  /// The pixel at a place of the transform, or -1: none that the picture's pixels see. Beyond its ends where they do not repeat: from -reach on.
  int pixel(size_t at) const {
    if (repeats) return mirrored(int(at), size);
    const int i = int(at) < size + reach ? int(at) : int(at) - int(length);
    return i >= -reach ? mirrored(i, size) : -1;
  }
};

/// Share of the kernel's light between the axes and a corner: of a point's light at height a, the solid angle of that rectangle over 2 pi.
double lightToCorner(double x, double y, double a) { return std::atan2(x * y, a * std::sqrt(x * x + y * y + a * a)) / (2.0 * std::numbers::pi); }

class BloomNode final : public PictureNode {
 public:
  BloomNode(PictureShape shape, double threshold, double gain, double radius)
      : PictureNode(std::move(shape)),
        threshold_(threshold),
        gain_(gain),
        radius_(radius),
        across_(this->shape().extent.width, radius),
        down_(this->shape().extent.height, radius) {}
  std::string type() const override { return "bloom_filter"; }
  NodeTraits traits() const override { return {}; }
  size_t workingBytes() const override { return 3 * across_.length * down_.length * sizeof(Complex); }

 protected:
  void hashSettings(Hasher& h) const override { h.add(threshold_).add(gain_).add(radius_); }
  double nsPerValue() const override { return 200.0 * double(across_.length * down_.length) / (double(shape().extent.width) * double(shape().extent.height)); }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    std::copy(in.begin(), in.end(), out.begin());
    std::vector<float> light(in.size(), 0.0f);
    GOBO_ASSIGN(const bool any, excess(in, light, ctx));
    if (!any) return {};
    std::vector<Complex> kernel(across_.length * down_.length);
    GOBO_TRY(spread(kernel, ctx));
    if (!fourier::transform(kernel, across_.length, down_.length, false, *ctx.arena, ctx.stop)) return pictureStopped();
    // Two channels at once, as real and imaginary part of one picture: the kernel is real.
    const size_t pixels = size_t(shape().extent.width) * size_t(shape().extent.height);
    for (size_t layer = 0; layer < size_t(shape().extent.layers); ++layer) {
      const size_t from = layer * pixels * 3;
      GOBO_TRY(add(std::span(light).subspan(from), out.subspan(from), 0, 1, kernel, ctx));
      GOBO_TRY(add(std::span(light).subspan(from), out.subspan(from), 2, -1, kernel, ctx));
    }
    return {};
  }

 private:
  static bool lines(size_t count, const RunContext& ctx, const std::function<void(size_t)>& line) {
    return ctx.arena->parallelFor(
        count, 8,
        [&](size_t b, size_t e) {
          for (size_t y = b; y < e; ++y) line(y);
        },
        ctx.stop);
  }

  /// Whether there is any.
  Result<bool> excess(std::span<const float> in, std::vector<float>& light, const RunContext& ctx) const {
    const size_t row = shape().row();
    std::atomic<bool> any{false};
    const bool complete = lines(shape().rows(), ctx, [&](size_t line) {
      for (size_t p = line * row; p < (line + 1) * row; p += 3) {
        // In double: the weighted sum of what floats hold.
        const double y = 0.2126 * std::max(in[p], 0.0f) + 0.7152 * std::max(in[p + 1], 0.0f) + 0.0722 * std::max(in[p + 2], 0.0f);
        if (!(y > threshold_)) continue;
        any = true;
        for (size_t c = 0; c < 3; ++c) light[p + c] = float(std::max(in[p + c], 0.0f) * ((y - threshold_) / y));
      }
    });
    if (!complete) return pictureStopped();
    return any.load();
  }

  /// The kernel at its places of the transform, of sum 1; what it has beyond half of it is where the picture's mirror image is.
  Status spread(std::vector<Complex>& kernel, const RunContext& ctx) const {
    const double a = radius_ / std::sqrt(3.0);  // within r: 1 - a / sqrt(r^2 + a^2)
    const size_t columns = size_t(across_.reach) + 1, rows = size_t(down_.reach) + 1;
    std::vector<double> quarter(columns * rows), sums(rows);
    const bool complete = lines(rows, ctx, [&](size_t y) {
      const double bottom = double(y) - 0.5, top = double(y) + 0.5;
      double left = lightToCorner(-0.5, top, a) - lightToCorner(-0.5, bottom, a);
      for (size_t x = 0; x < columns; ++x) {
        const double right = lightToCorner(double(x) + 0.5, top, a) - lightToCorner(double(x) + 0.5, bottom, a);
        quarter[y * columns + x] = right - left;
        sums[y] += (right - left) * (x > 0 ? 2.0 : 1.0) * (y > 0 ? 2.0 : 1.0);
        left = right;
      }
    });
    if (!complete) return pictureStopped();
    double sum = 0.0;
    for (const double s : sums) sum += s;
    for (int y = -down_.reach; y <= down_.reach; ++y) {
      if (ctx.stop.stopRequested()) return pictureStopped();
      Complex* to = kernel.data() + (y < 0 ? down_.length - size_t(-y) : size_t(y)) % down_.length * across_.length;
      const double* from = quarter.data() + size_t(std::abs(y)) * columns;
      for (int x = -across_.reach; x <= across_.reach; ++x) to[(x < 0 ? across_.length - size_t(-x) : size_t(x)) % across_.length] += from[std::abs(x)] / sum;
    }
    return {};
  }

  /// Adds what is spread of two channels, or of one (second -1).
  Status add(std::span<const float> light, std::span<float> out, int first, int second, const std::vector<Complex>& kernel, const RunContext& ctx) const {
    const size_t width = size_t(shape().extent.width), height = size_t(shape().extent.height);
    std::vector<Complex> values(across_.length * down_.length);
    const bool filled = lines(down_.length, ctx, [&](size_t v) {
      const int y = down_.pixel(v);
      for (size_t u = 0; u < across_.length && y >= 0; ++u)
        if (const int x = across_.pixel(u); x >= 0) {
          const float* e = light.data() + 3 * (size_t(y) * width + size_t(x));
          values[v * across_.length + u] = Complex(e[first], second < 0 ? 0.0f : e[second]);
        }
    });
    if (!filled) return pictureStopped();
    if (!fourier::transform(values, across_.length, down_.length, false, *ctx.arena, ctx.stop)) return pictureStopped();
    const bool spread = lines(down_.length, ctx, [&](size_t v) {  // an even kernel: its transform has no other part
      for (size_t k = v * across_.length; k < (v + 1) * across_.length; ++k) values[k] *= kernel[k].real();
    });
    if (!spread) return pictureStopped();
    if (!fourier::transform(values, across_.length, down_.length, true, *ctx.arena, ctx.stop)) return pictureStopped();
    const bool added = lines(height, ctx, [&](size_t y) {
      for (size_t x = 0; x < width; ++x) {
        float* o = out.data() + 3 * (y * width + x);
        const Complex v = values[y * across_.length + x];
        // Light is added, never taken away: the transform's rounding beside very bright places.
        o[first] = finite(double(o[first]) + gain_ * std::max(v.real(), 0.0));
        if (second >= 0) o[second] = finite(double(o[second]) + gain_ * std::max(v.imag(), 0.0));
      }
    });
    return added ? Status() : pictureStopped();
  }

  double threshold_, gain_, radius_;
  BloomAxis across_, down_;
};

}  // namespace

NodePtr makeBloomNode(PictureShape shape, double threshold, double gain, double radius) {
  GOBO_CHECK(shape.channels == 3);
  return std::make_shared<BloomNode>(std::move(shape), threshold, gain, radius);
}

}  // namespace filters
}  // namespace gobo
