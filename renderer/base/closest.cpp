// SPDX-License-Identifier: Apache-2.0
#include "base/closest.h"

#include <algorithm>
#include <cctype>

namespace gobo {
inline namespace base {

size_t editDistance(std::string_view a, std::string_view b) {
  const auto at = [](std::string_view s, size_t i) { return std::tolower(static_cast<unsigned char>(s[i])); };
  std::vector<std::vector<size_t>> d(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (size_t i = 1; i <= a.size(); ++i)
    for (size_t j = 1; j <= b.size(); ++j) {
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (at(a, i - 1) != at(b, j - 1))});
      if (i > 1 && j > 1 && at(a, i - 1) == at(b, j - 2) && at(a, i - 2) == at(b, j - 1)) d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  return d[a.size()][b.size()];
}

std::string closest(std::string_view name, const std::vector<std::string>& known) {
  constexpr size_t kLongest = 64;
  if (name.empty() || name.size() > kLongest) return {};
  std::string best;
  size_t least = SIZE_MAX;
  for (const std::string& k : known) {
    if (k.size() > kLongest) continue;
    const size_t d = editDistance(name, k);
    if (d < least && 3 * d <= std::max(k.size(), size_t(3))) {
      least = d;
      best = k;
    }
  }
  return best;
}

std::string didYouMean(std::string_view name, const std::vector<std::string>& known) {
  const std::string best = closest(name, known);
  return best.empty() ? "" : "; did you mean '" + best + "'?";
}

std::string someOf(const std::vector<std::string>& names) {
  constexpr size_t kMost = 300;
  std::string out;
  for (const std::string& name : names) {
    if (out.size() > kMost) return out + ", ...";
    size_t end = std::min(name.size(), kMost);
    while (end < name.size() && end > 0 && (static_cast<unsigned char>(name[end]) & 0xc0) == 0x80) --end;  // characters stay whole
    out += (out.empty() ? "" : ", ") + name.substr(0, end) + (end < name.size() ? "..." : "");
  }
  return out.empty() ? "none" : out;
}

}  // namespace base
}  // namespace gobo
