// SPDX-License-Identifier: Apache-2.0
// 128-bit content digests (xxh3-128): keys of terms, facets and requests made inside. SHA-256 names bytes that clients send.
// Hasher is a value; not thread-safe. Digests do not depend on the machine (little endian only).
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/array.h"

namespace gobo {
inline namespace base {

struct Hash128 {
  uint64_t lo = 0, hi = 0;
  auto operator<=>(const Hash128&) const = default;
  bool isZero() const { return lo == 0 && hi == 0; }
  std::string hex() const;                        ///< 32 lower-case digits, high word first
  static Hash128 fromHex(std::string_view text);  ///< zero when `text` is not 32 hex digits
};

/// Order-sensitive digest of typed pieces. Strings and arrays carry their length, so ("ab","c") differs from ("a","bc").
class Hasher {
 public:
  explicit Hasher(std::string_view domain = {}) {
    if (!domain.empty()) add(domain);
  }
  template <typename T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) Hasher& add(T v) {
    if constexpr (std::is_floating_point_v<T>) {
      if (v == T(0)) v = T(0);
    }  // -0 and +0 are one parameter
    return raw(&v, sizeof v);
  }
  Hasher& add(std::string_view text) {
    add(uint64_t(text.size()));
    return raw(text.data(), text.size());
  }
  Hasher& add(const char* text) { return add(std::string_view(text)); }
  Hasher& add(const Hash128& h) {
    add(h.lo);
    return add(h.hi);
  }
  template <typename T>
  requires(std::is_trivially_copyable_v<T>) Hasher& addArray(std::span<const T> values) {
    add(uint64_t(values.size()));
    return raw(values.data(), values.size_bytes());
  }
  template <typename T>
  Hasher& addArray(const std::vector<T>& values) {
    return addArray(std::span<const T>(values));
  }
  template <typename T>
  Hasher& addArray(const Array<T>& values) {
    return addArray(std::span<const T>(values));
  }
  /// A GLM vector or matrix, or any struct without padding.
  template <typename T>
  requires(std::is_trivially_copyable_v<T> && !std::is_arithmetic_v<T> && !std::is_enum_v<T>) Hasher& addPod(const T& v) { return raw(&v, sizeof v); }
  Hasher& raw(const void* data, size_t bytes);
  Hash128 digest() const;

 private:
  std::vector<uint8_t> small_;  // pieces waiting to be folded; big ones are folded at once
  Hash128 state_{};
  bool folded_ = false;
  void fold(const void* data, size_t bytes);
};

Hash128 hashBytes(const void* data, size_t bytes);

}  // namespace base
}  // namespace gobo

template <>
struct std::hash<gobo::Hash128> {
  size_t operator()(const gobo::Hash128& h) const noexcept { return size_t(h.lo ^ (h.hi * 0x9e3779b97f4a7c15ull)); }
};
