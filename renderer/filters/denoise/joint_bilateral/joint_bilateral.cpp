// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/joint_bilateral/joint_bilateral.h"

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "filters/denoise/joint_bilateral/joint_bilateral_kernels.h"

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

  size_t workingBytes(int width, int height) const override { return kPlanes * sizeof(float) * size_t(width) * size_t(height); }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    const auto planes = std::make_unique_for_overwrite<float[]>(kPlanes * p.pixels());
    const auto plane = [&](int k) { return planes.get() + size_t(k) * p.pixels(); };
    const int channels = p.halves ? 6 : 3;
    BilateralPlanes k;
    k.width = p.width;
    k.height = p.height;
    k.channels = channels;
    for (int c = 0; c < 3; ++c) {
      k.albedo[c] = plane(c);
      k.unit[c] = plane(3 + c);
      k.place[c] = plane(6 + c);
    }
    k.length = plane(9);
    k.footprint = plane(10);
    k.hit = plane(11);
    for (int c = 0; c < channels; ++c) k.light[c] = plane(kLight + c);
    float* out[6];
    for (int c = 0; c < 6; ++c) out[c] = plane(kLight + 6 + c);
    bool complete = arena.parallelFor(
        p.pixels(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const bool hit = p.coverage[i] > 0;
            const float* n = &p.normal[3 * i];
            const double length = std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1] + double(n[2]) * n[2]);
            for (size_t c = 0; c < 3; ++c) {
              plane(int(c))[i] = hit ? p.albedo[3 * i + c] : 0.0f;
              plane(3 + int(c))[i] = hit && length > 0 ? float(n[c] / length) : 0.0f;
              plane(6 + int(c))[i] = hit ? p.position[3 * i + c] : 0.0f;
              plane(kLight + int(c))[i] = p.a[3 * i + c];
              if (p.halves) plane(kLight + 3 + int(c))[i] = p.b[3 * i + c];
            }
            plane(9)[i] = hit ? float(length) : 0.0f;
            plane(10)[i] = hit ? p.footprint[i] : 0.0f;
            plane(11)[i] = hit ? 1.0f : 0.0f;
          }
        },
        stop);
    complete = complete && arena.parallelFor(
                               size_t(p.height), 1,
                               [&](size_t begin, size_t end) {
                                 for (size_t y = begin; y < end; ++y) {
                                   bilateralRow(k, alike_, spatial_.data(), radius_, int(y), out);
                                   for (size_t i = y * size_t(p.width); i < (y + 1) * size_t(p.width); ++i)
                                     for (size_t c = 0; c < 3; ++c) {
                                       outA[3 * i + c] = out[c][i];
                                       if (p.halves) outB[3 * i + c] = out[3 + c][i];
                                     }
                                 }
                               },
                               stop);
    return complete;
  }

 private:
  static constexpr int kLight = 12, kPlanes = kLight + 12;  // features; a and b; what is made of them
  int radius_;
  Alike alike_;
  std::vector<float> spatial_;  // by distance in x or y
};

}  // namespace

DenoiserPtr makeJointBilateral(const v1::JointBilateralDenoise& settings) { return std::make_shared<JointBilateral>(settings); }

}  // namespace gobo::denoise
