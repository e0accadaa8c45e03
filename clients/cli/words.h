// SPDX-License-Identifier: Apache-2.0
// Small words of the commands: lists with commas, sizes of pictures, moments, enum names.
#pragma once

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <ctime>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gobo::cli {

/// "a,b" as {"a", "b"}; empty parts stay, but for an empty text.
inline std::vector<std::string> commaList(const std::string& text) {
  std::vector<std::string> words;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = std::min(text.find(',', begin), text.size());
    words.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return words;
}

inline std::string lower(std::string text) {
  for (char& c : text) c = char(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// WIDTHxHEIGHT; none of anything else, a sign or what 32 bits do not hold among it.
inline std::optional<std::pair<uint32_t, uint32_t>> pictureSize(std::string_view text) {
  uint32_t width = 0, height = 0;
  const char* const end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, width);
  if (first.ec != std::errc() || first.ptr == end || *first.ptr != 'x') return std::nullopt;
  const auto second = std::from_chars(first.ptr + 1, end, height);
  if (second.ec != std::errc() || second.ptr != end) return std::nullopt;
  return std::pair{width, height};
}

/// Local time; "-" for 0.
inline std::string timeText(double unix) {
  if (unix <= 0) return "-";
  const std::time_t seconds = std::time_t(unix);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S", std::localtime(&seconds));
  return text;
}

}  // namespace gobo::cli
