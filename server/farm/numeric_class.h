// SPDX-License-Identifier: Apache-2.0
// What of a machine decides bits of pictures: the instruction set that this program was compiled for, and the one that Embree's kernels
// take at run time (they add up in another order in wider vectors). Daemons of one build and one class make the same bits.
#pragma once

#include <string>

namespace gobo {
inline namespace server {

/// "x86-64-v3 embree-avx2".
std::string numericClass();

}  // namespace server
}  // namespace gobo
