// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/irradiance_matrix.h"

#include <numbers>

#include "base/check.h"

namespace gobo::prefilter {

DVec3 IrradianceMatrix::at(const DVec3& normal) const {
  const glm::dvec4 n(normal, 1.0);
  return {glm::dot(n, channel[0] * n), glm::dot(n, channel[1] * n), glm::dot(n, channel[2] * n)};
}

IrradianceMatrix irradianceMatrix(std::span<const double> coefficients) {
  GOBO_CHECK(coefficients.size() >= 27);
  // What the paper prints as 0.429043, 0.511664, 0.743125, 0.886227 and 0.247708: a basis function's constant times its band's part of the cosine.
  const double pi = std::numbers::pi;
  const double c1 = std::sqrt(15.0 / pi) / 4.0 * pi / 4.0, c2 = std::sqrt(3.0 / pi) / 2.0 * pi / 3.0, c4 = pi * std::sqrt(1.0 / pi) / 2.0,
               c5 = std::sqrt(5.0 / pi) / 4.0 * pi / 4.0, c3 = 3.0 * c5;
  IrradianceMatrix out;
  for (int k = 0; k < 3; ++k) {
    const auto l = [&](int band, int order) { return coefficients[size_t(3 * (band * (band + 1) + order) + k)]; };
    // The paper's axes in ours: its polar axis is z, ours y.
    const int x = 0, y = 2, z = 1, one = 3;
    DMat4& m = out.channel[size_t(k)];
    const auto put = [&](int a, int b, double value) { m[a][b] = m[b][a] = value; };
    put(x, x, c1 * l(2, 2));
    put(y, y, -c1 * l(2, 2));
    put(z, z, c3 * l(2, 0));
    put(one, one, c4 * l(0, 0) - c5 * l(2, 0));
    put(x, y, c1 * l(2, -2));
    put(x, z, c1 * l(2, 1));
    put(y, z, c1 * l(2, -1));
    put(x, one, c2 * l(1, 1));
    put(y, one, c2 * l(1, -1));
    put(z, one, c2 * l(1, 0));
  }
  return out;
}

}  // namespace gobo::prefilter
