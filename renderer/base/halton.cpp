// SPDX-License-Identifier: Apache-2.0
#include "base/halton.h"

#include <algorithm>
#include <array>

#include "base/independent.h"

namespace gobo {
inline namespace base {

namespace {

constexpr std::array<uint16_t, 2 * kHaltonPairs> makePrimes() {
  std::array<uint16_t, 2 * kHaltonPairs> primes{};
  size_t found = 0;
  for (uint32_t n = 2; found < primes.size(); ++n) {
    bool prime = true;
    for (size_t k = 0; k < found && uint32_t(primes[k]) * primes[k] <= n && prime; ++k) prime = n % primes[k] != 0;
    if (prime) primes[found++] = uint16_t(n);
  }
  return primes;
}
constexpr std::array<uint16_t, 2 * kHaltonPairs> kPrimes = makePrimes();
static_assert(kPrimes.back() < 4096);  // products fit into 32 bits, and no base - 1 has 3, 5, 7, 11 and 13

constexpr uint64_t kPermutation = 0x7065726d75746174ull;  // keeps a node's permutation apart from what its children hash

uint32_t below(uint32_t random, uint32_t n) { return uint32_t(uint64_t(random) * n >> 32); }

/// The smallest odd prime that does not divide base - 1: its powers permute the numbers modulo base.
uint32_t permutingPower(uint32_t base) {
  for (const uint32_t n : {3u, 5u, 7u, 11u})
    if ((base - 1) % n != 0) return n;
  return 13;
}
uint32_t power(uint32_t x, uint32_t n, uint32_t base) {
  uint32_t result = x;
  for (; n > 1; --n) result = result * x % base;
  return result;
}

}  // namespace

uint32_t haltonPrime(uint32_t pair, int second) { return kPrimes[2 * pair + uint32_t(second)]; }

uint32_t radicalInverse(uint32_t index, uint32_t base) {
  uint64_t value = 0, scale = 1;
  for (; index > 0; index /= base, scale *= base) value = value * base + index % base;
  return uint32_t((static_cast<unsigned __int128>(value) << 32) / scale);
}

uint32_t scrambledRadicalInverse(uint32_t index, uint32_t base, uint64_t scramble) {
  if (base == 2) return owenScramble(reverseBits(index), uint32_t(scramble >> 32));
  // `offset`, in units of 2^-64, is where the way of zeros ends below the node: its digits in base b are where zeros go to, so that the zeros above
  // the index's last digit need no loop. Every other digit leads to a node with an offset of its own.
  const uint32_t n = permutingPower(base);
  uint64_t value = 0, scale = 1, offset = mix64(scramble);
  for (; index > 0; index /= base, scale *= base) {
    const uint32_t digit = index % base;
    const auto wide = static_cast<unsigned __int128>(offset) * base;
    const uint32_t zero = uint32_t(wide >> 64);
    if (digit == 0) {
      value = value * base + zero;
      offset = uint64_t(wide);
      continue;
    }
    const uint32_t factor = 1 + below(uint32_t(mix64(offset ^ kPermutation) >> 32), base - 1);
    value = value * base + (factor * power(digit, n, base) + zero) % base;
    offset = hash64(offset, digit);
  }
  const double x = (double(value) + double(offset >> 12) * 0x1p-52) / double(scale);
  return uint32_t(std::min(x * 0x1p32, 4294967295.0));  // rounding may reach 1
}

Vec2 haltonPoint(uint64_t seed, uint32_t index, uint32_t pair) {
  if (pair >= kHaltonPairs) return independentPoint(seed, index, pair);
  const uint64_t h = hash64(seed, pair);
  return Vec2(toUnit(scrambledRadicalInverse(index, haltonPrime(pair, 0), h)),
              toUnit(scrambledRadicalInverse(index, haltonPrime(pair, 1), mix64(h ^ 0x9e3779b97f4a7c15ull))));
}

float haltonValue(uint64_t seed, uint32_t index, uint32_t pair) {
  if (pair >= kHaltonPairs) return independentPoint(seed, index, pair).x;
  return toUnit(scrambledRadicalInverse(index, haltonPrime(pair, 0), hash64(seed, pair)));
}

}  // namespace base
}  // namespace gobo
