// SPDX-License-Identifier: Apache-2.0
#include "plan/disk_index.h"

#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>

#include "plan/sqlite_wal.h"

namespace gobo {
inline namespace plan {

namespace {
constexpr double kBusySeconds = 5;

constexpr const char* kSchema = R"(
CREATE TABLE IF NOT EXISTS term(key TEXT PRIMARY KEY, bytes INTEGER NOT NULL, used INTEGER NOT NULL) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS term_used ON term(used, key);
CREATE TABLE IF NOT EXISTS total(id INTEGER PRIMARY KEY CHECK(id = 1), bytes INTEGER NOT NULL, files INTEGER NOT NULL);
INSERT OR IGNORE INTO total VALUES(1, 0, 0);
CREATE TRIGGER IF NOT EXISTS term_in AFTER INSERT ON term BEGIN
  UPDATE total SET bytes = bytes + new.bytes, files = files + 1; END;
CREATE TRIGGER IF NOT EXISTS term_out AFTER DELETE ON term BEGIN
  UPDATE total SET bytes = bytes - old.bytes, files = files - 1; END;
CREATE TRIGGER IF NOT EXISTS term_size AFTER UPDATE OF bytes ON term BEGIN
  UPDATE total SET bytes = bytes + new.bytes - old.bytes; END;
PRAGMA user_version = 1;
)";

// Made in an index of this version that has none.
constexpr const char* kNotes = R"(
CREATE TABLE IF NOT EXISTS note(key TEXT PRIMARY KEY, type TEXT NOT NULL DEFAULT '', label TEXT NOT NULL DEFAULT '', scene TEXT NOT NULL DEFAULT '',
  ms REAL NOT NULL DEFAULT 0, pinned INTEGER NOT NULL DEFAULT 0) WITHOUT ROWID;
CREATE TRIGGER IF NOT EXISTS note_out AFTER DELETE ON term BEGIN DELETE FROM note WHERE key = old.key; END;
)";

int pragmaInt(sqlite3* db, const char* sql) {
  sqlite3_stmt* s = nullptr;
  int value = -1;
  if (sqlite3_prepare_v2(db, sql, -1, &s, nullptr) == SQLITE_OK && sqlite3_step(s) == SQLITE_ROW) value = sqlite3_column_int(s, 0);
  sqlite3_finalize(s);
  return value;
}

bool sound(sqlite3* db) {
  sqlite3_stmt* s = nullptr;
  bool good = false;
  if (sqlite3_prepare_v2(db, "PRAGMA quick_check(1)", -1, &s, nullptr) == SQLITE_OK && sqlite3_step(s) == SQLITE_ROW)
    good = std::string(reinterpret_cast<const char*>(sqlite3_column_text(s, 0))) == "ok";
  sqlite3_finalize(s);
  return good;
}
}  // namespace

bool DiskIndex::open(const std::string& path) {
  close();
  otherVersion_ = -1;
  path_ = path;
  if (sqlite3_open_v2(path.c_str(), &db_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr) != SQLITE_OK) {
    close();
    return false;
  }
  sqlite3_busy_timeout(db_, int(kBusySeconds * 1e3));
  // The last connection to close deletes "-wal" by its name, which may by then belong to a newer index: keep it instead.
  int keep = 1;
  sqlite3_file_control(db_, "main", SQLITE_FCNTL_PERSIST_WAL, &keep);
  // synchronous=NORMAL: a power cut may take back the last transactions but not the index; open() compares with the files.
  bool good = enterWal(db_, kBusySeconds) == SQLITE_OK && exec("PRAGMA synchronous=NORMAL") && sound(db_);
  if (good) {
    const int version = pragmaInt(db_, "PRAGMA user_version");
    const bool empty = version == 0 && pragmaInt(db_, "SELECT count(*) FROM sqlite_schema") == 0;
    if (version != kVersion && !empty) otherVersion_ = version;
    good = version == kVersion || (empty && exec("BEGIN IMMEDIATE") && exec(kSchema) && exec("COMMIT"));
    good = good && exec(kNotes);
  }
  struct stat st;
  if (!good || ::stat(path.c_str(), &st) != 0) {
    close();
    return false;
  }
  device_ = st.st_dev;
  inode_ = st.st_ino;
  return true;
}

