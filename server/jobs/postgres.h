// SPDX-License-Identifier: Apache-2.0
// A thin layer over libpq: one connection that is made when it is needed and again after it was lost, statements prepared once a connection,
// values by position, transactions, errors as Status. No message has the password. Not thread-safe: the owner holds a lock.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "server/jobs/sql.h"

struct pg_conn;
struct pg_result;

namespace gobo {
inline namespace jobs {

/// Checks a connection URI ("postgresql:///gobo?host=/run/postgresql") without connecting. Errors: InvalidArgument when it is none, and when it
/// has a password: that belongs into PGPASSFILE.
Status checkPostgresUri(const std::string& uri);
/// What messages call it: user, host and database, nothing else. Of a URI that is checked.
std::string postgresName(const std::string& uri);

class Postgres final : public SqlConnection {
 public:
  /// `waitSeconds`: for locks of other processes, and for a connection.
  Postgres(std::string uri, double waitSeconds);
  ~Postgres() override { close(); }
  Postgres(const Postgres&) = delete;
  Postgres& operator=(const Postgres&) = delete;

  /// Connects unless it is connected. A failed attempt is not repeated within a second: Unavailable at once. Errors: Unavailable;
  /// FailedPrecondition for a server or database that cannot hold a store (older than PostgreSQL 13, not UTF-8).
  Status connect();
  void close();
  /// Statements without values, separated by ";"; the first column of the last one's first row, as text, if it has rows.
  Result<std::string> exec(const std::string& sql);
  /// COMMIT; Unavailable when it is not known whether it happened.
  Status commit();
  std::unique_ptr<SqlStatement> use(const char* sql) override;

  /// The last failure: the transaction did not happen and may do so when it is run again (serialization failure, deadlock).
  bool conflict() const { return conflict_; }
  bool connected() const { return connection_ != nullptr; }
  const std::string& name() const { return name_; }
  int socket() const;
  /// Notifications that have come; Unavailable when the connection is lost.
  Result<std::vector<std::string>> notifications();

  /// Called before every statement that runs, with its text; a test's seam: what is not Ok is that statement's failure.
  std::function<Status(const char* sql)> step;

 private:
  class Use;
  Status failure(const pg_result* result);  ///< closes the connection when it is of no use any more
  Status lost(const std::string& why);
  std::string uri_, name_;
  double waitSeconds_;
  pg_conn* connection_ = nullptr;
  std::map<std::string, std::string> prepared_;  ///< SQL with types -> name
  bool conflict_ = false;
  std::chrono::steady_clock::time_point retryAfter_{};
  Status refused_;
};

}  // namespace jobs
}  // namespace gobo
