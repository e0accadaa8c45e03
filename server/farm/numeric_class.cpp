// SPDX-License-Identifier: Apache-2.0
#include "server/farm/numeric_class.h"

namespace gobo {
inline namespace server {

std::string numericClass() {
  __builtin_cpu_init();
  // Embree 4 takes AVX-512 where all five parts are there (its ISA "avx512").
  const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd") &&
                    __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
  return std::string("x86-64-v3 embree-") + (wide ? "avx512" : "avx2");
}

}  // namespace server
}  // namespace gobo
