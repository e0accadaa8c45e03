// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/sqlite.h"

#include <sqlite3.h>
#include <sys/stat.h>

#include "plan/sqlite_wal.h"

namespace gobo {
inline namespace jobs {

Status Sqlite::error(int code) const {
  Code kind = Code::Internal;
  switch (code & 0xff) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED: kind = Code::Unavailable; break;
    case SQLITE_FULL: kind = Code::ResourceExhausted; break;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB: kind = Code::DataLoss; break;
    default: break;
  }
  std::string text = sqlite3_errstr(code);
  if (db_ && (sqlite3_errcode(db_) & 0xff) == (code & 0xff)) text = sqlite3_errmsg(db_);
  return {kind, "job store: " + text, path_};
}

Status Sqlite::open(const std::string& path, double busySeconds) {
  close();
  path_ = path;
  if (const int code = sqlite3_open_v2(path.c_str(), &db_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr); code != SQLITE_OK) {
    const Status failed = error(code);
    close();
    return failed;
  }
  sqlite3_busy_timeout(db_, int(busySeconds * 1e3));
  if (const int code = enterWal(db_, busySeconds); code != SQLITE_OK) {
    const Status failed = error(code);
    close();
    return failed;
  }
  for (const char* sql : {"PRAGMA synchronous=FULL", "PRAGMA foreign_keys=ON"})
    if (const Status status = exec(sql); !status.ok()) {
      close();
      return status;
    }
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) device_ = uint64_t(info.st_dev), inode_ = uint64_t(info.st_ino);
  return {};
}

int64_t Sqlite::changes() const { return db_ ? sqlite3_total_changes64(db_) : 0; }

bool Sqlite::current() const {
  struct stat info {};
  return ::stat(path_.c_str(), &info) == 0 && uint64_t(info.st_dev) == device_ && uint64_t(info.st_ino) == inode_;
}

void Sqlite::close() {
  for (auto& [sql, s] : statements_) sqlite3_finalize(s);
  statements_.clear();
  if (db_) sqlite3_close(db_);
  db_ = nullptr;
}

Status Sqlite::exec(const std::string& sql) {
  if (step) GOBO_TRY(step(sql.c_str()));
  const int code = sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? Status() : error(code);
}

Result<std::string> Sqlite::value(const std::string& sql) {
  sqlite3_stmt* s = nullptr;
  int code = sqlite3_prepare_v2(db_, sql.c_str(), -1, &s, nullptr);
  std::string text;
  if (code == SQLITE_OK) code = sqlite3_step(s);
  if (code == SQLITE_ROW)
    if (const auto* t = sqlite3_column_text(s, 0)) text = reinterpret_cast<const char*>(t);
  const Status status = code == SQLITE_ROW || code == SQLITE_DONE ? Status() : error(code);
  sqlite3_finalize(s);
  if (!status.ok()) return status;
  return text;
}

sqlite3_stmt* Sqlite::prepare(const char* sql, Status& status) {
  sqlite3_stmt*& s = statements_[sql];
  if (!s) {
    const int code = sqlite3_prepare_v3(db_, sql, -1, SQLITE_PREPARE_PERSISTENT, &s, nullptr);
    if (code != SQLITE_OK) status = error(code);
  }
  return s;
}

class Sqlite::Use final : public SqlStatement {
 public:
  Use(Sqlite& db, const char* sql) : db_(db), sql_(sql) { s_ = db.prepare(sql, status_); }
  ~Use() override {
    if (!s_) return;
    sqlite3_reset(s_);
    sqlite3_clear_bindings(s_);
  }
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;
  void bind(int64_t v) override {
    if (s_) sqlite3_bind_int64(s_, ++bound_, v);
  }
  void bind(double v) override {
    if (s_) sqlite3_bind_double(s_, ++bound_, v);
  }
  void bind(const std::string& t) override {
    if (s_) sqlite3_bind_text(s_, ++bound_, t.data(), int(t.size()), SQLITE_TRANSIENT);
  }
  void blob(const std::string& b) override {
    if (s_) sqlite3_bind_blob(s_, ++bound_, b.data(), int(b.size()), SQLITE_TRANSIENT);
  }
  bool next() override {
    if (!s_ || !status_.ok()) return false;
    if (!begun_ && db_.step) status_ = db_.step(sql_);
    begun_ = true;
    if (!status_.ok()) return false;
    const int code = sqlite3_step(s_);
    if (code == SQLITE_ROW) return true;
    if (code != SQLITE_DONE) status_ = db_.error(code);
    return false;
  }
  const Status& status() const override { return status_; }
  int64_t integer(int column) const override { return sqlite3_column_int64(s_, column); }
  double real(int column) const override { return sqlite3_column_double(s_, column); }
  std::string text(int column) const override {
    const auto* bytes = static_cast<const char*>(sqlite3_column_blob(s_, column));
    return bytes ? std::string(bytes, size_t(sqlite3_column_bytes(s_, column))) : std::string();
  }

 private:
  Sqlite& db_;
  const char* sql_;
  sqlite3_stmt* s_ = nullptr;
  int bound_ = 0;
  bool begun_ = false;
  Status status_;
};

std::unique_ptr<SqlStatement> Sqlite::use(const char* sql) { return std::make_unique<Use>(*this, sql); }

}  // namespace jobs
}  // namespace gobo
