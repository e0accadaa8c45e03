// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/band_limit/lens_filter.h"

#include <algorithm>
#include <memory>

#include "filters/denoise/band_limit/blurred_means.h"
#include "filters/denoise/plane_set.h"

namespace gobo::denoise {

namespace {

class LensFilter final : public Denoiser {
 public:
  explicit LensFilter(float share) : share_(share) {}
  const char* name() const override { return "lens"; }
  void hashParameters(Hasher& h) const override { h.add(share_); }
  int halo() const override { return bandRadius(share_); }
  bool looksAtHalves() const override { return false; }
  double nsPerPixel() const override { return 2.0 * (2 * halo() + 1) * (2 * halo() + 1); }
  size_t workingBytes(int width, int height) const override { return 13 * sizeof(float) * size_t(width) * size_t(height); }

  bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const override {
    if (p.blur.empty()) {
      std::copy(p.a.begin(), p.a.end(), outA.begin());
      if (p.halves) std::copy(p.b.begin(), p.b.end(), outB.begin());
      return true;
    }
    const size_t channels = p.halves ? 6 : 3;
    const PlaneSet light(int(channels), p.pixels()), smooth(int(channels), p.pixels());
    const auto each = [&](const auto& body) {
      return arena.parallelFor(
          p.pixels(), 1 << 13,
          [&](size_t begin, size_t end) {
            for (size_t i = begin; i < end; ++i)
              for (size_t c = 0; c < channels; ++c) body(i, c);
          },
          stop);
    };
    return each([&](size_t i, size_t c) { light[c][i] = (c < 3 ? p.a : p.b)[3 * i + c % 3]; }) &&
           bandLimitedMeans(p.blur, share_, p.width, p.height, light.in(), smooth.out(), arena, stop) &&
           each([&](size_t i, size_t c) { (c < 3 ? outA : outB)[3 * i + c % 3] = smooth[c][i]; });
  }

 private:
  float share_;
};

}  // namespace

DenoiserPtr makeLensFilter(float share) { return std::make_shared<LensFilter>(share); }

}  // namespace gobo::denoise
