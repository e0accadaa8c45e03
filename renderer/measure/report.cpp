// SPDX-License-Identifier: Apache-2.0
#include "measure/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "base/check.h"
#include "base/image_io.h"

namespace gobo {
inline namespace measure {
namespace {

std::string number(double v, const char* format, const char* notFinite) {
  if (!std::isfinite(v)) return notFinite;
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, v);
  return buffer;
}

std::string shown(const Table::Cell& cell) {
  if (const auto* s = std::get_if<std::string>(&cell)) return *s;
  return number(std::get<double>(cell), "%.4g", "-");
}

std::string csvField(const std::string& s) {
  if (s.find_first_of(",\"\r\n") == std::string::npos) return s;
  std::string out = "\"";
  for (char c : s) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string jsonString(const std::string& s) {
  std::string out = "\"";
  for (char c : s) {
    if (c == '"' || c == '\\') out += '\\', out += c;
    else if (c == '\n') out += "\\n";
    else if (static_cast<unsigned char>(c) < 0x20) {
      char buffer[8];
      std::snprintf(buffer, sizeof buffer, "\\u%04x", c);
      out += buffer;
    } else out += c;
  }
  return out + "\"";
}

std::string jsonCell(const Table::Cell& cell) {
  if (const auto* s = std::get_if<std::string>(&cell)) return jsonString(*s);
  return number(std::get<double>(cell), "%.17g", "null");
}

}  // namespace

void Table::add(std::vector<Cell> row) {
  GOBO_CHECK_EQ(row.size(), columns_.size());
  rows_.push_back(std::move(row));
}

std::string Table::text() const {
  std::vector<size_t> widths;
  for (size_t c = 0; c < columns_.size(); ++c) {
    widths.push_back(columns_[c].size());
    for (const auto& row : rows_) widths[c] = std::max(widths[c], shown(row[c]).size());
  }
  std::string out = name_ + "\n";
  for (const auto& [key, value] : notes_) out += "  " + key + ": " + shown(value) + "\n";
  const auto line = [&](auto&& cellAt) {
    std::string s;
    for (size_t c = 0; c < columns_.size(); ++c) {
      const auto [value, right] = cellAt(c);
      const std::string pad(widths[c] - value.size(), ' ');
      s += (c ? "  " : "") + (right ? pad + value : value + pad);
    }
    s.erase(s.find_last_not_of(' ') + 1);
    out += s + "\n";
  };
  const auto numeric = [&](size_t c) { return !rows_.empty() && std::holds_alternative<double>(rows_[0][c]); };
  line([&](size_t c) { return std::pair(columns_[c], numeric(c)); });
  for (const auto& row : rows_) line([&](size_t c) { return std::pair(shown(row[c]), std::holds_alternative<double>(row[c])); });
  return out;
}

std::string Table::markdown() const {
  std::string out = "|", rule = "|";
  for (size_t c = 0; c < columns_.size(); ++c) {
    out += " " + columns_[c] + " |";
    rule += !rows_.empty() && std::holds_alternative<double>(rows_[0][c]) ? "---:|" : "---|";
  }
  out += "\n" + rule + "\n";
  for (const auto& row : rows_) {
    out += "|";
    for (const Cell& cell : row) out += " " + shown(cell) + " |";
    out += "\n";
  }
  return out;
}

std::string Table::csv() const {
  std::string out;
  for (size_t c = 0; c < columns_.size(); ++c) out += (c ? "," : "") + csvField(columns_[c]);
  out += "\r\n";
  for (const auto& row : rows_) {
    for (size_t c = 0; c < row.size(); ++c) {
      const auto* s = std::get_if<std::string>(&row[c]);
      out += (c ? "," : "") + (s ? csvField(*s) : number(std::get<double>(row[c]), "%.17g", ""));
    }
    out += "\r\n";
  }
  return out;
}

std::string Table::json() const {
  std::string out = "{\"name\": " + jsonString(name_) + ",\n \"notes\": {";
  for (size_t i = 0; i < notes_.size(); ++i) out += (i ? ", " : "") + jsonString(notes_[i].first) + ": " + jsonCell(notes_[i].second);
  out += "},\n \"columns\": [";
  for (size_t c = 0; c < columns_.size(); ++c) out += (c ? ", " : "") + jsonString(columns_[c]);
  out += "],\n \"rows\": [";
  for (size_t r = 0; r < rows_.size(); ++r) {
    out += r ? ",\n  {" : "\n  {";
    for (size_t c = 0; c < columns_.size(); ++c) out += (c ? ", " : "") + jsonString(columns_[c]) + ": " + jsonCell(rows_[r][c]);
    out += "}";
  }
  return out + "\n ]}\n";
}

Status Table::write(const std::string& path) const {
  const std::string body = path.ends_with(".csv") ? csv() : path.ends_with(".json") ? json() : path.ends_with(".md") ? markdown() : text();
  return writeFileAtomic(path, body.data(), body.size());
}

std::string argumentOr(int argc, char** argv, const std::string& flag, const std::string& fallback) {
  for (int i = 1; i + 1 < argc; ++i)
    if (argv[i] == flag) return argv[i + 1];
  return fallback;
}

std::vector<std::string> partsOf(const std::string& text, char by) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string s; std::getline(in, s, by);)
    if (!s.empty()) out.push_back(s);
  return out;
}

}  // namespace measure
}  // namespace gobo
