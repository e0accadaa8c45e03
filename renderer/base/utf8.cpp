// SPDX-License-Identifier: Apache-2.0
#include "base/utf8.h"

#include <cstdint>

namespace gobo {
inline namespace base {
namespace {

/// Bytes of the well-formed character at the start of `s`; 0 if there is none.
size_t character(std::string_view s) {
  const auto at = [&](size_t i) { return i < s.size() ? uint8_t(s[i]) : uint8_t(0); };
  const auto tail = [&](size_t i) { return (at(i) & 0xc0) == 0x80; };
  const uint8_t a = at(0), b = at(1);
  if (a < 0x80) return 1;
  if (a >= 0xc2 && a <= 0xdf) return tail(1) ? 2 : 0;
  if (a >= 0xe0 && a <= 0xef) return tail(1) && tail(2) && !(a == 0xe0 && b < 0xa0) && !(a == 0xed && b > 0x9f) ? 3 : 0;
  if (a >= 0xf0 && a <= 0xf4) return tail(1) && tail(2) && tail(3) && !(a == 0xf0 && b < 0x90) && !(a == 0xf4 && b > 0x8f) ? 4 : 0;
  return 0;
}

}  // namespace

bool isUtf8(std::string_view s) {
  while (!s.empty()) {
    const size_t n = character(s);
    if (n == 0) return false;
    s.remove_prefix(n);
  }
  return true;
}

std::string cleanUtf8(std::string text) {
  if (isUtf8(text)) return text;
  std::string out;
  for (std::string_view s = text; !s.empty();) {
    const size_t n = character(s);
    if (n > 0) out.append(s.substr(0, n));
    else {
      out += "\\x";
      for (const int shift : {4, 0}) out += "0123456789abcdef"[(uint8_t(s[0]) >> shift) & 15];
    }
    s.remove_prefix(n > 0 ? n : 1);
  }
  return out;
}

Status cleanUtf8(const Status& s) { return s.ok() ? s : Status(s.code(), cleanUtf8(s.message()), cleanUtf8(s.location())); }

}  // namespace base
}  // namespace gobo
