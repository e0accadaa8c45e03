// SPDX-License-Identifier: Apache-2.0
// Temporal accumulation: each frame's light is blended into that of the frames before, where they saw the same surface (Schied et al. 2017, the temporal
// part; history held to the new frame's neighbourhood: Karis 2014, by mean and deviation as Salvi 2016 has it).
//
// Computes     per pixel and channel, h the light of the earlier pixels (reprojection.h) and n the frames in it (the harmonic mean: noise goes as 1/n),
//                  a = max(1 / (n + 1), leastShare),  L = h + a (x - h),  v = (1 - a)^2 v_h + a^2 v_x
//              so that L is the mean of all frames until 1 / leastShare of them are in it, and noise falls to a / (2 - a) of a frame's after that. v counts the
//              earlier pixels as if they erred together: too much between pixels. Clamping: h is first moved into m +- clampDeviations s, m and s the mean and
//              the deviation of x over the same surface within clampRadius pixels; s at least that of a pixel's own noise. v knows nothing of it.
//              A pixel whose earlier ones (bilinear) have less than a hundredth of their weight on its surface starts anew.
// Inputs       NoisyPicture (mean, variance, position, normal, coverage, footprint: light without textures), the camera, indices of objects if there are any.
// Cost         four pixels and, with clamping, (2 clampRadius + 1)^2 tests a pixel; 15 floats a pixel of memory.
// Fails where  light changes: without clamping what was stays behind for 1 / leastShare frames; with it, up to clampDeviations of the neighbourhood's spread,
//              which is its noise where it is noisy. Reflections do not move with the surface that they are seen on. What moves by itself starts anew.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "filters/denoise/denoiser.h"
#include "filters/denoise/temporal/reprojection.h"

namespace gobo::denoise {

struct TemporalSettings {
  float leastShare = 0.1f;  ///< of a new frame, 0 .. 1
  SameSurface surface;
  float clampDeviations = 0.0f;  ///< 0: history as it is
  int clampRadius = 3;
};

struct TemporalFrame {
  NoisyPicture picture;
  Camera camera;
  std::span<const float> object;  ///< may be empty
};

class TemporalAccumulator {
 public:
  explicit TemporalAccumulator(const TemporalSettings& settings) : settings_(settings) {}
  /// A frame of another size than that before starts anew. Light that is not finite is not taken in. False: stopped, nothing has changed.
  bool add(const TemporalFrame& frame, const TaskArena& arena, const StopToken& stop = {});
  std::span<const float> light() const { return last_.light; }        ///< RGB; 0 where there was none yet
  std::span<const float> variance() const { return last_.variance; }  ///< RGB, of light()
  std::span<const float> frames() const { return last_.frames; }      ///< that are in a pixel, at most 4096
  /// `now`, whose light is that of all frames: for a filter behind. Both halves are the mean.
  NoisyPicture picture(const NoisyPicture& now) const;

 private:
  struct State {
    int width = 0, height = 0;
    Camera camera;
    std::vector<float> light, variance, frames;
    std::vector<float> position, normal, coverage, footprint, object;
    SeenSurfaces seen() const { return {width, height, position, normal, coverage, footprint, object}; }
  };
  TemporalSettings settings_;
  State last_;
};

}  // namespace gobo::denoise
