// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

float medianOfWindow(std::vector<float>& v) {
  const auto middle = v.begin() + std::ptrdiff_t(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

void exchange(float& a, float& b) {
  const float least = std::min(a, b);
  b = std::max(a, b);
  a = least;
}

/// Of nine, by the 19 exchanges that are enough (Paeth 1990, Devillard 1998): no branch, so that loops of it vectorise.
float medianOfNine(float a, float b, float c, float d, float e, float f, float g, float h, float i) {
  exchange(b, c), exchange(e, f), exchange(h, i), exchange(a, b), exchange(d, e), exchange(g, h), exchange(b, c), exchange(e, f), exchange(h, i);
  exchange(a, d), exchange(f, i), exchange(e, h), exchange(d, g), exchange(b, e), exchange(c, f), exchange(e, h), exchange(e, c), exchange(g, e),
      exchange(e, c);
  return e;
}

class MedianNode final : public PictureNode {
 public:
  MedianNode(PictureShape shape, int radius, double deviations) : PictureNode(std::move(shape)), radius_(radius), deviations_(deviations) {}
  std::string type() const override { return "median_filter"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.rangePreserving = true;
    t.tileable = true;
    t.halo = radius_;
    return t;
  }

 protected:
  void hashSettings(Hasher& h) const override { h.add(radius_).add(deviations_); }
  double nsPerValue() const override {
    const double window = (2.0 * radius_ + 1.0) * (2.0 * radius_ + 1.0);
    return (radius_ <= 1 && deviations_ <= 0.0 ? 3.0 : 8.0 * window) * (deviations_ > 0.0 ? 2.0 : 1.0);
  }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    const PictureShape& s = shape();
    const size_t row = s.row(), channels = size_t(s.channels);
    const int width = s.extent.width, height = s.extent.height, side = 2 * radius_ + 1;
    const bool complete = ctx.arena->parallelFor(
        s.rows(), 1,
        [&](size_t b, size_t e) {
          std::vector<std::vector<float>> lines(size_t(side), std::vector<float>(size_t(width + 2 * radius_) * channels));
          std::vector<float> window, differences;
          for (size_t y = b; y < e && !ctx.stop.stopRequested(); ++y) {
            const int at = int(y % size_t(height));
            for (int k = 0; k < side; ++k) {
              const float* from = in.data() + (y - size_t(at) + size_t(mirrored(at + k - radius_, height))) * row;
              for (int x = -radius_; x < width + radius_; ++x)
                for (size_t c = 0; c < channels; ++c) lines[size_t(k)][size_t(x + radius_) * channels + c] = from[size_t(mirrored(x, width)) * channels + c];
            }
            if (radius_ == 1 && deviations_ <= 0.0) {
              const float *u = lines[0].data(), *v = lines[1].data(), *w = lines[2].data();
              const size_t n = channels;
              for (size_t j = 0; j < row; ++j)
                out[y * row + j] = medianOfNine(u[j], u[j + n], u[j + 2 * n], v[j], v[j + n], v[j + 2 * n], w[j], w[j + n], w[j + 2 * n]);
              continue;
            }
            for (size_t j = 0; j < row; ++j) {
              window.clear();
              for (const std::vector<float>& line : lines)
                for (int x = 0; x < side; ++x) window.push_back(line[j + size_t(x) * channels]);
              out[y * row + j] = chosen(in[y * row + j], window, differences);
            }
          }
        },
        ctx.stop);
    return complete && !ctx.stop.stopRequested() ? Status() : pictureStopped();
  }

 private:
  /// What becomes of a value in its window.
  float chosen(float value, std::vector<float>& window, std::vector<float>& differences) const {
    const float median = medianOfWindow(window);
    if (deviations_ <= 0.0) return median;
    differences.clear();
    for (const float v : window) differences.push_back(std::min(std::abs(v - median), std::numeric_limits<float>::max()));
    return std::abs(double(value) - median) > deviations_ * double(medianOfWindow(differences)) ? median : value;
  }

  int radius_;
  double deviations_;
};

}  // namespace

NodePtr makeMedianNode(PictureShape shape, int radius, double deviations) { return std::make_shared<MedianNode>(std::move(shape), radius, deviations); }

}  // namespace filters
}  // namespace gobo
