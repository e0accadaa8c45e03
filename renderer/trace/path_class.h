// SPDX-License-Identifier: Apache-2.0
// Path classes: which light paths a radiance term holds. The composite refuses overlap and lists what is missing.
//   Emission   light seen by the camera with no scattering event (includes background)
//   Direct     exactly one scattering event, at the first hit, by a non-delta lobe, then a light
//   Indirect   everything else that ends on a light: two or more events, or a delta event at the first hit
#pragma once

#include <cstdint>

namespace gobo {
inline namespace trace {

enum class PathClass : uint8_t { None = 0, Emission = 1, Direct = 2, Indirect = 4, All = 7 };
constexpr PathClass operator|(PathClass a, PathClass b) { return PathClass(uint8_t(a) | uint8_t(b)); }
constexpr PathClass operator&(PathClass a, PathClass b) { return PathClass(uint8_t(a) & uint8_t(b)); }
constexpr bool has(PathClass set, PathClass c) { return (uint8_t(set) & uint8_t(c)) == uint8_t(c); }

}  // namespace trace
}  // namespace gobo
