// SPDX-License-Identifier: Apache-2.0
// The abstraction's loops over a run of samples of one row.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gobo {
inline namespace filters {

/// A layer, component by component. Places are in units of sigma, areas in those of its square; area 0: no sample.
/// narrower: squares of sigma by that of the sample, where that varies; else null.
struct AbstractionPlanes {
  const float *x, *y, *z, *nx, *ny, *nz, *area, *d, *narrower;
};
inline constexpr float kAbstractionReach = 3.0f;  ///< sigmas

/// For n samples from e on: weights += w of the sample `offset` further, sums += w times what its distance has more; nothing beyond `reach2` or where normals
/// differ by more than the angle of `cosine`.
void addOffset(const AbstractionPlanes& p, size_t e, ptrdiff_t offset, size_t n, float reach2, float cosine, float* sums, float* weights);

/// addOffset for each `stride`th sample of a picture of width x height within `reach` strides of samples `begin` to `end` of row y, but for those themselves.
void addDisc(const AbstractionPlanes& p, int width, int height, int y, int begin, int end, float reach, int stride, float cosine, float* sums, float* weights);

/// A row of a surface, component by component: places, normals, geometric normals, widths of a pixel, areas and distances; id ~0: no sample.
struct SurfaceRow {
  float *x, *y, *z, *nx, *ny, *nz, *gx, *gy, *gz, *width, *area, *d;
  uint32_t* id;
};
/// n vectors of three, times scale.
void splitVectors(const float* from, size_t n, float scale, float* x, float* y, float* z);
/// joined[k] = 1 where a's sample k and b's sample k + shift lie on one surface (contour.h, onOneSurface), else 0.
void joinSamples(const SurfaceRow& a, const SurfaceRow& b, size_t shift, size_t n, float cosine, float* joined);
/// a.area[k]: of the parallelogram to a's next sample and b's.
void areasOfRow(const SurfaceRow& a, const SurfaceRow& b, size_t n);

/// Means by area over n cells of 2 x 2 samples of rows a and b: places, unit normals and distances; areas, at most `most`, and least widths.
void cellsOfRows(const SurfaceRow& a, const SurfaceRow& b, size_t n, float least, float most, const SurfaceRow& cells);
/// whole[k] = all of the four factors of samples 2k and 2k + 1.
void wholeCells(const float* f0, const float* f1, const float* f2, const float* f3, size_t n, uint8_t* whole);

}  // namespace filters
}  // namespace gobo