void DiskIndex::close() {
  for (auto& s : statements_) {
    sqlite3_finalize(s);
    s = nullptr;
  }
  sqlite3_close(db_);
  db_ = nullptr;
}

bool DiskIndex::current() const {
  struct stat st;
  return db_ && ::stat(path_.c_str(), &st) == 0 && st.st_dev == device_ && st.st_ino == inode_;
}

bool DiskIndex::unsound() const {
  if (!db_) return false;
  const int code = sqlite3_errcode(db_) & 0xff;
  return code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_ERROR || code == SQLITE_CONSTRAINT || code == SQLITE_MISMATCH;
}

void DiskIndex::remove(const std::string& path) {
  for (const char* tail : {"-wal", "-shm", "-journal", ""}) ::unlink((path + tail).c_str());
}

bool DiskIndex::exec(const char* sql) { return db_ && sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) == SQLITE_OK; }

sqlite3_stmt* DiskIndex::prepare(int which, const char* sql) {
  if (!db_) return nullptr;
  auto& s = statements_[which];
  if (!s) sqlite3_prepare_v3(db_, sql, -1, SQLITE_PREPARE_PERSISTENT, &s, nullptr);
  if (s) sqlite3_reset(s);
  return s;
}

bool DiskIndex::done(sqlite3_stmt* s) {
  const bool good = sqlite3_step(s) == SQLITE_DONE;
  sqlite3_reset(s);
  return good;
}

bool DiskIndex::begin() { return exec("BEGIN IMMEDIATE"); }
bool DiskIndex::commit() { return exec("COMMIT"); }
void DiskIndex::rollback() {
  if (db_ && !sqlite3_get_autocommit(db_)) exec("ROLLBACK");
}
bool DiskIndex::clear() { return exec("DELETE FROM term") && recount(); }
bool DiskIndex::recount() { return exec("UPDATE total SET bytes = (SELECT coalesce(sum(bytes), 0) FROM term), files = (SELECT count(*) FROM term)"); }

bool DiskIndex::upsert(const std::string& key, int64_t bytes, int64_t used) {
  auto* s = prepare(0, "INSERT INTO term VALUES(?1, ?2, ?3) ON CONFLICT(key) DO UPDATE SET bytes = ?2, used = max(used, ?3)");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  sqlite3_bind_int64(s, 2, bytes);
  sqlite3_bind_int64(s, 3, used);
  return done(s);
}

bool DiskIndex::touch(const std::string& key, int64_t used) {
  auto* s = prepare(1, "UPDATE term SET used = max(used, ?2) WHERE key = ?1");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  sqlite3_bind_int64(s, 2, used);
  return done(s);
}

bool DiskIndex::erase(const std::string& key) {
  auto* s = prepare(2, "DELETE FROM term WHERE key = ?1");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  return done(s);
}

namespace {
bool takeRow(sqlite3_stmt* s, DiskIndex::Row& row, bool& found) {
  const int code = sqlite3_step(s);
  found = code == SQLITE_ROW;
  if (found) {
    const auto* text = sqlite3_column_text(s, 0);
    row.key.assign(text ? reinterpret_cast<const char*>(text) : "");
    row.bytes = sqlite3_column_int64(s, 1);
    row.used = sqlite3_column_int64(s, 2);
  }
  return found || code == SQLITE_DONE;
}
}  // namespace

bool DiskIndex::oldest(Row& row, bool& found) {
  auto* s =
      prepare(3, "SELECT key, bytes, used FROM term WHERE NOT EXISTS(SELECT 1 FROM note WHERE note.key = term.key AND pinned) ORDER BY used, key LIMIT 1");
  if (!s) return false;
  const bool good = takeRow(s, row, found);
  sqlite3_reset(s);
  return good;
}

