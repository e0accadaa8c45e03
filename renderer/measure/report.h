// SPDX-License-Identifier: Apache-2.0
// Tables of measured figures: one value that prints as aligned text, CSV and JSON, so that every bench reports alike.
// A plain value; no thread-safety of its own.
#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace measure {

class Table {
 public:
  using Cell = std::variant<std::string, double>;

  Table(std::string name, std::vector<std::string> columns) : name_(std::move(name)), columns_(std::move(columns)) {}
  /// One cell per column (CHECKed).
  void add(std::vector<Cell> row);
  /// Facts about the whole run (device, command, seeds), printed above the table and put into the JSON object.
  void note(std::string key, Cell value) { notes_.emplace_back(std::move(key), std::move(value)); }

  const std::string& name() const { return name_; }
  size_t rows() const { return rows_.size(); }

  /// Columns aligned with two spaces between, numbers to the right with four significant digits ("-" when not finite).
  std::string text() const;
  /// The same as a Markdown table, for docs/.
  std::string markdown() const;
  /// RFC 4180, header first; numbers with 17 significant digits, not-finite ones empty.
  std::string csv() const;
  /// {"name", "notes": {...}, "columns": [...], "rows": [{column: value}]}; not-finite numbers are null.
  std::string json() const;
  /// Writes by the extension of `path`: .csv, .json, .md, else text. Errors: Internal, naming the file.
  Status write(const std::string& path) const;

 private:
  std::string name_;
  std::vector<std::string> columns_;
  std::vector<std::vector<Cell>> rows_;
  std::vector<std::pair<std::string, Cell>> notes_;
};

/// The value after `flag` on a command line ("--out PATH"), or `fallback`.
std::string argumentOr(int argc, char** argv, const std::string& flag, const std::string& fallback);
/// The parts of "a,b,c" between `by`; empty ones are left out.
std::vector<std::string> partsOf(const std::string& text, char by);

}  // namespace measure
}  // namespace gobo
