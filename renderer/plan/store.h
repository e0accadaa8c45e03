// SPDX-License-Identifier: Apache-2.0
// TermStore: terms by key. A byte-bounded RAM tier (LRU; what is read is held by its readers' shared_ptr and does not
// count against eviction order) over an optional disk tier. Terms may be pinned: then neither tier evicts them for room. Thread-safe.
// Of terms that are made faster than the system hands out memory for them only the last few of a node are kept: who drags a slider would else pay
// for fresh pages with every picture, several times what computing it takes, to keep what nobody asks for again.
#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "plan/term_note.h"
#include "terms/term.h"

namespace gobo {
inline namespace plan {

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
  /// Of large terms that are cheaply made: those of one label and scene that stay. Two clients, two settings each.
  static constexpr size_t kCheapVariants = 4;
  static constexpr uint64_t kCheapBytes = 4ull << 20;  ///< from here on terms have blocks of their own (ZeroedBytes)
  static constexpr double kCheapMsPerMiB = 2.0;        ///< of what is made into memory that was used before
  /// What the system may take for a MiB of fresh memory (0.2 to 8 on virtual machines whose free pages go back to their host): no work of the node. One that is
  /// taken for cheap because of it is measured without it as soon as the memory of its first variants comes back.
  static constexpr double kFreshMsPerMiB = 8.0;
  /// Keeps the term; evicts least recently used ones beyond the bound. `persist`: also to the disk tier.
  /// A term larger than the bound is not kept in RAM (its holder still has it). Persisting writes and syncs the file in
  /// the calling thread, without holding up other callers; `stop` ends that, and leaves no file.
  /// Whether the disk tier has it now.
  bool put(const Hash128& key, TermPtr term, bool persist, const StopToken& stop = {}, const TermNote& note = {});
  /// What was noted of a term in memory; empty for others. Says nothing of its use.
  TermNote note(const Hash128& key) const;
  void erase(const Hash128& key);  ///< from both tiers, pinned or not
  void clear(bool disk);           ///< pinned or not; forgets the pins of what goes
  void shrink(uint64_t most);      ///< the memory tier, least recently used first, but for what is pinned

  /// One row for every term, whichever tiers have it, by key. A term that moves between them meanwhile is in one row.
  std::vector<StoredTerm> list() const;
  /// Drops what fits: `disk` from both tiers, else from memory. Pinned terms stay unless `pinned`. What is dropped, as it was.
  std::vector<StoredTerm> evict(const std::function<bool(const StoredTerm&)>& fits, bool disk, bool pinned);
  /// Pins what fits: all of it or, beyond half of a tier's bytes, nothing. A term that is on disk is pinned there, and in memory too while there is room for
  /// it; one that is in memory alone is pinned there until the store ends. Errors: FailedPrecondition (too many bytes), those of the disk tier.
  Result<std::vector<StoredTerm>> pin(const std::function<bool(const StoredTerm&)>& fits);
  Result<std::vector<StoredTerm>> unpin(const std::function<bool(const StoredTerm&)>& fits);
  uint64_t pinnedBytes() const;      ///< in memory
  uint64_t pinnedDiskBytes() const;  ///< on disk
  uint64_t maxDiskBytes() const;     ///< 0: there is no disk tier
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
    int64_t used;  // microseconds since 1970
    TermNote note;
    bool pinned = false;
    bool cheap = false;  ///< in variants_
  };
  using Entries = std::list<Entry>;
  mutable std::mutex mutex_;
  std::mutex pinning_;  // one change of pins at a time; taken before mutex_
  Entries lru_;         // most recent first
  Entries pinned_;      // apart, so that eviction never walks over them
  std::unordered_map<Hash128, Entries::iterator> index_;
  std::unordered_map<std::string, std::vector<Hash128>> variants_;  // cheap ones by label and scene, least recently used first
  std::unordered_set<Hash128> pins_;                                // of both tiers; of some of them nothing is in memory
  uint64_t bytes_ = 0, pinnedBytes_ = 0;
  uint64_t maxBytes_;
  std::unique_ptr<DiskStore> disk_;
  uint64_t diskErrors_ = 0;
  Status lastDiskError_;
  /// Under mutex_. What leaves goes into `gone`, to be freed outside the lock (buffers are large).
  void insert(const Hash128& key, TermPtr term, const TermNote& note, std::vector<TermPtr>& gone);
  void remove(Entries::iterator at, std::vector<TermPtr>& gone);
  void boundVariants(Entry& added, std::vector<TermPtr>& gone);
  void setPinned(Entries::iterator at, bool pinned);
};

}  // namespace plan
}  // namespace gobo
