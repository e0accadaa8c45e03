// SPDX-License-Identifier: Apache-2.0
// A thin layer over SQLite: statements that are prepared once, values by position, errors as Status. Not thread-safe: the
// owner holds a lock.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "server/jobs/sql.h"

struct sqlite3;
struct sqlite3_stmt;

namespace gobo {
inline namespace jobs {

class Sqlite final : public SqlConnection {
 public:
  Sqlite() = default;
  ~Sqlite() override { close(); }
  Sqlite(const Sqlite&) = delete;
  Sqlite& operator=(const Sqlite&) = delete;

  /// WAL, synchronous=FULL, foreign keys; waits `busySeconds` for other processes.
  /// Errors: as status().
  Status open(const std::string& path, double busySeconds);
  void close();
  bool isOpen() const { return db_ != nullptr; }
  /// Rows that this connection changed since it was opened, those that were rolled back too.
  int64_t changes() const;
  /// The file at the path is still the one that is open: nobody removed or replaced it, which SQLite would not see.
  bool current() const;
  /// Statements without values, separated by ";".
  Status exec(const std::string& sql);
  /// The first column of the first row, as text; empty without a row.
  Result<std::string> value(const std::string& sql);
  /// Unavailable (busy, locked), ResourceExhausted (disk full), DataLoss (damaged, no database), Internal; names the file.
  Status error(int code) const;

  /// Called before every statement that run, with its text; a test's seam: what is not Ok is that statement's failure.
  std::function<Status(const char* sql)> step;

  std::unique_ptr<SqlStatement> use(const char* sql) override;

 private:
  class Use;
  sqlite3_stmt* prepare(const char* sql, Status& status);
  sqlite3* db_ = nullptr;
  std::string path_;
  uint64_t device_ = 0, inode_ = 0;
  std::map<std::string, sqlite3_stmt*> statements_;
};

}  // namespace jobs
}  // namespace gobo
