// SPDX-License-Identifier: Apache-2.0
// The abstraction's loop over a run of pixels of one row, for one offset.
#pragma once

#include <cstddef>

namespace gobo {

/// A layer, component by component. Places are in units of sigma, areas in those of its square; area 0: no sample.
/// narrower: squares of sigma by that of the sample, where that varies; else null.
struct AbstractionPlanes {
  const float *x, *y, *z, *nx, *ny, *nz, *area, *d, *narrower;
};

/// For n samples from e on: weights += w of the sample `offset` further, sums += w times what its distance has more; nothing beyond `reach2` or where normals
/// differ by more than the angle of `cosine`.
void addOffset(const AbstractionPlanes& p, size_t e, ptrdiff_t offset, size_t n, float reach2, float cosine, float* sums, float* weights);

}  // namespace gobo
