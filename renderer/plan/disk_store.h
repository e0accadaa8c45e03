// SPDX-License-Identifier: Apache-2.0
// DiskStore: content of the RAM tier that was dear to compute, as files FOLDER/ab/abcdef....term (docs/term_file.md) with an
// index in FOLDER/index.sqlite (key, bytes, last use) for least-recently-used eviction. Two daemons may share a folder;
// kill -9 at any moment leaves no wrong term: files appear by rename after fdatasync, reads check the digest, damaged or
// orphaned files are dropped. The files are the truth, the index is rebuilt when missing or damaged. Thread-safe.
// The folder must be on a local file system (flock, and SQLite's WAL, need one).
// Cost: put serialises, writes and syncs in the calling thread, holding no lock while it does so; get is one read, one digest
// and one copy. Figures: bench/store_bench.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "plan/term_note.h"
#include "terms/term.h"

namespace gobo {
inline namespace plan {

/// The seams: what a test replaces. Left alone they are the real clock and a disk that does not fail.
struct DiskStoreOptions {
  uint64_t maxBytes = 16ull << 30;     ///< bound on the sum of .term file sizes
  double staleTempSeconds = 900;       ///< temp files that were not written to for this long are litter of a killed writer
  double lockSeconds = 5;              ///< how long put, erase and clear wait for another process that holds the folder
  std::function<int64_t()> nowMicros;  ///< wall clock in microseconds: last use, age of temp files
  /// Called before each step of a change: "create", "write", "sync", "evict", "unlink", "rename", "commit", "sync-folder",
  /// "done". Returns 0, or the errno with which that step is to fail. May never return (a crash).
  std::function<int(const char* step)> step;
  /// Told, a line each, what of another version was set aside: the index once an opening, term files once in the store's life.
  std::function<void(const std::string& line)> say;
};

struct DiskStoreStats {
  uint64_t hits = 0, misses = 0, writes = 0;
  uint64_t damaged = 0;  ///< files dropped because their bytes were wrong
  uint64_t foreign = 0;  ///< files passed over because another version wrote them
  uint64_t evicted = 0;
  uint64_t adopted = 0;     ///< files found without an index row
  uint64_t missing = 0;     ///< index rows found without a file
  uint64_t staleTemps = 0;  ///< litter of killed writers, removed
  uint64_t rebuilds = 0;    ///< times the index was made anew because it was missing, damaged or replaced
};

class DiskStore {
 public:
  /// Errors: FailedPrecondition when the folder's files cannot be believed (base/own_folder.h); others when it cannot be made or
  /// written to. They name it.
  static Result<std::unique_ptr<DiskStore>> open(const std::string& folder, uint64_t maxBytes);
  static Result<std::unique_ptr<DiskStore>> open(const std::string& folder, const DiskStoreOptions& options);
  ~DiskStore();
  TermPtr get(const Hash128& key, const StopToken& stop = {});  ///< null if absent or damaged (then removed), or stopped (then as it was)
  bool holds(const Hash128& key) const;                         ///< there is a file
  /// Writes the file and evicts so that the files stay within maxBytes; durable on return. A term whose file is larger than
  /// maxBytes is not kept (Ok). An equal file already there is only marked used; a different one is replaced.
  /// Errors: ResourceExhausted (disk full), Unavailable (folder locked for too long), Internal, Cancelled (`stop`: nothing of it is left);
  /// the message names the file.
  Status put(const Hash128& key, const Term& term, const StopToken& stop = {}, const TermNote& note = {});
  void erase(std::span<const Hash128> keys);
  void erase(const Hash128& key) { erase({&key, 1}); }
  void clear();            ///< every term of the folder, also those other processes wrote
  uint64_t bytes() const;  ///< sum of file sizes, by the index
  uint64_t count() const;
  /// What the index knows of each file; what is noted of a term, and its pin, end with the index (which is made anew when it is damaged). Any order.
  std::vector<StoredTerm> list() const;
  /// Pinned files are not evicted for room, by no process that shares the folder. Keys without a file are passed over. All or none. Errors:
  /// FailedPrecondition: more than half of maxBytes would be pinned; Unavailable, Internal as put.
  Status pin(std::span<const Hash128> keys, bool pinned);
  uint64_t pinnedBytes() const;
  uint64_t maxBytes() const;
  DiskStoreStats stats() const;  ///< of this object

 private:
  DiskStore();
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace plan
}  // namespace gobo
