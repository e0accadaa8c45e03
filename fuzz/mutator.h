// SPDX-License-Identifier: Apache-2.0
// Inputs out of inputs: what a fuzzer without a view of the program can do. Deterministic by its seed.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace gobo::fuzz {

class Mutator {
 public:
  /// `words` are put in as they are: names of fields, magic numbers. Inputs stay within `mostBytes`.
  Mutator(uint64_t seed, std::vector<std::string> words, size_t mostBytes) : random_(seed), words_(std::move(words)), most_(mostBytes) {}
  /// A few edits of `input`, sometimes a part of `other` in it.
  std::vector<uint8_t> mutate(std::vector<uint8_t> input, const std::vector<uint8_t>& other);
  size_t below(size_t n) { return n ? size_t(random_() % n) : 0; }

 private:
  void edit(std::vector<uint8_t>& input, const std::vector<uint8_t>& other);
  /// Another number where one is written in decimal digits.
  void editNumber(std::vector<uint8_t>& input);
  std::mt19937_64 random_;
  std::vector<std::string> words_;
  size_t most_;
};

}  // namespace gobo::fuzz
