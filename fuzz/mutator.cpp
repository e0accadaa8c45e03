// SPDX-License-Identifier: Apache-2.0
#include "fuzz/mutator.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

namespace gobo::fuzz {
namespace {

constexpr const char* kNumbers[] = {"0",
                                    "-0.0",
                                    "-1",
                                    "1",
                                    "255",
                                    "256",
                                    "65535",
                                    "65536",
                                    "2147483647",
                                    "2147483648",
                                    "4294967295",
                                    "4294967296",
                                    "18446744073709551615",
                                    "-9223372036854775808",
                                    "1e-320",
                                    "1e-38",
                                    "1e9",
                                    "1e18",
                                    "3.5e38",
                                    "1e308",
                                    "1e309",
                                    "-1e39",
                                    "0.1",
                                    "NaN",
                                    "Infinity",
                                    "\"-Infinity\"",
                                    "[]",
                                    "null",
                                    "true"};
constexpr uint64_t kIntegers[] = {0,
                                  1,
                                  2,
                                  3,
                                  4,
                                  7,
                                  8,
                                  15,
                                  16,
                                  127,
                                  128,
                                  255,
                                  256,
                                  32767,
                                  32768,
                                  65535,
                                  65536,
                                  1u << 24,
                                  0x7fffffff,
                                  0x80000000,
                                  0xffffffff,
                                  0x100000000,
                                  0x7fffffffffffffff,
                                  0xffffffffffffffff};
constexpr float kFloats[] = {
    0.0f, -0.0f, 1.0f, -1.0f, 1e-38f, 1e-45f, 1e9f, 3e38f, -3e38f, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()};

bool partOfNumber(uint8_t c) { return (c >= '0' && c <= '9') || c == '.' || c == '-' || c == '+' || c == 'e' || c == 'E'; }

void replace(std::vector<uint8_t>& input, size_t at, size_t bytes, const void* with, size_t size) {
  const auto* const p = static_cast<const uint8_t*>(with);
  const std::vector<uint8_t> copy(p, p + size);
  input.erase(input.begin() + std::ptrdiff_t(at), input.begin() + std::ptrdiff_t(std::min(at + bytes, input.size())));
  input.insert(input.begin() + std::ptrdiff_t(at), copy.begin(), copy.end());
}

}  // namespace

void Mutator::editNumber(std::vector<uint8_t>& input) {
  const size_t from = below(input.size());
  const auto digit = std::find_if(input.begin() + std::ptrdiff_t(from), input.end(), [](uint8_t c) { return c >= '0' && c <= '9'; });
  if (digit == input.end()) return;
  auto begin = digit, end = digit;
  while (begin != input.begin() && partOfNumber(begin[-1])) --begin;
  while (end != input.end() && partOfNumber(*end)) ++end;
  const char* const number = kNumbers[below(std::size(kNumbers))];
  replace(input, size_t(begin - input.begin()), size_t(end - begin), number, std::strlen(number));
}

void Mutator::edit(std::vector<uint8_t>& input, const std::vector<uint8_t>& other) {
  const size_t at = below(input.size() + 1), length = 1 + below(below(8) ? 8 : 256);
  switch (below(10)) {
    case 0:
      if (at < input.size()) input[at] ^= uint8_t(1u << below(8));
      break;
    case 1:
      if (at < input.size()) input[at] = uint8_t(below(256));
      break;
    case 2: replace(input, std::min(at, input.size()), length, "", 0); break;
    case 3:
      if (at < input.size()) replace(input, at, 0, input.data() + at, std::min(length, input.size() - at));
      break;
    case 4: {
      const uint64_t v = kIntegers[below(std::size(kIntegers))];
      replace(input, at, 4, &v, below(2) ? 4 : 8);
      break;
    }
    case 5: {
      const float v = kFloats[below(std::size(kFloats))];
      replace(input, at, 4, &v, sizeof v);
      break;
    }
    case 6:
    case 7: editNumber(input); break;
    case 8:
      if (!words_.empty()) {
        const std::string& word = words_[below(words_.size())];
        replace(input, at, below(2) ? word.size() : 0, word.data(), word.size());
      }
      break;
    default:
      if (!other.empty()) {
        const size_t from = below(other.size());
        replace(input, at, below(2) ? length : 0, other.data() + from, std::min(length, other.size() - from));
      }
  }
}

std::vector<uint8_t> Mutator::mutate(std::vector<uint8_t> input, const std::vector<uint8_t>& other) {
  for (size_t edits = 1 + below(below(4) ? 3 : 12); edits > 0; --edits) edit(input, other);
  if (input.size() > most_) input.resize(most_);
  return input;
}

}  // namespace gobo::fuzz
