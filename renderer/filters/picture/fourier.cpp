// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/fourier.h"

#define EIGEN_MPL2_ONLY
#include <unsupported/Eigen/FFT>

#include <numbers>

namespace gobo::fourier {

namespace {

constexpr size_t kColumns = 8;   // gathered together: a column alone would fetch a cache line for each value
constexpr size_t kGeneric = 32;  // prime factors from here on take kissfft longer than a convolution

size_t largestPrime(size_t n) {
  size_t most = 1;
  for (size_t p = 2; p * p <= n; ++p)
    for (; n % p == 0; n /= p) most = p;
  return std::max(most, n);
}

/// Transforms of one length; by one thread.
class Line {
 public:
  explicit Line(size_t n) : n_(n), m_(largestPrime(n) < kGeneric ? 0 : fastSize(2 * n - 1)) {
    fft_.SetFlag(Eigen::FFT<double>::Unscaled);
    if (m_ == 0) return;
    // Bluestein 1970: a transform of any length is a convolution with a chirp, by transforms of a length that is fast.
    for (size_t k = 0; k < n; ++k) chirp_.push_back(std::polar(1.0, -std::numbers::pi * double(k * k % (2 * n)) / double(n)));
    std::vector<Complex> around(m_);
    around[0] = std::conj(chirp_[0]);
    for (size_t k = 1; k < n; ++k) around[k] = around[m_ - k] = std::conj(chirp_[k]);
    chirps_.resize(m_);
    fft_.fwd(chirps_.data(), around.data(), Eigen::Index(m_));
    padded_.resize(m_);
  }
  void forward(Complex* values) {
    if (n_ < 2) return;  // kissfft has no plan for one value
    scratch_.resize(std::max(n_, m_));
    if (m_ == 0) {
      fft_.fwd(scratch_.data(), values, Eigen::Index(n_));
      std::copy_n(scratch_.begin(), n_, values);
      return;
    }
    std::fill(padded_.begin(), padded_.end(), Complex(0.0));
    for (size_t k = 0; k < n_; ++k) padded_[k] = values[k] * chirp_[k];
    fft_.fwd(scratch_.data(), padded_.data(), Eigen::Index(m_));
    for (size_t k = 0; k < m_; ++k) padded_[k] = scratch_[k] * chirps_[k];
    fft_.inv(scratch_.data(), padded_.data(), Eigen::Index(m_));
    for (size_t k = 0; k < n_; ++k) values[k] = scratch_[k] * chirp_[k] / double(m_);
  }

 private:
  size_t n_, m_;  ///< m_: length of the convolution; 0: there is none
  Eigen::FFT<double> fft_;
  std::vector<Complex> chirp_, chirps_, padded_, scratch_;
};

}  // namespace

bool isFast(size_t n) {
  for (const size_t p : {2, 3, 5})
    while (n % p == 0) n /= p;
  return n == 1;
}
size_t fastSize(size_t n) {
  n = std::max<size_t>(n, 1);
  while (!isFast(n)) ++n;
  return n;
}

bool transform(std::vector<Complex>& values, size_t width, size_t height, bool inverse, const TaskArena& arena, const StopToken& stop) {
  // The inverse is the conjugate of the transform of the conjugate.
  const double scale = 1.0 / (double(width) * double(height));
  const bool rows = arena.parallelFor(
      height, 16,
      [&](size_t b, size_t e) {
        Line line(width);
        for (size_t y = b; y < e && !stop.stopRequested(); ++y) {
          Complex* row = values.data() + y * width;
          if (inverse)
            for (size_t x = 0; x < width; ++x) row[x] = std::conj(row[x]);
          line.forward(row);
        }
      },
      stop);
  if (!rows || stop.stopRequested()) return false;
  const bool columns = arena.parallelFor((width + kColumns - 1) / kColumns, 4,
                                         [&](size_t b, size_t e) {
                                           Line line(height);
                                           std::vector<Complex> gathered(kColumns * height);
                                           for (size_t block = b; block < e && !stop.stopRequested(); ++block) {
                                             const size_t from = block * kColumns, n = std::min(kColumns, width - from);
                                             for (size_t y = 0; y < height; ++y)
                                               for (size_t k = 0; k < n; ++k) gathered[k * height + y] = values[y * width + from + k];
                                             for (size_t k = 0; k < n; ++k) line.forward(gathered.data() + k * height);
                                             for (size_t y = 0; y < height; ++y)
                                               for (size_t k = 0; k < n; ++k) {
                                                 const Complex v = gathered[k * height + y];
                                                 values[y * width + from + k] = inverse ? std::conj(v) * scale : v;
                                               }
                                           }
                                         },
                                         stop);
  return columns && !stop.stopRequested();
}

}  // namespace gobo::fourier
