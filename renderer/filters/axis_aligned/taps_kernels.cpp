// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/taps_kernels.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "formulas/axis_aligned.glsl.h"

namespace gobo::axis_aligned {
namespace {

template <bool Planar, bool FourthOrder, bool Literal>
void addTaps(TapBlock& b, const TapLayer& L, size_t first, long shift, int from, int to, const int* reach) {
  float sum[kLanes], weight[kLanes], q1[kLanes], q2[kLanes], sumQ[kLanes];  // locals alias nothing: the loops vectorise without run-time checks
  for (int l = 0; l < kLanes; ++l) {
    sum[l] = b.sum[l];
    weight[l] = b.weight[l];
    q1[l] = b.q1[l];
    q2[l] = b.q2[l];
    sumQ[l] = b.sumQ[l];
  }
  for (int i = from; i <= to; ++i) {
    if (i == 0 && shift == 0) continue;
    const size_t at = size_t(long(first) + shift + i);
    const int offset = i < 0 ? -i : i;
    const float *lx = L.x + at, *ly = L.y + at, *lz = L.z + at, *lnx = L.nx + at, *lny = L.ny + at, *lnz = L.nz + at,
                *lb = (Literal ? L.compared : L.beta) + at, *lv = L.value + at;
    const float *lax = L.ax + at, *lay = L.ay + at;
    for (int l = 0; l < kLanes; ++l) {
      const float dx = lx[l] - b.x[l], dy = ly[l] - b.y[l], dz = lz[l] - b.z[l];
      const float d2 = dx * dx + dy * dy + dz * dz;
      float plane2;
      if constexpr (Planar) {
        const float du = lax[l] - b.ax[l], dv = lay[l] - b.ay[l];
        plane2 = (du * du + dv * dv) * b.az[l];
      } else {
        const float along = dx * b.ax[l] + dy * b.ay[l] + dz * b.az[l];
        plane2 = formulas::maxOf(d2 - along * along, 0.0f);
      }
      const float q = d2 <= b.reach2[l] ? plane2 * b.inverse[l] : 0.0f;
      const float cosine = lnx[l] * b.nx[l] + lny[l] * b.ny[l] + lnz[l] * b.nz[l];
      float apart;
      if constexpr (Literal) apart = std::fabs(lb[l] - b.compared[l]) - L.betaThreshold * formulas::maxOf(lb[l], b.compared[l]) - L.absolute;
      else apart = std::fabs(lb[l] - b.beta[l]) - L.betaThreshold * formulas::maxOf(lb[l], b.beta[l]);
      float w = d2 <= b.reach2[l] ? formulas::aaWeight(plane2, b.inverse[l]) : 0.0f;
      w = cosine >= L.cosAngle ? w : 0.0f;
      w = apart <= 0.0f ? w : 0.0f;
      w = offset <= reach[l] ? w : 0.0f;
      if constexpr (Literal) w = plane2 <= b.cut2[l] ? w : 0.0f;
      const float difference = lv[l] - b.v[l];
      weight[l] += w;
      sum[l] += w * difference;
      if constexpr (FourthOrder) {
        const float wq = w * q;
        q1[l] += wq;
        q2[l] += wq * q;
        sumQ[l] += wq * difference;
      }
    }
  }
  for (int l = 0; l < kLanes; ++l) {
    b.sum[l] = sum[l];
    b.weight[l] = weight[l];
    b.q1[l] = q1[l];
    b.q2[l] = q2[l];
    b.sumQ[l] = sumQ[l];
  }
}

}  // namespace

void TapBlock::load(const TapLayer& L, size_t first) {
  for (int l = 0; l < kLanes; ++l) {
    const size_t p = first + size_t(l);
    v[l] = L.value[p];
    x[l] = L.x[p];
    y[l] = L.y[p];
    z[l] = L.z[p];
    nx[l] = L.nx[p];
    ny[l] = L.ny[p];
    nz[l] = L.nz[p];
    ax[l] = L.ax[p];
    ay[l] = L.ay[p];
    az[l] = L.az[p];
    beta[l] = L.beta[p];
    compared[l] = L.literal ? L.compared[p] : beta[l];
    const float w = std::max(beta[l], 1.0e-18f);
    inverse[l] = 0.5f / (w * w);
    reach2[l] = L.reachBetas2 * w * w + L.reach2;
    cut2[l] = L.cutBetas2 * w * w;
    sum[l] = q1[l] = q2[l] = sumQ[l] = 0.0f;
    weight[l] = 1.0f;  // the centre tap
  }
}

void TapBlock::add(const TapLayer& L, size_t first, long shift, int from, int to, const int* reach, bool planar, bool fourthOrder) {
  const auto with = [&](auto one, auto four, auto literal) { addTaps<one, four, literal>(*this, L, first, shift, from, to, reach); };
  const auto chosen = [&](auto one, auto four) { L.literal ? with(one, four, std::true_type()) : with(one, four, std::false_type()); };
  const auto order = [&](auto one) { fourthOrder ? chosen(one, std::true_type()) : chosen(one, std::false_type()); };
  planar ? order(std::true_type()) : order(std::false_type());
}

float TapBlock::result(int lane, bool fourthOrder) const {
  const float gaussian = sum[lane] / weight[lane];
  if (!fourthOrder) return v[lane] + gaussian;
  const float determinant = weight[lane] * q2[lane] - q1[lane] * q1[lane];
  // Fewer taps than two distances leave the curvature open.
  if (!(determinant > 2.5e-4f * weight[lane] * weight[lane])) return v[lane] + gaussian;
  return v[lane] + (sum[lane] * q2[lane] - sumQ[lane] * q1[lane]) / determinant;
}

}  // namespace gobo::axis_aligned
