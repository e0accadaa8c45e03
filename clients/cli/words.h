// SPDX-License-Identifier: Apache-2.0
// Small words of the job commands: lists with commas, moments, enum names.
#pragma once

#include <algorithm>
#include <cctype>
#include <ctime>
#include <string>
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

/// Local time; "-" for 0.
inline std::string timeText(double unix) {
  if (unix <= 0) return "-";
  const std::time_t seconds = std::time_t(unix);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S", std::localtime(&seconds));
  return text;
}

}  // namespace gobo::cli
