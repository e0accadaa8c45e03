// SPDX-License-Identifier: Apache-2.0
// Filter: depth map -> exponential map, pre-filtered by a separable Gaussian; rows first, then columns, taps in ascending order.
#include <algorithm>

#include "filters/exponential_shadow_map/exponential_shadow_map_kernels.h"
#include "filters/exponential_shadow_map/device_kernels.h"

namespace gobo {
namespace {

class EncodeNode : public Node {
 public:
  EncodeNode(float c, int blur, int resolution, std::shared_ptr<ComputeDevice> device)
      : c_(c), blur_(blur), resolution_(resolution), device_(std::move(device)) {
    GOBO_CHECK(c >= 1.0f && c <= 80.0f && blur >= 0);   // above 80 the far end leaves float (exponential_shadow_map.glsl.h)
  }
  std::string type() const override { return "exponential_shadow_encode"; }
  std::string numericClass() const override { return device_ ? device_->numericClass() : Node::numericClass(); }
  std::string device() const override { return device_ ? std::string(device_->kind()) + ": " + device_->name() : "cpu"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(c_).add(blur_); }
  size_t outputBytes() const override { return size_t(resolution_) * resolution_ * 4; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& depth = *ctx.inputs.at(0);
    const Extent extent = depth.extent();
    const std::span<const float> z = depth.floats("z");
    GOBO_CHECK_EQ(z.size(), extent.elements());
    GOBO_CHECK_EQ(extent.layers, 1);
    auto term = std::make_shared<Term>("exponential_shadow_map", Domain::LightTexel, extent);
    const std::span<float> e = term->addPlane<float>("E");
    const std::vector<float> weights = exponentialShadowWeights(blur_);
    if (device_ && !z.empty()) {
      GOBO_TRY(deviceEncode(*device_, z, extent.width, extent.height, c_, weights, e));
      if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "exponential_shadow_encode stopped");
    } else if (!encode(ctx, z, extent, weights, e)) {
      return Status(Code::Cancelled, "exponential_shadow_encode stopped");
    }
    return TermPtr(term);
  }

 private:
  bool encode(const RunContext& ctx, std::span<const float> z, Extent extent, const std::vector<float>& weights, std::span<float> e) const {
    const size_t width = size_t(extent.width), height = size_t(extent.height);
    const int taps = int(weights.size());
    if (blur_ == 0)
      return ctx.arena->parallelFor(z.size(), 16384, [&](size_t begin, size_t end) { encodeExponential(&z[begin], &e[begin], end - begin, c_); }, ctx.stop);
    std::vector<float> rows(z.size());
    const bool horizontal = ctx.arena->parallelFor(height, 16, [&](size_t begin, size_t end) {
      std::vector<float> padded(width + size_t(taps) - 1);
      for (size_t y = begin; y < end; ++y) {
        float* middle = padded.data() + blur_;
        encodeExponential(&z[y * width], middle, width, c_);
        std::fill(padded.begin(), padded.begin() + blur_, middle[0]);
        std::fill(padded.end() - blur_, padded.end(), middle[width - 1]);
        filterRow(padded.data(), weights.data(), taps, &rows[y * width], int(width));
      }
    }, ctx.stop);
    return horizontal && ctx.arena->parallelFor(height, 16, [&](size_t begin, size_t end) {
      std::vector<const float*> around(weights.size());
      for (size_t y = begin; y < end; ++y) {
        for (int k = 0; k < taps; ++k) around[size_t(k)] = &rows[size_t(std::clamp(int(y) + k - blur_, 0, int(height) - 1)) * width];
        filterColumns(around.data(), weights.data(), taps, &e[y * width], int(width));
      }
    }, ctx.stop);
  }

  float c_;
  int blur_, resolution_;
  std::shared_ptr<ComputeDevice> device_;
};

}  // namespace

NodePtr makeExponentialShadowEncodeNode(float c, int blur, int resolution, std::shared_ptr<ComputeDevice> device) {
  return std::make_shared<EncodeNode>(c, blur, resolution, std::move(device));
}

}  // namespace gobo
