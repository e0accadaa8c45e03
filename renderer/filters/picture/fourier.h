// SPDX-License-Identifier: Apache-2.0
// Discrete Fourier transforms of pictures of any size, in double precision, O(n log n) for primes too. The one place that sees Eigen's FFT (kissfft). The same
// bits for any number of threads.
#pragma once

#include <complex>
#include <vector>

#include "base/task_arena.h"

namespace gobo::fourier {

using Complex = std::complex<double>;

/// Least n' >= n without prime factors above 5.
size_t fastSize(size_t n);
bool isFast(size_t n);

/// In place, of height x width values, row by row: sums with exp(-2 pi i (u x / width + v y / height)); inverse: with the opposite sign, divided by
/// width * height. False: `stop` fired, and what is there is nothing.
bool transform(std::vector<Complex>& values, size_t width, size_t height, bool inverse, const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::fourier
