// SPDX-License-Identifier: Apache-2.0
// "Did you mean": the known name that a mistyped one is nearest to.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace gobo {
inline namespace base {

/// Letters put in, left out, replaced or swapped with their neighbour (optimal string alignment), capitals aside. O(a b).
size_t editDistance(std::string_view a, std::string_view b);

/// The nearest of `known`, the first of equals; empty if none is within a third of its letters, or `name` has more than 64.
std::string closest(std::string_view name, const std::vector<std::string>& known);
/// "; did you mean 'X'?", or nothing.
std::string didYouMean(std::string_view name, const std::vector<std::string>& known);

/// "a, b, c": the names that there are, for an error; of many the first 300 characters or so, and ", ...". "none" of none.
std::string someOf(const std::vector<std::string>& names);

}  // namespace base
}  // namespace gobo
