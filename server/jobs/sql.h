// SPDX-License-Identifier: Apache-2.0
// What the job stores ask of a database: one connection, statements with values by position, rows. The SQL of server/jobs/sql_job_*.cpp is
// what SQLite and PostgreSQL both understand; parameters are written ?1, ?2 ... . Not thread-safe: the owner holds a lock.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/status.h"

namespace gobo {
inline namespace jobs {

/// One use of a statement: bind each value in order, then next() until false. A null column reads as 0 or as empty.
class SqlStatement {
 public:
  virtual ~SqlStatement() = default;
  virtual void bind(int64_t v) = 0;
  virtual void bind(double v) = 0;
  virtual void bind(const std::string& text) = 0;
  virtual void blob(const std::string& bytes) = 0;
  /// True while there is a row; status() tells an end from a failure.
  virtual bool next() = 0;
  virtual const Status& status() const = 0;
  virtual int64_t integer(int column) const = 0;
  virtual double real(int column) const = 0;
  virtual std::string text(int column) const = 0;  ///< or bytes
};

class SqlConnection {
 public:
  virtual ~SqlConnection() = default;
  /// `sql` is prepared once and must live as long as the connection, or be the text of each use.
  virtual std::unique_ptr<SqlStatement> use(const char* sql) = 0;
};

class SqlQuery {
 public:
  SqlQuery(SqlConnection& db, const char* sql) : s_(db.use(sql)) {}
  SqlQuery& bind(int64_t v) {
    s_->bind(v);
    return *this;
  }
  SqlQuery& bind(uint64_t v) { return bind(int64_t(v)); }
  SqlQuery& bind(int v) { return bind(int64_t(v)); }
  SqlQuery& bind(double v) {
    s_->bind(v);
    return *this;
  }
  SqlQuery& bind(const std::string& text) {
    s_->bind(text);
    return *this;
  }
  SqlQuery& blob(const std::string& bytes) {
    s_->blob(bytes);
    return *this;
  }
  bool next() { return s_->next(); }
  Status run() {
    while (s_->next()) {}
    return s_->status();
  }
  const Status& status() const { return s_->status(); }
  int64_t integer(int column) const { return s_->integer(column); }
  double real(int column) const { return s_->real(column); }
  std::string text(int column) const { return s_->text(column); }

 private:
  std::unique_ptr<SqlStatement> s_;
};

}  // namespace jobs
}  // namespace gobo
