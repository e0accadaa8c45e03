// SPDX-License-Identifier: Apache-2.0
// Inner loops of the sheared filter.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gobo::sheared {

/// The kernel over pixels is a tent along each axis of the light; its half width in its standard deviations, sqrt(6).
inline constexpr float kTentOfDeviation = 2.4494897f;

/// Sums of a window's five moments: `values` are five planes of `plane` elements, `sums` five of `stride`. As addToWindow of the axis-aligned filter: only
/// pixels of the same instance are added.
void addMoments(size_t n, const uint32_t* instance, const uint32_t* other, const float* values, float* sums, size_t plane, size_t stride);

/// One layer of a picture, structure of arrays.
struct GatherLayer {
  const float *x, *y, *height;   ///< place seen from the light's centre, metres a metre along its normal; distance from its plane
  const float *px, *py, *pz;     ///< place relative to the light
  const float *nx, *ny, *nz;     ///< normal
  const float *shear, *width;    ///< of terms/shear.h
  const float* area;             ///< of the plane that is parallel to the light that a pixel stands for, square metres; 0: unknown, nothing is taken there
  const uint32_t *instance, *n;  ///< n: samples of a pixel
  const float* points;           ///< 4 `kept` a pixel (terms/light_samples.h)
  size_t kept;
  int columns, rows;
  float halfU, halfV, cosAngle;
};

struct Gathered {
  double seen = 0, weight = 0;  ///< of samples
  double taken = 0;             ///< integral of the kernel over the pixels whose samples were taken, square metres
};

/// Every sample (x', y') of the pixels up to rx columns and ry rows from pixel (x, y) whose sheared place y' + a (x' - x) is on the light, weighted by tent(x'
/// - x) / density(y' + a (x' - x)): how much of the kernel can reach that place, so that all of the light counts alike.
Gathered gather(const GatherLayer& L, int x, int y, int rx, int ry);

/// The same in two steps where a row of pixels runs along the light's u and a column along its v. First: pixels of the row alone, into `bins` parts of the
/// light along v: sums of weight times visibility, then of weight. Returns what of the kernel was taken.
float gatherRow(const GatherLayer& L, int x, int y, int rx, int bins, float* sums);
/// Second: the sums of the pixels of a column, made by gatherRow.
Gathered gatherColumn(const GatherLayer& L, int x, int y, int ry, int bins, const float* sums, const float* taken);

}  // namespace gobo::sheared
