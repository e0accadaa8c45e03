// SPDX-License-Identifier: Apache-2.0
// Least squares of a few hundred unknowns at most, from the Gram matrix of what is fitted (n x n, row-major, symmetric) and its moments with the target:
// x^T G x - 2 b^T x is least. In double, in one order. Pure; any thread.
#pragma once

#include <cstddef>
#include <vector>

namespace gobo::transfer::published {

/// G x = b by Cholesky; columns that are a combination of those before them (within 1e-12) get 0. O(n^3 / 6).
std::vector<double> solveSymmetric(const std::vector<double>& gram, const std::vector<double>& moment);

/// The least with x_i >= 0 for i >= `free` (the first `free` may have any sign): Lawson & Hanson 1974, chapter 23, on the Gram matrix. At the end moments
/// of what is left with unknowns at 0 are at most 1e-10 of theirs with the target.
std::vector<double> solveNonNegative(const std::vector<double>& gram, const std::vector<double>& moment, size_t free);

}  // namespace gobo::transfer::published
