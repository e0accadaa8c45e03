// SPDX-License-Identifier: Apache-2.0
// The inner loop of the axis-aligned filter: eight neighbouring pixels of a row, each with its own kernel, and taps that are added to all eight.
#pragma once

#include <cstddef>

namespace gobo::axis_aligned {

inline constexpr int kLanes = 8;
inline constexpr float kReject = -1.0e30f;  ///< a beta that differs from every other by more than any threshold: no tap is taken from there

/// One layer of a picture, structure of arrays; metres relative to the light. `a`: unit normal of the light's plane for the pixel. A light with one
/// plane (planar): ax, ay are the pixel's place seen from the light's centre, metres per metre along the plane's normal, az its square distance
/// from the plane; a plane at infinity: ax, ay the pixel's place along it in metres, az 1.
struct TapLayer {
  const float *x, *y, *z, *nx, *ny, *nz, *ax, *ay, *az, *beta, *value;
  float betaThreshold = 1.0f, cosAngle = -2.0f;
  float reachBetas2 = 36.0f, reach2 = 0.0f;  ///< a tap's square distance in space is at most reachBetas2 beta^2 + reach2
  bool literal = false;                      ///< what follows counts
  const float* compared = nullptr;           ///< what is compared with betaThreshold in the place of beta; kReject where no tap is taken from
  float absolute = 0.0f;                     ///< and may differ by this besides
  float cutBetas2 = 1.0e30f;                 ///< no weight where the square distance in the plane is above this many beta^2
};

/// Pixels `first`..first+7 and their running sums over the taps, of differences to the centre, so that a constant stays itself to the bit.
/// With q = dist^2 / (2 beta^2), w = e^-q: weight = sum w, sum = sum w dV, and for the fourth order q1 = sum w q, q2 = sum w q^2, sumQ = sum w q dV.
struct TapBlock {
  float v[kLanes], x[kLanes], y[kLanes], z[kLanes], nx[kLanes], ny[kLanes], nz[kLanes], ax[kLanes], ay[kLanes], az[kLanes];
  float beta[kLanes], compared[kLanes], inverse[kLanes], reach2[kLanes], cut2[kLanes], sum[kLanes], weight[kLanes], q1[kLanes], q2[kLanes], sumQ[kLanes];

  void load(const TapLayer& L, size_t first);
  /// Adds, for i in from..to, pixels first+i..first+i+7 of the row that begins `shift` elements on, each to its lane, where |i| <= reach[lane] (a
  /// lane of smaller reach takes weight 0, so that a pixel's sum does not depend on its neighbours in the block). The centre is left out.
  void add(const TapLayer& L, size_t first, long shift, int from, int to, const int* reach, bool planar, bool fourthOrder);
  /// The centre's value plus the mean difference; of the fourth order the intercept of the least-squares fit of c0 + c1 q, whose weights have
  /// no second moment, wherever the taps determine one.
  float result(int lane, bool fourthOrder) const;
};

}  // namespace gobo::axis_aligned
