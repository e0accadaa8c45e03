// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/band_limit/lens_blur.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "formulas/lens.glsl.h"

namespace gobo::denoise {

namespace {

class LensBlurNode final : public Node {
 public:
  LensBlurNode(const Camera& camera, int pictureHeight, int width, int height, int samples)
      : position_(Vec3(camera.toWorld[3])),
        forward_(-Vec3(camera.toWorld[2])),
        perspective_(camera.perspective),
        radius_(camera.optics.lensRadius),
        focus_(camera.optics.focus),
        // Of the axis along which a pixel is wider, where the disk is fewer pixels.
        focal_(float(double(pictureHeight) / camera.windowHeight64() / std::max(1.0, double(camera.optics.pixelAspect)))),
        width_(width),
        height_(height),
        samples_(samples) {}
  std::string type() const override { return "lens_blur"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = 1;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    for (int c = 0; c < 3; ++c) h.add(position_[c]).add(forward_[c]);
    h.add(perspective_).add(radius_).add(focus_).add(focal_).add(width_).add(height_).add(samples_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {width_, height_, samples_}).reads<float>(0, "P", {3}).reads<float>(0, "depth");
    return w.gives({type(), Domain::Pixel, {width_, height_, 1}, {unsetPlane<float>("blur")}});
  }
  size_t workingBytes() const override { return sizeof(float) * size_t(width_) * size_t(height_); }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto place = ctx.inputs[0]->floats("P"), depth = ctx.inputs[0]->floats("depth");
    const auto blur = ctx.result->writable<float>("blur");
    const size_t pixels = blur.size(), width = size_t(width_);
    std::vector<float> own(pixels);
    bool complete = ctx.arena->parallelFor(
        pixels, 1 << 12,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            float least = kMostBlur;
            for (size_t s = 0; s < size_t(samples_); ++s) {
              const size_t i = s * pixels + p;
              least = std::min(least, confusion(std::isfinite(depth[i]), Vec3(place[3 * i], place[3 * i + 1], place[3 * i + 2])));
            }
            own[p] = least;
          }
        },
        ctx.stop);
    complete = complete && ctx.arena->parallelFor(
                               size_t(height_), 8,
                               [&](size_t begin, size_t end) {
                                 for (int y = int(begin); y < int(end); ++y)
                                   for (int x = 0; x < width_; ++x) {
                                     float least = kMostBlur;
                                     for (int v = std::max(y - 1, 0); v <= std::min(y + 1, height_ - 1); ++v)
                                       for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width_ - 1); ++u)
                                         least = std::min(least, own[size_t(v) * width + size_t(u)]);
                                     blur[size_t(y) * width + size_t(x)] = least;
                                   }
                               },
                               ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  /// Beyond kMostBlur it may be infinite: at the lens, of nothing.
  float confusion(bool hit, const Vec3& at) const {
    const float z = glm::dot(at - position_, forward_);
    if (perspective_) return formulas::lensConfusion(radius_, focus_, focal_, hit ? 1.0f / z : 0.0f);
    return hit ? formulas::lensConfusionTelecentric(radius_, focus_, focal_, z) : kMostBlur;
  }

  Vec3 position_, forward_;
  bool perspective_;
  float radius_, focus_, focal_;
  int width_, height_, samples_;
};

}  // namespace

NodePtr makeLensBlurNode(const Camera& camera, int pictureHeight, int width, int height, int viewSamples) {
  return std::make_shared<LensBlurNode>(camera, pictureHeight, width, height, viewSamples);
}

}  // namespace gobo::denoise
