// SPDX-License-Identifier: Apache-2.0
#include "base/vec.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

class ColorBalanceNode final : public PictureNode {
 public:
  ColorBalanceNode(PictureShape shape, const std::array<double, 3>& transmittance, double density, bool keepLuminance)
      : PictureNode(std::move(shape)), transmittance_(transmittance), density_(density), keepLuminance_(keepLuminance) {
    for (size_t c = 0; c < 3; ++c) factor_[c] = std::pow(transmittance[c], density);
    const double white = double(luminance(Vec3(1.0f)));
    const double through = double(luminance(Vec3(float(factor_[0]), float(factor_[1]), float(factor_[2])))) / white;
    if (keepLuminance && through > 0.0)
      for (double& f : factor_) f /= through;
  }
  std::string type() const override { return "color_balance_filter"; }
  NodeTraits traits() const override {
    NodeTraits t = linear(false);
    t.tileable = true;
    return t;
  }

 protected:
  void hashSettings(Hasher& h) const override {
    for (const double t : transmittance_) h.add(t);
    h.add(density_).add(keepLuminance_);
  }
  double nsPerValue() const override { return 1.0; }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    const bool complete = ctx.arena->parallelFor(
        out.size() / 3, 1 << 14,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p)
            for (size_t c = 0; c < 3; ++c) out[3 * p + c] = finite(factor_[c] * double(in[3 * p + c]));
        },
        ctx.stop);
    return complete ? Status() : pictureStopped();
  }

 private:
  std::array<double, 3> transmittance_, factor_{};
  double density_;
  bool keepLuminance_;
};

}  // namespace

NodePtr makeColorBalanceNode(PictureShape shape, const std::array<double, 3>& transmittance, double density, bool keepLuminance) {
  GOBO_CHECK(shape.channels == 3);
  return std::make_shared<ColorBalanceNode>(std::move(shape), transmittance, density, keepLuminance);
}

}  // namespace filters
}  // namespace gobo
