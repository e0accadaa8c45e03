// SPDX-License-Identifier: Apache-2.0
// Haar wavelets over the six faces of a cube of cells, orthonormal on the sphere: pairs of cells, along rows and then along columns, are turned by the angle
// that their solid angles give, level by level, so that a constant function is six terms however uneven the cells. A function is given as its mean in each cell
// times the root of the cell's solid angle; its terms are indexed as cells are, face, row, column, and the sum of their squares is the function's. Pure; any
// thread.
#pragma once

#include <cstdint>
#include <vector>

#include "base/vec.h"

namespace gobo::transfer::published {

class CubeWavelets {
 public:
  static constexpr int kMostSide = 64;
  /// Over 6 x side x side cells whose solid angles are given; one of 0 has no say. `side`: a power of two, 1 .. kMostSide (CHECKed).
  CubeWavelets(int side, std::vector<double> solidAngles);
  int side() const { return side_; }
  size_t size() const { return angles_.size(); }
  const std::vector<double>& solidAngles() const { return angles_; }  ///< sr, of cells
  /// Solid angle over which a term's wavelet is not 0, sr.
  const std::vector<double>& supports() const { return supports_; }

  /// Cells to terms, in place; each is the other's inverse and transpose.
  template <typename Value>
  void forward(std::vector<Value>& value) const {
    for (const Pair& p : pairs_) {
      const Value mean = p.c * value[p.a] + p.s * value[p.b];
      value[p.b] = p.s * value[p.a] - p.c * value[p.b];
      value[p.a] = mean;
    }
  }
  template <typename Value>
  void backward(std::vector<Value>& value) const {
    for (size_t k = pairs_.size(); k-- > 0;) {
      const Pair& p = pairs_[k];
      const Value mean = value[p.a], difference = value[p.b];
      value[p.a] = p.c * mean + p.s * difference;
      value[p.b] = p.s * mean - p.c * difference;
    }
  }

 private:
  struct Pair {
    uint32_t a, b;
    double c, s;
  };
  int side_;
  std::vector<double> angles_, supports_;
  std::vector<Pair> pairs_;
};

}  // namespace gobo::transfer::published
