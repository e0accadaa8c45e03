// SPDX-License-Identifier: Apache-2.0
// All eigenvectors of a real symmetric matrix of a few hundred rows: Householder's tridiagonal form and implicit QR (Golub & Van Loan, Matrix Computations,
// 8.3), by Eigen, whose headers only the .cpp sees. In double, in one order. Pure; any thread. O(n^3).
#pragma once

#include <cstddef>
#include <vector>

namespace gobo::transfer {

struct SymmetricEigen {
  std::vector<double> values;   ///< n, largest first
  std::vector<double> vectors;  ///< n x n: row k belongs to value k; orthonormal
};

/// `matrix`: n x n, symmetric, finite.
SymmetricEigen symmetricEigen(std::vector<double> matrix, size_t n);

}  // namespace gobo::transfer
