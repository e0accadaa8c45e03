// SPDX-License-Identifier: Apache-2.0
// TermStore: terms by key. A byte-bounded RAM tier (LRU; pinned terms are held by their readers' shared_ptr and do not
// count against eviction order) over an optional disk tier. Thread-safe.
#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "terms/term.h"

namespace gobo {

class DiskStore;  // plan/disk_store.h

class TermStore {
 public:
  explicit TermStore(uint64_t maxBytes, std::unique_ptr<DiskStore> disk = nullptr);
  ~TermStore();
  enum class Tier { None, Memory, Disk };
  /// The term, or null. `from` says which tier had it; a disk hit moves it into RAM. Null, too, when `stop` ended the reading of a file.
  TermPtr get(const Hash128& key, Tier* from = nullptr, const StopToken& stop = {});
  /// Where get() would find it; reads nothing, and a damaged file is found out by get() alone.
  Tier holds(const Hash128& key) const;
  /// Keeps the term; evicts least recently used ones beyond the bound. `persist`: also to the disk tier.
  /// A term larger than the bound is not kept in RAM (its holder still has it). Persisting writes and syncs the file in
  /// the calling thread, without holding up other callers; `stop` ends that, and leaves no file.
  void put(const Hash128& key, TermPtr term, bool persist, const StopToken& stop = {});
  void erase(const Hash128& key);  ///< from both tiers
  void clear(bool disk);
  void shrink(uint64_t most);  ///< the memory tier, least recently used first
  uint64_t bytes() const;
  uint64_t maxBytes() const { return maxBytes_; }
  uint64_t diskBytes() const;
  uint64_t count() const;
  /// Writes that the disk tier refused (full, not writable) and the last reason; the terms stay in RAM.
  uint64_t diskErrors() const;
  Status lastDiskError() const;

 private:
  struct Entry {
    Hash128 key;
    TermPtr term;
    uint64_t bytes;
  };
  mutable std::mutex mutex_;
  std::list<Entry> lru_;  // most recent first
  std::unordered_map<Hash128, std::list<Entry>::iterator> index_;
  uint64_t bytes_ = 0;
  uint64_t maxBytes_;
  std::unique_ptr<DiskStore> disk_;
  uint64_t diskErrors_ = 0;
  Status lastDiskError_;
  /// Under mutex_. What leaves goes into `gone`, to be freed outside the lock (buffers are large).
  void insert(const Hash128& key, TermPtr term, std::vector<TermPtr>& gone);
  void remove(std::list<Entry>::iterator at, std::vector<TermPtr>& gone);
};

}  // namespace gobo
