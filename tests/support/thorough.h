// SPDX-License-Identifier: Apache-2.0
// How much of a sweep `make test` runs. A sweep of many cases, or of many samples a case, has two sizes: all of it in `make sweeps` (GOBO_THOROUGH set, also
// in `make bench`), and a share of it, drawn once and for all, where users wait. Both must hold every kind of case; only how many of a kind differs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>

namespace gobo::testing {

inline bool thorough() {
  static const bool set = std::getenv("GOBO_THOROUGH") != nullptr;
  return set;
}
/// A number of cases, samples or pixels.
template <class T>
T thoroughOr(T all, T few) {
  return thorough() ? all : few;
}
/// Whether case k of a sweep is run: all of them, or about one in `every`, at no fixed distance (nested loops have periods).
inline bool inSweep(size_t k, size_t every) {
  uint64_t h = (k + 1) * 0x9e3779b97f4a7c15ull;
  h = (h ^ h >> 30) * 0xbf58476d1ce4e5b9ull;
  h = (h ^ h >> 27) * 0x94d049bb133111ebull;
  return thorough() || (h ^ h >> 31) % every == 0;
}

}  // namespace gobo::testing
