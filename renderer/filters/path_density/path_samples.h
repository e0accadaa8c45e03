// SPDX-License-Identifier: Apache-2.0
// Path samples before they are splatted: where each went through the film, and the light that it brought, direct and indirect apart. What
// path-density outlier rejection and its rivals read: a structure of arrays, in the order of arrival.
// Memory: 32 bytes a sample, at most what the limit says. Samples with a NaN or an infinity are left out and counted.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "base/vec.h"

namespace gobo::pathdensity {

/// Of somebody's samples; pixel (x, y) is [x, x + 1) x [y, y + 1) on the film, y from the top. Values are finite.
struct SampleView {
  int width = 0, height = 0;
  std::span<const float> film;              ///< x, y in pixels
  std::span<const float> direct, indirect;  ///< RGB radiance; what a sample shows is their sum. Direct: emission that the camera sees too; empty: there is none
  bool correlated = false;                  ///< samples follow from one another (Markov chains): they corroborate themselves
  size_t size() const { return film.size() / 2; }
  float directAt(size_t i) const { return direct.empty() ? 0.0f : direct[i]; }
};

class PathSamples {
 public:
  static constexpr size_t kBytesOfSample = 8 * sizeof(float);

  /// Of a picture. bytes: the most that samples may take.
  PathSamples(int width, int height, size_t bytes = size_t(1) << 30) : width_(width), height_(height), limit_(bytes) {}

  /// Room for that many more. Errors: ResourceExhausted, with the limit, when they do not fit.
  Status reserve(size_t samples);
  /// A sample of pixel (x, y), which lies in the picture; `film` is moved into it where rounding left it outside. Errors: as reserve().
  Status add(int x, int y, const Vec2& film, const Vec3& direct, const Vec3& indirect);
  /// From now on the samples count as correlated.
  void markCorrelated() { correlated_ = true; }

  size_t size() const { return film_.size() / 2; }
  /// What is allocated for them.
  size_t bytes() const { return sizeof(float) * (film_.capacity() + direct_.capacity() + indirect_.capacity()); }
  uint64_t dropped() const { return dropped_; }  ///< not finite
  SampleView view() const { return {width_, height_, film_, direct_, indirect_, correlated_}; }

 private:
  int width_, height_;
  size_t limit_;
  bool correlated_ = false;
  uint64_t dropped_ = 0;
  std::vector<float> film_, direct_, indirect_;
};

}  // namespace gobo::pathdensity