bool DiskIndex::oldestPinned(Row& row, bool& found) {
  auto* s = prepare(7, "SELECT term.key, bytes, used FROM note JOIN term USING(key) WHERE pinned ORDER BY used, term.key LIMIT 1");
  if (!s) return false;
  const bool good = takeRow(s, row, found);
  sqlite3_reset(s);
  return good;
}

bool DiskIndex::note(const Noted& row) {
  auto* s = prepare(8, "INSERT OR REPLACE INTO note VALUES(?1, ?2, ?3, ?4, ?5, ?6)");
  if (!s) return false;
  int at = 0;
  for (const std::string* text : {&row.key, &row.type, &row.label, &row.scene}) sqlite3_bind_text(s, ++at, text->data(), int(text->size()), SQLITE_STATIC);
  sqlite3_bind_double(s, 5, row.ms);
  sqlite3_bind_int(s, 6, row.pinned);
  return done(s);
}

bool DiskIndex::pin(const std::string& key, bool pinned) {
  auto* s = prepare(9, "INSERT INTO note(key, pinned) VALUES(?1, ?2) ON CONFLICT(key) DO UPDATE SET pinned = ?2");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  sqlite3_bind_int(s, 2, pinned);
  return done(s);
}

bool DiskIndex::pinned(const std::string& key, bool& pinned) {
  pinned = false;
  auto* s = prepare(10, "SELECT pinned FROM note WHERE key = ?1");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  const int code = sqlite3_step(s);
  if (code == SQLITE_ROW) pinned = sqlite3_column_int(s, 0) != 0;
  sqlite3_reset(s);
  return code == SQLITE_ROW || code == SQLITE_DONE;
}

bool DiskIndex::pinnedBytes(int64_t& bytes) {
  auto* s = prepare(11, "SELECT coalesce(sum(bytes), 0) FROM note JOIN term USING(key) WHERE pinned");
  if (!s) return false;
  const bool good = sqlite3_step(s) == SQLITE_ROW;
  if (good) bytes = sqlite3_column_int64(s, 0);
  sqlite3_reset(s);
  return good;
}

bool DiskIndex::noted(std::vector<Noted>& rows) {
  rows.clear();
  auto* s = prepare(12, "SELECT term.key, bytes, used, type, label, scene, ms, pinned FROM term LEFT JOIN note USING(key)");
  if (!s) return false;
  const auto text = [&](int column) {
    const auto* t = sqlite3_column_text(s, column);
    return std::string(t ? reinterpret_cast<const char*>(t) : "");
  };
  for (;;) {
    const int code = sqlite3_step(s);
    if (code != SQLITE_ROW) {
      sqlite3_reset(s);
      return code == SQLITE_DONE;
    }
    rows.emplace_back(text(0), sqlite3_column_int64(s, 1), sqlite3_column_int64(s, 2), text(3), text(4), text(5), sqlite3_column_double(s, 6),
                      sqlite3_column_int(s, 7) != 0);
  }
}

bool DiskIndex::find(const std::string& key, Row& row, bool& found) {
  auto* s = prepare(4, "SELECT key, bytes, used FROM term WHERE key = ?1");
  if (!s) return false;
  sqlite3_bind_text(s, 1, key.data(), int(key.size()), SQLITE_STATIC);
  const bool good = takeRow(s, row, found);
  sqlite3_reset(s);
  return good;
}

bool DiskIndex::all(std::vector<Row>& rows) {
  rows.clear();
  auto* s = prepare(5, "SELECT key, bytes, used FROM term");
  if (!s) return false;
  for (;;) {
    Row row;
    bool found = false;
    const bool good = takeRow(s, row, found);
    if (!good || !found) {
      sqlite3_reset(s);
      return good;
    }
    rows.push_back(std::move(row));
  }
}

bool DiskIndex::totals(int64_t& bytes, int64_t& files) {
  auto* s = prepare(6, "SELECT bytes, files FROM total");
  if (!s) return false;
  const bool found = sqlite3_step(s) == SQLITE_ROW;
  if (found) {
    bytes = sqlite3_column_int64(s, 0);
    files = sqlite3_column_int64(s, 1);
  }
  sqlite3_reset(s);
  return found;
}

}  // namespace plan
}  // namespace gobo
