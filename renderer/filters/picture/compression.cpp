// SPDX-License-Identifier: Apache-2.0
#include <numeric>

#include "filters/picture/fourier.h"
#include "filters/picture/picture_filters.h"

namespace gobo {

namespace {

using fourier::Complex;

class CompressionNode final : public PictureNode {
 public:
  CompressionNode(PictureShape shape, double share) : PictureNode(std::move(shape)), share_(share) {}
  std::string type() const override { return "compression_filter"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.rangePreserving = shape().share;
    return t;
  }
  size_t workingBytes() const override { return size_t(shape().extent.width) * size_t(shape().extent.height) * (sizeof(Complex) + 2 * sizeof(uint32_t)); }

 protected:
  void hashSettings(Hasher& h) const override { h.add(share_); }
  double nsPerValue() const override { return 350.0; }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    const PictureShape& s = shape();
    const size_t pixels = size_t(s.extent.width) * size_t(s.extent.height), channels = size_t(s.channels);
    std::vector<Complex> values(pixels);
    for (size_t layer = 0; layer < size_t(s.extent.layers); ++layer)
      for (size_t c = 0; c < channels; ++c) {
        const size_t from = layer * pixels * channels + c;
        for (size_t p = 0; p < pixels; ++p) values[p] = double(in[from + p * channels]);
        if (!fourier::transform(values, size_t(s.extent.width), size_t(s.extent.height), false, *ctx.arena, ctx.stop)) return pictureStopped();
        keepStrongest(values);
        if (!fourier::transform(values, size_t(s.extent.width), size_t(s.extent.height), true, *ctx.arena, ctx.stop)) return pictureStopped();
        for (size_t p = 0; p < pixels; ++p) out[from + p * channels] = finite(values[p].real());
      }
    return {};
  }

 private:
  void keepStrongest(std::vector<Complex>& values) const {
    const size_t width = size_t(shape().extent.width), height = size_t(shape().extent.height);
    const auto conjugate = [&](size_t p) { return (height - p / width) % height * width + (width - p % width) % width; };
    std::vector<uint32_t> first;  // of each pair of conjugates
    for (size_t p = 0; p < values.size(); ++p)
      if (p <= conjugate(p)) first.push_back(uint32_t(p));
    const size_t keep = size_t(std::floor(share_ * double(values.size()) + 0.5));
    // Pairs are ranked by strength, and by their place where that is equal. At most so many pairs are kept, with the few that are their own conjugates.
    const size_t most = std::min(first.size(), keep / 2 + 5);
    const auto stronger = [&](uint32_t a, uint32_t b) {
      const double x = std::norm(values[a]), y = std::norm(values[b]);
      return x != y ? x > y : a < b;
    };
    std::partial_sort(first.begin(), first.begin() + std::ptrdiff_t(most), first.end(), stronger);
    size_t kept = 0, pairs = 0;
    for (; pairs < most; ++pairs) {
      const size_t count = conjugate(first[pairs]) == first[pairs] ? 1 : 2;
      if (kept + count > keep) break;
      kept += count;
    }
    for (size_t k = 0; k < first.size(); ++k) {
      const size_t p = first[k], other = conjugate(p);
      if (k >= pairs) values[p] = 0.0;
      values[other] = other == p ? values[p] : std::conj(values[p]);
    }
  }

  double share_;
};

}  // namespace

NodePtr makeCompressionNode(PictureShape shape, double share) { return std::make_shared<CompressionNode>(std::move(shape), share); }

}  // namespace gobo
