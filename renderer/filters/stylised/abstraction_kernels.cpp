// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction_kernels.h"

#include <type_traits>

#include "filters/denoise/fast_exp.h"

namespace gobo {

namespace {

/// The planes as parameters of their own: GCC takes `restrict` of those alone.
template <bool kVaries>
void add(const float* __restrict ax, const float* __restrict ay, const float* __restrict az, const float* __restrict anx, const float* __restrict any,
         const float* __restrict anz, const float* __restrict ad, const float* __restrict bx, const float* __restrict by, const float* __restrict bz,
         const float* __restrict bnx, const float* __restrict bny, const float* __restrict bnz, const float* __restrict bd, const float* __restrict area,
         const float* __restrict narrower, size_t n, float reach2, float cosine, float* __restrict sums, float* __restrict weights) {
  for (size_t k = 0; k < n; ++k) {
    const float x = bx[k] - ax[k], y = by[k] - ay[k], z = bz[k] - az[k], far2 = x * x + y * y + z * z, r2 = kVaries ? far2 * narrower[k] : far2;
    const float dot = anx[k] * bnx[k] + any[k] * bny[k] + anz[k] * bnz[k];
    const float whole = denoise::fastExp(-0.5f * r2) * area[k];
    const float within = r2 <= reach2 ? whole : 0.0f, w = dot >= cosine ? within : 0.0f;
    sums[k] += w * (bd[k] - ad[k]);
    weights[k] += w;
  }
}

}  // namespace

void addOffset(const AbstractionPlanes& p, size_t e, ptrdiff_t offset, size_t n, float reach2, float cosine, float* sums, float* weights) {
  const size_t f = size_t(ptrdiff_t(e) + offset);
  const auto run = [&](auto varies) {
    add<decltype(varies)::value>(p.x + e, p.y + e, p.z + e, p.nx + e, p.ny + e, p.nz + e, p.d + e, p.x + f, p.y + f, p.z + f, p.nx + f, p.ny + f, p.nz + f,
                                 p.d + f, p.area + f, varies ? p.narrower + e : nullptr, n, reach2, cosine, sums, weights);
  };
  if (p.narrower) run(std::true_type());
  else run(std::false_type());
}

}  // namespace gobo
