// SPDX-License-Identifier: Apache-2.0
// DiskIndex: the SQLite side of DiskStore: (key, bytes, last use) of every term file, and their total. A cache of what the
// files say, so every failure here is answered by making it anew. Not thread-safe; changes are made under the folder's lock.
// Tables: term(key TEXT PRIMARY KEY, bytes, used); total(bytes, files) is kept by triggers, in the same transaction; note(key TEXT PRIMARY KEY,
// type, label, scene, ms, pinned), which earlier builds of this version do not know: what they write has none, what they delete takes its own along.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace gobo {
inline namespace plan {

class DiskIndex {
 public:
  static constexpr int kVersion = 1;
  struct Row {
    std::string key;
    int64_t bytes = 0, used = 0;
  };
  struct Noted : Row {
    std::string type, label, scene;
    double ms = 0;
    bool pinned = false;
    Noted() = default;
    Noted(std::string k, int64_t b, int64_t u, std::string t, std::string l, std::string s, double m, bool p)
        : Row{std::move(k), b, u}, type(std::move(t)), label(std::move(l)), scene(std::move(s)), ms(m), pinned(p) {}
  };

  ~DiskIndex() { close(); }
  /// Opens or makes the index. False: it is there but damaged (or cannot be made); the caller removes it and tries again.
  bool open(const std::string& path);
  /// The version of the sound index that the last open() refused; -1 when it refused none, or not for its version.
  int otherVersion() const { return otherVersion_; }
  void close();
  /// True when the file at the path is still the one that is open (another process may have replaced a damaged one).
  bool current() const;
  /// True when the last failure speaks of wrong content, not of a full disk or a lock.
  bool unsound() const;
  /// Deletes the index's files. Other processes that have them open see current() turn false.
  static void remove(const std::string& path);

  // Each returns false when SQLite failed: the index is to be made anew.
  bool begin();
  bool commit();
  void rollback();
  bool upsert(const std::string& key, int64_t bytes, int64_t used);
  bool touch(const std::string& key, int64_t used);  ///< only ever forwards; no row: nothing
  bool erase(const std::string& key);
  bool clear();
  bool oldest(Row& row, bool& found);  ///< that is not pinned
  bool oldestPinned(Row& row, bool& found);
  bool note(const Noted& row);  ///< all but bytes and use
  bool pin(const std::string& key, bool pinned);
  bool pinned(const std::string& key, bool& pinned);
  bool pinnedBytes(int64_t& bytes);
  bool noted(std::vector<Noted>& rows);
  bool find(const std::string& key, Row& row, bool& found);
  bool all(std::vector<Row>& rows);
  bool totals(int64_t& bytes, int64_t& files);
  bool recount();  ///< total from the rows, should a trigger's work have been lost

 private:
  bool exec(const char* sql);
  sqlite3_stmt* prepare(int which, const char* sql);
  bool done(sqlite3_stmt* s);  ///< steps to the end and resets
  static constexpr int kStatements = 16;
  sqlite3* db_ = nullptr;
  sqlite3_stmt* statements_[kStatements] = {};
  int otherVersion_ = -1;
  std::string path_;
  dev_t device_ = 0;
  ino_t inode_ = 0;
};

}  // namespace plan
}  // namespace gobo
