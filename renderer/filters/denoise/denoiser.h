// SPDX-License-Identifier: Apache-2.0
// Denoiser: a filter of path-traced light that looks at the picture, at its two halves and at what the camera sees (docs/noise.md). One folder each;
// listed in denoise/registry.cpp. DenoiseNode makes a node of any of them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/hash.h"
#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::denoise {

/// Planes of width * height pixels, rows from the top, channels interleaved. Radiance is demodulated: divided by `modulation`, so that textures are
/// not in it; it may be negative where weights of lights are.
struct NoisyPicture {
  int width = 0, height = 0;
  std::span<const float> mean;      ///< RGB, of all samples
  std::span<const float> a, b;      ///< RGB, of the first and of the other samples; both the mean where `halves` is false
  std::span<const float> variance;  ///< RGB, of the mean (per pixel and channel, >= 0): smoothed over like pixels
  bool halves = false;              ///< there are at least two samples a pixel: a and b have noise of their own
  float shareOfA = 0.5f;            ///< of the samples
  // Of the view samples of the pixel, without noise (denoise/features.h).
  std::span<const float> albedo;     ///< RGB
  std::span<const float> normal;     ///< XYZ, mean of unit vectors: shorter where they differ, 0 where nothing is hit
  std::span<const float> position;   ///< XYZ in m, mean over samples that hit
  std::span<const float> depth;      ///< distance in m, mean over samples that hit, 0 where none does
  std::span<const float> footprint;  ///< width of a pixel at the surface in m, 0 where nothing is hit
  std::span<const float> coverage;   ///< share of the view samples that hit, 0 .. 1
  std::span<const float> even;       ///< 1 where the view samples lie on one smooth surface, else 0
  // Of light of one lobe whose paths are known further; else empty.
  std::span<const float>
      curvature;  ///< mean over samples and channels of light times (footprint / z)^2, z: what it comes from is that far (trace/curvature_sums.h)
  std::span<const float> alpha;  ///< width of the lobe (GGX), 0 .. 1; empty: of all directions
  std::span<const float> blur;   ///< radius in pixels of the disk that a lens makes of what the pixel shows (band_limit/lens_blur.h); empty: no lens
  size_t pixels() const { return size_t(width) * size_t(height); }
};

class Denoiser {
 public:
  virtual ~Denoiser() = default;
  virtual const char* name() const = 0;      ///< as in v1.Denoise
  virtual int version() const { return 1; }  ///< bump when results change for equal parameters
  virtual void hashParameters(Hasher& hasher) const = 0;
  /// Pixels around one that its result depends on, at most: a part of a picture has the bits of the whole. No sum may run along a row for longer.
  virtual int halo() const = 0;
  /// False: its weights know nothing of the light of single pixels, so that the mean comes out as that of both halves, at half the cost
  /// (where no choice is made by them).
  virtual bool looksAtHalves() const { return true; }
  virtual double nsPerPixel() const = 0;  ///< of one core, both halves: for estimates of time
  virtual size_t workingBytes(int width, int height) const { return (void)width, (void)height, size_t(0); }
  /// Denoises a into outA and b into outB (RGB, every element is written, finite for finite input). What outA is of b is at most its weights, so that
  /// outA - b tells how wrong outA is. Where p.halves is false outA alone is read. false: stopped.
  virtual bool run(const NoisyPicture& p, std::span<float> outA, std::span<float> outB, const TaskArena& arena, const StopToken& stop) const = 0;
};
using DenoiserPtr = std::shared_ptr<const Denoiser>;

}  // namespace gobo::denoise
