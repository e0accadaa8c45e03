// SPDX-License-Identifier: Apache-2.0
// Whether the code under test carries a sanitizer, which makes it 5 to 20 times as slow.
#pragma once

namespace gobo::testing {

#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
inline constexpr bool kInstrumented = true;
#else
inline constexpr bool kInstrumented = false;
#endif

/// So many of what takes some tenths of a second: about as long in either build.
constexpr int asLong(int count) { return kInstrumented ? count / 8 : count; }

}  // namespace gobo::testing
