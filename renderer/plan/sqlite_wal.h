// SPDX-License-Identifier: Apache-2.0
// Write-ahead logging of an SQLite file that several processes may open at once. A new file is turned to it once, for which a reader becomes the only
// writer: there SQLite does not ask its busy handler and says SQLITE_BUSY at once, to all but one of those who open it together.
#pragma once

#include <sqlite3.h>
#include <unistd.h>

#include <chrono>

namespace gobo {
inline namespace plan {

/// Tries again every 5 ms for `seconds`. An SQLite result code; SQLITE_OK: it is on.
inline int enterWal(sqlite3* db, double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  for (;;) {
    const int code = sqlite3_exec(db, "PRAGMA journal_mode=WAL", nullptr, nullptr, nullptr);
    if ((code & 0xff) != SQLITE_BUSY || std::chrono::steady_clock::now() >= end) return code;
    ::usleep(5000);
  }
}

}  // namespace plan
}  // namespace gobo
