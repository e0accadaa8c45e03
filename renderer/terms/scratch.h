// SPDX-License-Identifier: Apache-2.0
// Scratch: what a node holds while it runs, from the pool that terms' planes come from. Fresh from the system, memory costs a fault each 4 KiB, which for
// a filter of some nanoseconds a sample is most of its time.
#pragma once

#include <span>

#include "terms/term.h"

namespace gobo {
inline namespace terms {

/// `count` values, whatever was in memory before. Throws std::bad_alloc, which the executor turns into ResourceExhausted.
template <typename T>
class Scratch {
 public:
  Scratch() = default;
  Scratch(Scratch&&) = default;
  Scratch& operator=(Scratch&&) = default;
  explicit Scratch(size_t count) : bytes_(count * sizeof(T), /*zeroed=*/false), count_(count) {}
  T* get() const { return reinterpret_cast<T*>(const_cast<uint8_t*>(bytes_.data())); }
  T& operator[](size_t k) const { return get()[k]; }
  size_t size() const { return count_; }
  std::span<T> values() const { return {get(), count_}; }

 private:
  ZeroedBytes bytes_;
  size_t count_ = 0;
};

}  // namespace terms
}  // namespace gobo
