// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/convolution.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

class GaussianNode final : public PictureNode {
 public:
  GaussianNode(PictureShape shape, double sigma) : PictureNode(std::move(shape)), sigma_(sigma), kernel_(gaussianKernel(sigma)) {}
  std::string type() const override { return "gaussian_filter"; }
  NodeTraits traits() const override {
    NodeTraits t = linear(true);
    t.tileable = true;
    t.halo = int(kernel_.size()) - 1;
    return t;
  }
  size_t workingBytes() const override { return convolutionBytes(shape()); }

 protected:
  void hashSettings(Hasher& h) const override { h.add(sigma_); }
  double nsPerValue() const override { return convolutionNs(kernel_.size()); }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override { return convolve(in, out, shape(), kernel_, ctx); }

 private:
  double sigma_;
  std::vector<double> kernel_;
};

}  // namespace

NodePtr makeGaussianNode(PictureShape shape, double sigma) { return std::make_shared<GaussianNode>(std::move(shape), sigma); }

}  // namespace filters
}  // namespace gobo
