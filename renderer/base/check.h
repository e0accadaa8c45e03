// SPDX-License-Identifier: Apache-2.0
// CHECK macros for programmer errors: they print the values and abort. Never for input that comes from outside.
#pragma once

#include <cstdlib>
#include <iostream>

#define GOBO_CHECK(cond)                                                                 \
  do {                                                                                   \
    if (!(cond)) {                                                                       \
      std::cerr << __FILE__ << ":" << __LINE__ << ": CHECK failed: " #cond << std::endl; \
      std::abort();                                                                      \
    }                                                                                    \
  } while (0)

#define GOBO_CHECK_OP(op, a, b)                                                                                                                \
  do {                                                                                                                                         \
    const auto& goboA_ = (a);                                                                                                                  \
    const auto& goboB_ = (b);                                                                                                                  \
    if (!(goboA_ op goboB_)) {                                                                                                                 \
      std::cerr << __FILE__ << ":" << __LINE__ << ": CHECK failed: " #a " " #op " " #b " (" << goboA_ << " vs " << goboB_ << ")" << std::endl; \
      std::abort();                                                                                                                            \
    }                                                                                                                                          \
  } while (0)

#define GOBO_CHECK_EQ(a, b) GOBO_CHECK_OP(==, a, b)
#define GOBO_CHECK_LT(a, b) GOBO_CHECK_OP(<, a, b)
#define GOBO_CHECK_LE(a, b) GOBO_CHECK_OP(<=, a, b)
#define GOBO_CHECK_GT(a, b) GOBO_CHECK_OP(>, a, b)
