// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/compression/symmetric_eigen.h"

#define EIGEN_MPL2_ONLY
#include <Eigen/Eigenvalues>

#include "base/check.h"

namespace gobo::transfer {

SymmetricEigen symmetricEigen(std::vector<double> a, size_t n) {
  GOBO_CHECK(a.size() == n * n);
  if (n == 0) return {};
  const Eigen::Index size = Eigen::Index(n);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(Eigen::Map<const Eigen::MatrixXd>(a.data(), size, size));
  GOBO_CHECK(solver.info() == Eigen::Success);
  SymmetricEigen out;
  for (Eigen::Index k = size; k-- > 0;) {  // it has the smallest first
    out.values.push_back(solver.eigenvalues()[k]);
    for (Eigen::Index i = 0; i < size; ++i) out.vectors.push_back(solver.eigenvectors()(i, k));
  }
  return out;
}

}  // namespace gobo::transfer
