// SPDX-License-Identifier: Apache-2.0
// Where between the vertices of an icosphere a maximum lies: the top of a quadric through a vertex and its five or six neighbours in the tangent plane
// (digest of seed 004, B10). A map that was smoothed by a Gaussian has Gaussians for its point-like sources, and their logarithm is a quadric: through
// logarithms the top is found some hundred times closer. Pure; any thread.
#pragma once

#include <vector>

#include "base/vec.h"
#include "techniques/transfer/icosphere.h"

namespace gobo::transfer::published {

enum class Refine { None, Quadric, LogQuadric };

struct Summit {
  DVec3 direction{0, 1, 0};  ///< unit; the vertex itself where the quadric has no top within an edge's length of it
  double steepness = 0;      ///< geometric mean curvature of the value's logarithm there, 1 / rad^2: 1 / s^2 of a Gaussian of deviation s; 0: no top
};
/// `value` by vertex. LogQuadric: the plain one where a value is not above 0. None: the vertex, without steepness.
Summit summitOf(const std::vector<double>& value, const Icosphere& sphere, int vertex, Refine refine);

}  // namespace gobo::transfer::published
