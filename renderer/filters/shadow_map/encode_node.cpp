// SPDX-License-Identifier: Apache-2.0
// Filter: depth map -> basis images, pre-filtered. Strips of rows are encoded and filtered both ways while they are in the cache: a map
// of 64 images never exists in float beside its bytes.
#include <algorithm>

#include "filters/shadow_map/exponential_device.h"
#include "filters/shadow_map/gaussian_kernels.h"
#include "filters/shadow_map/shadow_map.h"
#include "formulas/exponential_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

std::vector<float> shadowGaussian(int radius) {
  std::vector<float> weights(size_t(2 * radius + 1));
  const float sigma = float(2 * radius + 1) / 4.0f;
  double sum = 0.0;
  for (int k = -radius; k <= radius; ++k) sum += weights[size_t(k + radius)] = formulas::esmGaussian(float(k), sigma);
  for (float& w : weights) w = float(w / sum);
  return weights;
}

namespace {

class EncodeNode : public Node {
 public:
  EncodeNode(ShadowBasisPtr basis, int blur, int resolution, int faces, bool bytes, std::shared_ptr<ComputeDevice> device)
      : basis_(std::move(basis)), blur_(blur), resolution_(resolution), faces_(faces), bytes_(bytes), device_(std::move(device)) {
    GOBO_CHECK(blur >= 0 && (!bytes || basis_->bounded()));
  }
  std::string type() const override { return "shadow_encode"; }
  std::string numericClass() const override { return device_ ? device_->numericClass() : Node::numericClass(); }
  std::string device() const override { return device_ ? std::string(device_->kind()) + ": " + device_->name() : "cpu"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(std::string_view(basis_->name())).add(blur_).add(bytes_);
    basis_->hashEncode(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.reads<float>(0, "z").require(!device_ || w.input(0).extent.layers <= 1, "one face, on a device");
    const PlaneShape B{"B", bytes_ ? Format::U8 : Format::F32, basis_->channels()};
    return w.gives({"shadow_basis", Domain::LightTexel, w.input(0).extent, {B}});  // maps need not be square: tests filter strips
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& depth = *ctx.inputs.at(0);
    const Extent packed = depth.extent();
    const std::span<const float> z = depth.floats("z");
    GOBO_CHECK_EQ(z.size(), packed.elements());
    const auto& term = ctx.result;
    const std::vector<float> weights = shadowGaussian(blur_);
    const int width = packed.width, height = packed.height;
    std::span<float> floats;
    std::span<uint8_t> bytes;
    if (bytes_) bytes = term->writable<uint8_t>("B");
    else floats = term->writable<float>("B");
    if (device_ && !z.empty()) {
      GOBO_CHECK(packed.layers == 1);
      GOBO_TRY(deviceEncode(ResidentPlanes::of(device_), ctx.inputs[0], basis_->exponent(), weights, term));
      if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "shadow_encode stopped");
      return TermPtr(term);
    }
    const size_t step = size_t(basis_->channels()), row = size_t(width) * step;
    const size_t strips = (size_t(height) + kStrip - 1) / kStrip;
    const bool done = ctx.arena->parallelFor(
        strips * size_t(packed.layers), 1,
        [&](size_t from, size_t to) {
          Strip strip(size_t(width), step, blur_);
          for (size_t s = from; s < to; ++s) {
            const size_t face = s / strips;
            const int y0 = int(s % strips) * kStrip, y1 = std::min(y0 + kStrip, height);
            if (!strip.make(*basis_, z.data() + face * size_t(width) * size_t(height), height, y0, y1, weights, ctx.stop)) return;
            for (int y = y0; y < y1; ++y) {
              if (ctx.stop.stopRequested()) return;
              const size_t at = (face * size_t(height) + size_t(y)) * row;
              if (bytes_) {
                strip.finish(y, weights, basis_->logarithmic(), strip.line());
                toBytes(strip.line(), &bytes[at], row);
              } else {
                strip.finish(y, weights, basis_->logarithmic(), &floats[at]);
              }
            }
          }
        },
        ctx.stop);
    if (!done || ctx.stop.stopRequested()) return Status(Code::Cancelled, "shadow_encode stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kStrip = 32;

  // Rows y0 - blur .. y1 + blur, encoded and filtered along x.
  class Strip {
   public:
    Strip(size_t width, size_t step, int blur)
        : width_(width),
          step_(step),
          blur_(blur),
          rows_(size_t(kStrip + 2 * blur) * width * step),
          padded_((width + 2 * size_t(blur)) * step),
          line_(width * step),
          around_(size_t(2 * blur + 1)) {}
    float* line() { return line_.data(); }
    /// False: stopped. Looked for row by row: one of a wide map with a wide kernel takes a millisecond.
    bool make(const ShadowBasis& basis, const float* z, int height, int y0, int y1, const std::vector<float>& weights, const StopToken& stop) {
      first_ = y0 - blur_;
      height_ = height;
      const size_t row = width_ * step_, pad = size_t(blur_) * step_;
      for (int y = std::max(first_, 0); y < std::min(y1 + blur_, height); ++y) {
        if (stop.stopRequested()) return false;
        float* to = &rows_[size_t(y - first_) * row];
        if (blur_ == 0) {
          basis.encode(z + size_t(y) * width_, to, width_);
          continue;
        }
        float* middle = padded_.data() + pad;
        basis.encode(z + size_t(y) * width_, middle, width_);
        for (int k = 0; k < blur_; ++k) {
          std::copy_n(middle, step_, padded_.data() + size_t(k) * step_);
          std::copy_n(middle + row - step_, step_, middle + row + size_t(k) * step_);
        }
        if (basis.logarithmic() > 0.0f) filterRowLogarithmic(padded_.data(), weights.data(), int(weights.size()), basis.logarithmic(), to, row);
        else filterRow(padded_.data(), weights.data(), int(weights.size()), step_, to, row);
      }
      return true;
    }
    void finish(int y, const std::vector<float>& weights, float logarithmic, float* out) {
      const size_t row = width_ * step_;
      for (size_t k = 0; k < weights.size(); ++k) around_[k] = &rows_[size_t(std::clamp(y + int(k) - blur_, 0, height_ - 1) - first_) * row];
      if (blur_ == 0) std::copy_n(around_[0], row, out);
      else if (logarithmic > 0.0f) filterColumnsLogarithmic(around_.data(), weights.data(), int(weights.size()), logarithmic, out, row);
      else filterColumns(around_.data(), weights.data(), int(weights.size()), out, row);
    }

   private:
    size_t width_, step_;
    int blur_, first_ = 0, height_ = 0;
    std::vector<float> rows_, padded_, line_;
    std::vector<const float*> around_;
  };

  ShadowBasisPtr basis_;
  int blur_, resolution_, faces_;
  bool bytes_;
  std::shared_ptr<ComputeDevice> device_;
};

}  // namespace

NodePtr makeShadowEncodeNode(ShadowBasisPtr basis, int blur, int resolution, int faces, bool bytes, std::shared_ptr<ComputeDevice> device) {
  return std::make_shared<EncodeNode>(std::move(basis), blur, resolution, faces, bytes, std::move(device));
}

}  // namespace filters
}  // namespace gobo
