// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/joint_bilateral/joint_bilateral.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "filters/denoise/similar.h"

namespace gobo::denoise {

namespace {

float perSquare(double sigma) { return float(0.5 / (sigma * sigma)); }

class JointBilateral final : public Denoiser {
 public:
  explicit JointBilateral(const v1::JointBilateralDenoise& s)
      : radius_(int(s.radius_px())),
        alike_{perSquare(s.albedo()), perSquare(s.normal_deg() * std::numbers::pi / 180), perSquare(s.plane_px())},
        spatial_(size_t(radius_) + 1) {
    for (size_t i = 0; i < spatial_.size(); ++i) spatial_[i] = radius_ ? float(std::exp(-2.0 * double(i * i) / double(radius_ * radius_))) : 1.0f;
  }
  const char* name() const override { return "joint_bilateral"; }
  void hashParameters(Hasher& h) const override { h.add(radius_).add(alike_.perAlbedo).add(alike_.perNormal).add(alike_.perPlane); }
  int halo() const override { return radius_; }
  double nsPerPixel() const override { return 12.0 * (2 * radius_ + 1) * (2 * radius_ + 1); }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    const Features f{p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage};
    return arena.parallelFor(
        size_t(p.height), 1,
        [&](size_t begin, size_t end) {
          for (int y = int(begin); y < int(end); ++y)
            for (int x = 0; x < p.width; ++x) pixel(p, f, x, y, outA, outB);
        },
        stop);
  }

 private:
  void pixel(const NoisyPicture& p, const Features& f, int x, int y, std::span<float> outA, std::span<float> outB) const {
    const size_t at = size_t(y) * size_t(p.width) + size_t(x);
    double weights = 0, a[3] = {}, b[3] = {};
    for (int v = std::max(y - radius_, 0); v <= std::min(y + radius_, p.height - 1); ++v)
      for (int u = std::max(x - radius_, 0); u <= std::min(x + radius_, p.width - 1); ++u) {
        const size_t q = size_t(v) * size_t(p.width) + size_t(u);
        const float near = spatial_[size_t(std::abs(u - x))] * spatial_[size_t(std::abs(v - y))];
        const double w = q == at ? 1.0 : double(near * similarity(f, at, q, alike_));
        weights += w;
        for (size_t c = 0; c < 3; ++c) {
          a[c] += w * p.a[3 * q + c];
          b[c] += w * p.b[3 * q + c];
        }
      }
    for (size_t c = 0; c < 3; ++c) {
      outA[3 * at + c] = float(a[c] / weights);
      outB[3 * at + c] = float(b[c] / weights);
    }
  }

  int radius_;
  Alike alike_;
  std::vector<float> spatial_;  // by distance in x or y
};

}  // namespace

DenoiserPtr makeJointBilateral(const v1::JointBilateralDenoise& settings) { return std::make_shared<JointBilateral>(settings); }

}  // namespace gobo::denoise
