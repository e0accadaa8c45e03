// SPDX-License-Identifier: Apache-2.0
// Expression: the composite's small typed language over terms. Every value is an RGB triple per pixel (a one-channel plane
// is read as grey). Evaluated over runs of pixels that stay in the L1 cache, so an expression costs one pass over the
// planes it reads. Immutable once built.
#pragma once

#include <string>
#include <vector>

#include "base/hash.h"
#include "base/status.h"
#include "base/vec.h"
#include "terms/term_shape.h"

namespace gobo {
inline namespace filters {

class Expression {
 public:
  enum class Op : uint8_t {
    Constant,  ///< value
    Plane,     ///< inputs[input].plane(name)
    Add,
    Multiply,
    Ratio,        ///< a op b; Ratio is a / max(b, 1e-8) where b > 0, else a
    MultiplyAdd,  ///< a + value * b (b usually a plane)
    Lerp,         ///< a + (b - a) * c
    Over,         ///< a over b with coverage c: a * c + b * (1 - c)
    Clamp,        ///< min(max(a, value.x), value.y)
  };
  struct Instruction {
    Op op;
    int a = -1, b = -1, c = -1;
    int input = -1;
    std::string plane;
    Vec3 value{0.0f};
  };

  int constant(const Vec3& v) { return push({Op::Constant, -1, -1, -1, -1, {}, v}); }
  int plane(int input, std::string name) { return push({Op::Plane, -1, -1, -1, input, std::move(name), Vec3(0.0f)}); }
  int add(int a, int b) { return push({Op::Add, a, b}); }
  int multiply(int a, int b) { return push({Op::Multiply, a, b}); }
  int ratio(int a, int b) { return push({Op::Ratio, a, b}); }
  int multiplyAdd(int a, const Vec3& gain, int b) { return push({Op::MultiplyAdd, a, b, -1, -1, {}, gain}); }
  int lerp(int a, int b, int c) { return push({Op::Lerp, a, b, c}); }
  int over(int a, int b, int c) { return push({Op::Over, a, b, c}); }
  int clamp(int a, float lo, float hi) { return push({Op::Clamp, a, -1, -1, -1, {}, Vec3(lo, hi, 0)}); }

  const std::vector<Instruction>& code() const { return code_; }
  void hash(Hasher& hasher) const;
  /// Checks operand indices, inputs, plane names, channel counts (1 or 3) and equal extents. Errors name the instruction.
  Status check(std::span<const TermShape> inputs) const;
  /// Value of the last instruction for pixels [begin, end) into out (3 floats a pixel). check() must have passed.
  void evaluate(const std::vector<TermPtr>& inputs, size_t begin, size_t end, float* out) const;

 private:
  int push(Instruction i) {
    code_.push_back(std::move(i));
    return int(code_.size()) - 1;
  }
  std::vector<Instruction> code_;
};

}  // namespace filters
}  // namespace gobo
