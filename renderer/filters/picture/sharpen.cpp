// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/convolution.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

class SharpenNode final : public PictureNode {
 public:
  SharpenNode(PictureShape shape, double sigma, double amount)
      : PictureNode(std::move(shape)), sigma_(sigma), amount_(amount), kernel_(gaussianKernel(sigma)) {}
  std::string type() const override { return "sharpen_filter"; }
  NodeTraits traits() const override {
    NodeTraits t = linear(false);
    t.tileable = true;
    t.halo = int(kernel_.size()) - 1;
    return t;
  }
  size_t workingBytes() const override { return convolutionBytes(shape()); }

 protected:
  void hashSettings(Hasher& h) const override { h.add(sigma_).add(amount_); }
  double nsPerValue() const override { return 1.0 + convolutionNs(kernel_.size()); }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    GOBO_TRY(convolve(in, out, shape(), kernel_, ctx));
    const bool complete = ctx.arena->parallelFor(
        out.size(), 1 << 15,
        [&](size_t b, size_t e) {
          for (size_t i = b; i < e; ++i) out[i] = finite(in[i] + amount_ * (double(in[i]) - out[i]));
        },
        ctx.stop);
    return complete ? Status() : pictureStopped();
  }

 private:
  double sigma_, amount_;
  std::vector<double> kernel_;
};

}  // namespace

NodePtr makeSharpenNode(PictureShape shape, double sigma, double amount) { return std::make_shared<SharpenNode>(std::move(shape), sigma, amount); }

}  // namespace filters
}  // namespace gobo
