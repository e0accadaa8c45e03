// SPDX-License-Identifier: Apache-2.0
// A thin layer over SQLite: statements that are prepared once, values by position, errors as Status. Not thread-safe: the
// owner holds a lock.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace gobo {

class Sqlite {
 public:
  Sqlite() = default;
  ~Sqlite() { close(); }
  Sqlite(const Sqlite&) = delete;
  Sqlite& operator=(const Sqlite&) = delete;

  /// WAL, synchronous=FULL, foreign keys; waits `busySeconds` for other processes.
  /// Errors: as status().
  Status open(const std::string& path, double busySeconds);
  void close();
  bool isOpen() const { return db_ != nullptr; }
  /// The file at the path is still the one that is open: nobody removed or replaced it, which SQLite would not see.
  bool current() const;
  /// Statements without values, separated by ";".
  Status exec(const std::string& sql);
  /// The first column of the first row, as text; empty without a row.
  Result<std::string> value(const std::string& sql);
  /// Rows that the last statement changed.
  int64_t changed() const;
  int64_t lastId() const;
  /// Unavailable (busy, locked), ResourceExhausted (disk full), DataLoss (damaged, no database), Internal; names the file.
  Status error(int code) const;

  /// Called before every statement that run, with its text; a test's seam: what is not Ok is that statement's failure.
  std::function<Status(const char* sql)> step;

  /// One use of a prepared statement: bind, then run() or next() until false.
  class Query {
   public:
    Query(Sqlite& db, const char* sql);
    ~Query();
    Query(const Query&) = delete;
    Query& bind(int64_t v);
    Query& bind(uint64_t v) { return bind(int64_t(v)); }
    Query& bind(int v) { return bind(int64_t(v)); }
    Query& bind(double v);
    Query& bind(const std::string& text);
    Query& blob(const std::string& bytes);
    /// True while there is a row; status() tells an end from a failure.
    bool next();
    Status run();
    const Status& status() const { return status_; }
    int64_t integer(int column) const;
    double real(int column) const;
    std::string text(int column) const;  ///< or bytes

   private:
    Sqlite& db_;
    const char* sql_;
    sqlite3_stmt* s_ = nullptr;
    int bound_ = 0;
    bool begun_ = false;
    Status status_;
  };

 private:
  friend class Query;
  sqlite3_stmt* prepare(const char* sql, Status& status);
  sqlite3* db_ = nullptr;
  std::string path_;
  uint64_t device_ = 0, inode_ = 0;
  std::map<std::string, sqlite3_stmt*> statements_;
};

}  // namespace gobo
