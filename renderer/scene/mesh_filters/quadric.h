// SPDX-License-Identifier: Apache-2.0
// Error quadrics: sums of squared distances from planes, and where they are least (Garland, Heckbert 1997; Lindstrom 2000). Symmetric 3 x 3 matrices.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace scene {

/// m = sum over k of value[k] * vector[k] vector[k]^T, vectors orthonormal. Cyclic Jacobi, to rounding. `m` must be symmetric and finite.
struct SymmetricEigen {
  DVec3 value;
  glm::dmat3 vector;  ///< column k
};
SymmetricEigen symmetricEigen(glm::dmat3 m);

struct Quadric {
  glm::dmat3 a{0.0};
  DVec3 b{0.0};
  /// Adds (n . (x - p))^2: the plane through p with normal n, weighted by |n|^2.
  void add(const DVec3& n, const DVec3& p) {
    a += glm::outerProduct(n, n);
    b += n * glm::dot(n, p);
  }
  double error(const DVec3& x) const { return glm::dot(x, a * x) - 2.0 * glm::dot(b, x); }  ///< but for a constant
};

/// Where the quadric is least, next to `near` in directions that it says nothing of: those whose eigenvalue is below kFlat of the largest, Lindstrom's
/// threshold for what noise of a flat piece would decide.
inline constexpr double kFlat = 1e-3;
DVec3 leastNear(const Quadric& q, const DVec3& near);

/// The same within the box centre +- half, of which `near` is a part: if the least place lies outside, the last place inside on the way there, which is
/// still better than `near` since the quadric is convex.
DVec3 leastInBox(const Quadric& q, const DVec3& near, const DVec3& centre, double half);

}  // namespace scene
}  // namespace gobo
