// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace gobo {
inline namespace base {

/// Which numbers a path is made of: base/sobol.h, base/halton.h, base/independent.h.
enum class SamplerKind : uint8_t { Sobol, Halton, Independent };

}  // namespace base
}  // namespace gobo
