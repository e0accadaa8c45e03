// SPDX-License-Identifier: Apache-2.0
// A formula of a request: one number from named ones (docs/expressions.md). Parsed once, evaluated per element.
//
// Language     + - * / ^, comparisons, && ||, a ? b : c, parentheses; functions of the parser (sin ... atanh, exp, log, ln, log2, log10, sqrt, abs, sign, rint,
// min,
//              max, sum, avg) and clamp(x, low, high), mix(a, b, t), smoothstep(low, high, x); the constant pi; the names that it is parsed with;
//              object("NAME"), which is 1 on that object and 0 elsewhere, and caster("NAME"), which is 1 by edges of shadows that it casts. No assignment, no
//              list, one value.
// Numbers      double; a value that is not finite is the caller's to refuse.
// Cost         At most kMostFormula characters, no loops: about 10 ns an operation. Parser: muParser, seen by formula.cpp alone.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace filters {

inline constexpr size_t kMostFormula = 1000;

class Formula {
 public:
  /// Errors: InvalidArgument at `field`: what is wrong, at which character; unknown names with the known ones.
  static Result<Formula> parse(const std::string& text, std::span<const std::string_view> names, const std::string& field);

  const std::string& text() const { return text_; }
  /// Whether names[k] occurs.
  bool reads(size_t k) const { return reads_[k]; }
  struct Object {
    std::string name;
    bool caster = false;  ///< caster("NAME"): what it casts
    bool operator==(const Object&) const = default;
  };
  /// By their order in the text, each once.
  const std::vector<Object>& objects() const { return objects_; }

  /// One thread's: numbers go in by reference. Must not outlive the formula.
  class Evaluator {
   public:
    explicit Evaluator(const Formula& formula);
    ~Evaluator();
    Evaluator(Evaluator&&) noexcept;
    /// Of names[k], then of objects()[k].
    double& name(size_t k);
    double& object(size_t k);
    double operator()() const;

   private:
    friend class Formula;
    struct Impl;
    std::unique_ptr<Impl> impl_;
  };

 private:
  std::string text_, code_;  ///< as given; with a name in the place of each object
  std::vector<std::string> names_;
  std::vector<Object> objects_;
  std::vector<bool> reads_;
};

}  // namespace filters
}  // namespace gobo
