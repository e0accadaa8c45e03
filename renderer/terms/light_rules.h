// SPDX-License-Identifier: Apache-2.0
// Points whose weighted sum stands for the mean over a light's face: products of Gauss's rules, and Stroud's seven points of a disk (1971, S2 5-1). Which of
// them is close enough where: light_list.h. Made once, when first asked for; immutable.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gobo {
inline namespace terms {

enum class RuleShape : uint8_t {
  Disk,     ///< of radius 1
  Square,   ///< -1..1 along both axes
  Triangle  ///< x, y >= 0, x + y <= 1
};
/// Of squares and triangles Seven and Many are one rule, of 16 points.
enum class RuleSize : uint8_t { One, Seven, Many, Points64, Points256, Points1024, None };

/// To the next multiple of 8 with points without weight.
struct LightRule {
  std::vector<float> x, y, r2, weight;  ///< r2: squared radius; weights sum to 1
  size_t count() const { return x.size(); }
};
/// Every size but None.
const LightRule& lightRule(RuleShape shape, RuleSize size);

}  // namespace terms
}  // namespace gobo
