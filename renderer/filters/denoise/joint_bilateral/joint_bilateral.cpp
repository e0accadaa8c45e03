// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/joint_bilateral/joint_bilateral.h"

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "filters/denoise/similar_rows.h"
#include "terms/scratch.h"

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

  size_t workingBytes(int width, int height) const override {
    return AlikeFeatures::bytes(width, height) + 12 * sizeof(float) * size_t(width) * size_t(height);
  }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    AlikeFeatures alike;
    if (!alike.fill({p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage}, p.width, p.height, arena, stop)) return false;
    const int channels = p.halves ? 6 : 3;
    const Scratch<float> planes(2 * size_t(channels) * p.pixels());
    float *in[6], *out[6];
    for (int c = 0; c < channels; ++c) {
      in[c] = planes.get() + size_t(c) * p.pixels();
      out[c] = planes.get() + size_t(channels + c) * p.pixels();
    }
    bool complete = arena.parallelFor(
        p.pixels(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i)
            for (int c = 0; c < channels; ++c) in[c][i] = c < 3 ? p.a[3 * i + size_t(c)] : p.b[3 * i + size_t(c - 3)];
        },
        stop);
    complete = complete && arena.parallelFor(
                               size_t(p.height), 1,
                               [&](size_t begin, size_t end) {
                                 for (size_t y = begin; y < end; ++y) {
                                   alikeMeansRow(alike.planes(), alike_, spatial_.data(), radius_, in, channels, int(y), out);
                                   for (size_t i = y * size_t(p.width); i < (y + 1) * size_t(p.width); ++i)
                                     for (int c = 0; c < channels; ++c) (c < 3 ? outA : outB)[3 * i + size_t(c % 3)] = out[c][i];
                                 }
                               },
                               stop);
    return complete;
  }

 private:
  int radius_;
  Alike alike_;
  std::vector<float> spatial_;  // by distance in x or y
};

}  // namespace

DenoiserPtr makeJointBilateral(const v1::JointBilateralDenoise& settings) { return std::make_shared<JointBilateral>(settings); }

}  // namespace gobo::denoise
