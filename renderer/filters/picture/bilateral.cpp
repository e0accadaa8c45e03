// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "filters/denoise/fast_exp.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr float kMostDifference = std::numeric_limits<float>::max();
constexpr float kUnlike = 80.0f;  // exponents from here on weigh nothing: what a float's largest value adds with their weight would be seen

class BilateralNode final : public PictureNode {
 public:
  BilateralNode(PictureShape shape, double sigma, double range)
      : PictureNode(std::move(shape)), sigma_(sigma), range_(range), radius_(int(std::ceil(3.0 * sigma))) {}
  std::string type() const override { return "bilateral_filter"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = radius_;
    return t;
  }

 protected:
  void hashSettings(Hasher& h) const override { h.add(sigma_).add(range_); }
  double nsPerValue() const override { return 0.7 * (2.0 * radius_ + 1.0) * (2.0 * radius_ + 1.0); }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    return shape().channels == 3 ? filter<3>(in, out, ctx) : filter<1>(in, out, ctx);
  }

 private:
  /// Channel by channel, mirrored beyond its ends.
  template <size_t C>
  static void mirroredPlanes(const float* from, int width, int radius, std::vector<float>& to) {
    const size_t n = size_t(width + 2 * radius);
    to.resize(n * C);
    for (int x = -radius; x < width + radius; ++x)
      for (size_t c = 0; c < C; ++c) to[c * n + size_t(x + radius)] = from[size_t(mirrored(x, width)) * C + c];
  }

  template <size_t C>
  Status filter(std::span<const float> in, std::span<float> out, const RunContext& ctx) const {
    const PictureShape& s = shape();
    const int width = s.extent.width, height = s.extent.height;
    const size_t row = s.row(), n = size_t(width), wide = size_t(width + 2 * radius_);
    const float perRange = float(std::min(std::sqrt(0.5) / range_, double(std::numeric_limits<float>::max())));
    std::vector<float> across;                                  // exponents of distance
    const double variance = std::max(sigma_ * sigma_, 1e-300);  // no 0 / 0 for the least of widths, by which the pixel alone counts
    for (int k = -radius_; k <= radius_; ++k) across.push_back(float(std::min(0.5 * k * k / variance, double(std::numeric_limits<float>::max()))));
    const bool complete = ctx.arena->parallelFor(
        s.rows(), 1,
        [&](size_t b, size_t e) {
          std::vector<float> middle, line, weight(n), sum(C * n);
          std::vector<double> weights(n), sums(C * n);
          for (size_t y = b; y < e && !ctx.stop.stopRequested(); ++y) {
            const int at = int(y % size_t(height));
            const float* layer = in.data() + (y - size_t(at)) * row;
            mirroredPlanes<C>(layer + size_t(at) * row, width, 0, middle);
            std::fill(weights.begin(), weights.end(), 0.0);
            std::fill(sums.begin(), sums.end(), 0.0);
            for (int j = -radius_; j <= radius_ && !ctx.stop.stopRequested(); ++j) {
              mirroredPlanes<C>(layer + size_t(mirrored(at + j, height)) * row, width, radius_, line);
              // Sums of a row of the window in float, of rows in double.
              std::fill(weight.begin(), weight.end(), 0.0f);
              std::fill(sum.begin(), sum.end(), 0.0f);
              for (int k = -radius_; k <= radius_; ++k) {
                const float apart = across[size_t(j + radius_)] + across[size_t(k + radius_)];
                const float* other = line.data() + (k + radius_);
                for (size_t x = 0; x < n; ++x) {
                  float exponent = apart;
                  float difference[C];
                  for (size_t c = 0; c < C; ++c) {
                    difference[c] =
                        std::clamp(other[c * wide + x] - middle[c * n + x], -kMostDifference, kMostDifference);  // a weight of 0 times infinity is none
                    const float d = difference[c] * perRange;
                    exponent += d * d;
                  }
                  const float w = exponent < kUnlike ? denoise::fastExp(-exponent) : 0.0f;
                  weight[x] += w;
                  for (size_t c = 0; c < C; ++c) sum[c * n + x] += w * difference[c];
                }
              }
              for (size_t x = 0; x < n; ++x) weights[x] += double(weight[x]);
              for (size_t x = 0; x < C * n; ++x) sums[x] += double(sum[x]);
            }
            // The pixel itself has weight 1: there is always something to divide by.
            for (size_t x = 0; x < n; ++x)
              for (size_t c = 0; c < C; ++c) out[y * row + x * C + c] = finite(double(middle[c * n + x]) + sums[c * n + x] / weights[x]);
          }
        },
        ctx.stop);
    return complete && !ctx.stop.stopRequested() ? Status() : pictureStopped();
  }

  double sigma_, range_;
  int radius_;
};

}  // namespace

NodePtr makeBilateralNode(PictureShape shape, double sigma, double range) { return std::make_shared<BilateralNode>(std::move(shape), sigma, range); }

}  // namespace filters
}  // namespace gobo
