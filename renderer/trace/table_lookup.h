// SPDX-License-Identifier: Apache-2.0
// Between the nodes of a table.
#pragma once

namespace gobo {
inline namespace trace {

/// a at f = 0; the form is part of the tables' values (a (1 - f) + b f rounds otherwise).
inline float mix(float a, float b, float f) { return a + (b - a) * f; }

}  // namespace trace
}  // namespace gobo
