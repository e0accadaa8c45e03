// SPDX-License-Identifier: Apache-2.0
// How a change is made: every pair (file name, index row) changes under the folder's lock, inside one SQLite transaction, so
// while all processes live the two agree. A killed process leaves at most: a temp file; files unlinked or one file renamed
// without the transaction. open() compares index and files, so its restart heals that; others heal what they come across.
#include "plan/disk_store.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <mutex>
#include <random>
#include <unordered_map>

#include "plan/disk_index.h"
#include "plan/term_files.h"
#include "terms/term_file.h"

namespace gobo {
inline namespace plan {

namespace {
constexpr size_t kTouchesPerFlush = 64;  // gets whose last use may be lost by a kill
constexpr size_t kMostTouches = 4096;    // while the folder is held by another
constexpr int64_t kSweepMicros = 3600ll * 1000000;
}  // namespace

struct DiskStore::Impl {
  DiskStoreOptions options;
  TermFiles files;
  std::string indexPath, temps;
  std::atomic<uint64_t> counter{0};

  mutable std::mutex mutex;  // all below; never held while term bytes are read or written
  mutable DiskIndex index;
  bool dirty = true;          // index and files may disagree, or the index is not open
  bool damagedIndex = false;  // to be removed rather than opened again
  bool opened = false;
  std::unordered_map<std::string, int64_t> touched;
  DiskStoreStats stats;
  int64_t lastUse = 0, lastSweep = 0;

  Impl(const std::string& folder, const DiskStoreOptions& o) : options(o), files(folder), indexPath(folder + "/index.sqlite") {
    if (!options.nowMicros)
      options.nowMicros = [] {
        return int64_t(std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count());
      };
    if (!options.step) options.step = [](const char*) { return 0; };
    if (!options.say) options.say = [](const std::string&) {};
    std::random_device random;  // process ids repeat (containers sharing a folder): names of temp files must not
    temps = files.tempFolder() + "/" + std::to_string(::getpid()) + "-" + std::to_string(random()) + "-" + std::to_string(random());
  }

  int64_t use() { return lastUse = std::max(options.nowMicros(), lastUse + 1); }

  // Under lock and mutex. Makes the rows equal to the files; false: SQLite failed.
  bool reconcile() {
    std::vector<DiskIndex::Row> rows;
    if (!index.begin() || !index.all(rows)) return false;
    std::unordered_map<std::string, int64_t> known;
    for (const auto& r : rows) {
      known[r.key] = r.bytes;
      lastUse = std::max(lastUse, r.used);  // the clock may have been set back since: what is used from now on was still used last
    }
    for (const auto& f : files.scan()) {
      const auto row = known.find(f.key);
      if (row == known.end() || row->second != f.bytes) {
        if (!index.upsert(f.key, f.bytes, f.modified)) return false;
        stats.adopted += row == known.end();
      }
      if (row != known.end()) known.erase(row);
    }
    for (const auto& [key, bytes] : known) {
      if (!index.erase(key)) return false;
      ++stats.missing;
    }
    Status status;
    return index.recount() && unpinBeyondHalf() && evict(0, status) && index.commit();
  }

  // The bound may be lower than it was when they were pinned. The least recently used ones go first.
  bool unpinBeyondHalf() {
    for (;;) {
      int64_t bytes = 0;
      if (!index.pinnedBytes(bytes)) return false;
      if (uint64_t(bytes) <= options.maxBytes / 2) return true;
      DiskIndex::Row row;
      bool found = false;
      if (!index.oldestPinned(row, found) || !found || !index.pin(row.key, false)) return false;
      options.say("cache folder: " + row.key + " is pinned no longer: more than half of engine.disk_bytes would be");
    }
  }

  // Under lock and mutex.
  bool openIndex() {
    const bool fresh = ::access(indexPath.c_str(), F_OK) != 0 || (opened && !index.current());
    const uint64_t before = stats.adopted;
    for (int attempt = 0; attempt < 2; ++attempt) {
      const bool remove = attempt > 0 || damagedIndex;
      if (remove) {
        index.close();
        DiskIndex::remove(indexPath);
        damagedIndex = false;
      }
      if (index.open(indexPath) && reconcile()) {
        stats.rebuilds += remove || (fresh && (opened || stats.adopted > before));
        opened = true;
        dirty = false;
        return true;
      }
      if (index.otherVersion() >= 0)
        options.say("cache folder: " + indexPath + " has version " + std::to_string(index.otherVersion()) + ", this build reads version " +
                    std::to_string(DiskIndex::kVersion) + ": it is made anew from the files");
      index.rollback();
    }
    return false;
  }

  // Drops least recently used files until `need` more bytes fit. False: SQLite failed. `status`: a file would not go.
  bool evict(int64_t need, Status& status) {
    for (int64_t last = -1;;) {
      int64_t bytes = 0, count = 0;
      if (!index.totals(bytes, count)) return false;
      if (count == last) {  // a row that cannot be deleted: the index is not sound, whatever its check said
        damagedIndex = true;
        return false;
      }
      last = count;
      if (uint64_t(bytes + need) <= options.maxBytes) return true;
      DiskIndex::Row row;
      bool found = false;
      if (!index.oldest(row, found)) return false;
      if (!found) return index.recount();
      if (int e = options.step("evict")) {
        status = fileError("evict", files.path(row.key), e);
        return true;
      }
      if (!index.erase(row.key)) return false;
      int e = options.step("unlink");
      if (e || !files.unlink(row.key)) {
        status = fileError("evict", files.path(row.key), e ? e : errno);
        return true;
      }
      ++stats.evicted;
    }
  }

  // Writes the noted uses into the index; a file that the index does not know (its writer was killed) gets its row.
  bool flush() {
    bool adopted = false;
    for (const auto& [key, used] : touched) {
      DiskIndex::Row row;
      bool found = false;
      if (!index.find(key, row, found)) return false;
      if (found) {
        if (!index.touch(key, used)) return false;
      } else if (const int64_t size = files.size(key); size >= 0) {
        if (!index.upsert(key, size, used)) return false;
        ++stats.adopted;
        adopted = true;
      }
    }
    Status status;
    return !adopted || evict(0, status);
  }

  // change(status) -> false when SQLite failed. Tried a second time with an index made anew. Under mutex.
  template <typename F>
  Status transact(double seconds, F change, const StopToken& stop = {}) {
    GOBO_TRY(files.lock(seconds, stop));
    struct Unlock {
      TermFiles& f;
      ~Unlock() { f.unlock(); }
    } unlock{files};
    for (int attempt = 0; attempt < 2; ++attempt) {
      if (dirty || !index.current()) {
        if (!openIndex()) {
          dirty = true;
          continue;
        }
      }
      Status status;
      if (index.begin() && flush() && change(status)) {
        if (!status.ok()) {
          index.rollback();
          dirty = true;
          return status;
        }
        if (options.step("commit") == 0 && index.commit()) {
          touched.clear();
          return {};
        }
      }
      damagedIndex = damagedIndex || index.unsound();
      index.rollback();
      dirty = true;
    }
    return {Code::Internal, "the index of the cache folder cannot be written", indexPath};
  }

  void note(const std::string& key) {
    std::lock_guard hold(mutex);
    if (touched.size() < kMostTouches || touched.count(key)) touched[key] = use();
    if (touched.size() >= kTouchesPerFlush && touched.size() % kTouchesPerFlush == 0)
      (void)transact(0, [](Status&) { return true; });  // the folder is busy: later
  }
};

DiskStore::DiskStore() = default;

DiskStore::~DiskStore() {
  if (!impl_) return;
  std::lock_guard hold(impl_->mutex);
  if (!impl_->touched.empty()) (void)impl_->transact(0.1, [](Status&) { return true; });
}

Result<std::unique_ptr<DiskStore>> DiskStore::open(const std::string& folder, uint64_t maxBytes) {
  DiskStoreOptions options;
  options.maxBytes = maxBytes;
  return open(folder, options);
}

Result<std::unique_ptr<DiskStore>> DiskStore::open(const std::string& folder, const DiskStoreOptions& options) {
  std::unique_ptr<DiskStore> store(new DiskStore);
  store->impl_ = std::make_unique<Impl>(folder, options);
  Impl& d = *store->impl_;
  GOBO_TRY(d.files.makeFolders());
  std::lock_guard hold(d.mutex);
  GOBO_TRY(d.transact(std::max(options.lockSeconds, 1.0), [&](Status&) { return true; }));
  d.lastSweep = d.options.nowMicros();
  d.stats.staleTemps += d.files.removeStaleTemps(d.lastSweep, options.staleTempSeconds);
  return store;
}

bool DiskStore::holds(const Hash128& key) const { return impl_->files.size(key.hex()) >= 0; }

TermPtr DiskStore::get(const Hash128& key, const StopToken& stop) {
  Impl& d = *impl_;
  const std::string name = key.hex();
  TermFiles::Content content = d.files.read(name, stop);
  TermPtr term;
  if (content.bytes) term = parseTerm(content.bytes.get(), content.size, key, stop);
  if (!term && stop.stopRequested()) return nullptr;  // says nothing of the file
  if (term) {
    d.note(name);
    std::lock_guard hold(d.mutex);
    ++d.stats.hits;
    return term;
  }
  std::lock_guard hold(d.mutex);
  ++d.stats.misses;
  if (content.error == EMFILE || content.error == ENFILE || content.error == ENOMEM) return nullptr;  // ours, not the file's fault
  if (content.bytes && isOtherTermVersion(content.bytes.get(), content.size)) {                       // the next put replaces it
    if (++d.stats.foreign == 1)
      d.options.say("cache folder: " + d.files.path(name) + ": " + otherTermVersion(content.bytes.get()) +
                    ": its term is made again, as are others like it (said once)");
    return nullptr;
  }
  if (content.bytes || content.error) {
    ++d.stats.damaged;
    const auto drop = [&](Status&) {
      ino_t inode = 0;
      if (d.files.size(name, &inode) >= 0 && (inode != content.inode || !d.files.unlink(name))) return true;  // replaced meanwhile
      return d.index.erase(name);
    };
    (void)d.transact(d.options.lockSeconds, drop);
  } else {
    DiskIndex::Row row;
    bool found = false;
    d.touched.erase(name);
    if (d.index.find(name, row, found) && found)
      (void)d.transact(0, [&](Status&) {
        if (d.files.size(name) >= 0) return true;
        ++d.stats.missing;
        return d.index.erase(name);
      });
  }
  return nullptr;
}

Status DiskStore::put(const Hash128& key, const Term& term, const StopToken& stop, const TermNote& note) {
  Impl& d = *impl_;
  const std::string name = key.hex();
  const std::vector<uint8_t> bytes = serializeTerm(term, key, stop);
  if (bytes.empty()) return {Code::Cancelled, "stopped before it was written", d.files.path(name)};
  if (bytes.size() > d.options.maxBytes) return {};
  if (d.files.equals(name, bytes)) {
    d.note(name);
    return {};
  }
  const std::string temp = d.temps + "-" + std::to_string(d.counter++) + ".tmp";
  GOBO_TRY(d.files.writeTemp(temp, bytes, d.options.step, stop));
  {
    std::lock_guard hold(d.mutex);
    bool moved = false, tooLarge = false;
    const Status status = d.transact(
        d.options.lockSeconds,
        [&](Status& failed) {
          // A file of this name that is about to be replaced does not count: its row goes first, but not its pin.
          bool pinned = false;
          int64_t others = 0;
          if (!d.index.pinned(name, pinned) || !d.index.erase(name) || !d.index.pinnedBytes(others)) return false;
          if (uint64_t(others) + bytes.size() > d.options.maxBytes) {  // what is pinned stays: this is not kept
            tooLarge = true;
            return d.files.unlink(name);
          }
          if (!d.evict(int64_t(bytes.size()), failed)) return false;
          if (!failed.ok()) return true;
          if (!d.index.upsert(name, int64_t(bytes.size()), d.use())) return false;
          if (!d.index.note({name, 0, 0, term.type(), note.label, note.scene, note.ms, pinned})) return false;
          if (moved) return true;
          if (int e = d.options.step("rename")) failed = fileError("rename", temp, e);
          else failed = d.files.moveIntoPlace(temp, name);
          moved = failed.ok();
          return true;
        },
        stop);
    if (!status.ok()) {
      ::unlink(temp.c_str());
      if (moved) d.files.unlink(name);  // not counted, so it must not stay: repeated failures would pass the bound
      return status;
    }
    if (tooLarge) {
      ::unlink(temp.c_str());
      return {};
    }
    ++d.stats.writes;
    const int64_t now = d.options.nowMicros();
    if (now < d.lastSweep || now - d.lastSweep > kSweepMicros) {  // before: the clock was set back
      d.lastSweep = now;
      d.stats.staleTemps += d.files.removeStaleTemps(now, d.options.staleTempSeconds);
    }
  }
  if (int e = d.options.step("sync-folder")) return fileError("sync", d.files.path(name), e);
  GOBO_TRY(d.files.syncFolderOf(name));
  d.options.step("done");
  return {};
}

void DiskStore::erase(std::span<const Hash128> keys) {
  std::lock_guard hold(impl_->mutex);
  for (const Hash128& key : keys) impl_->touched.erase(key.hex());
  (void)impl_->transact(impl_->options.lockSeconds, [&](Status&) {
    return std::all_of(keys.begin(), keys.end(), [&](const Hash128& key) { return impl_->files.unlink(key.hex()) && impl_->index.erase(key.hex()); });
  });
}

std::vector<StoredTerm> DiskStore::list() const {
  std::vector<DiskIndex::Noted> rows;
  std::lock_guard hold(impl_->mutex);
  std::vector<StoredTerm> out;
  if (!impl_->index.noted(rows)) return out;
  for (const DiskIndex::Noted& r : rows) {
    const auto late = impl_->touched.find(r.key);
    StoredTerm row;
    row.key = Hash128::fromHex(r.key);
    row.type = r.type;
    row.note = {r.label, r.scene, r.ms, 0};
    row.diskBytes = uint64_t(r.bytes);
    row.used = late == impl_->touched.end() ? r.used : std::max(r.used, late->second);
    row.pinned = r.pinned;
    if (!row.key.isZero()) out.push_back(std::move(row));
  }
  return out;
}

Status DiskStore::pin(std::span<const Hash128> keys, bool pinned) {
  Impl& d = *impl_;
  std::lock_guard hold(d.mutex);
  return d.transact(d.options.lockSeconds, [&](Status& failed) {
    for (const Hash128& key : keys) {
      DiskIndex::Row row;
      bool found = false;
      if (!d.index.find(key.hex(), row, found)) return false;
      if (found && !d.index.pin(key.hex(), pinned)) return false;
    }
    int64_t bytes = 0;
    if (!d.index.pinnedBytes(bytes)) return false;
    if (pinned && uint64_t(bytes) > d.options.maxBytes / 2)
      failed = {Code::FailedPrecondition, "pins on disk: " + std::to_string(bytes) + " bytes would be pinned; at most half of it may be, " +
                                              std::to_string(d.options.maxBytes / 2) + " bytes (engine.disk_bytes). Unpin others, or pin less"};
    return true;
  });
}

uint64_t DiskStore::pinnedBytes() const {
  std::lock_guard hold(impl_->mutex);
  int64_t bytes = 0;
  return impl_->index.pinnedBytes(bytes) ? uint64_t(bytes) : 0;
}

uint64_t DiskStore::maxBytes() const { return impl_->options.maxBytes; }

void DiskStore::clear() {
  std::lock_guard hold(impl_->mutex);
  impl_->touched.clear();
  (void)impl_->transact(impl_->options.lockSeconds, [&](Status&) {
    for (const auto& f : impl_->files.scan())
      if (!impl_->files.unlink(f.key)) return false;
    return impl_->index.clear();
  });
}

uint64_t DiskStore::bytes() const {
  std::lock_guard hold(impl_->mutex);
  int64_t bytes = 0, count = 0;
  return impl_->index.totals(bytes, count) ? uint64_t(bytes) : 0;
}

uint64_t DiskStore::count() const {
  std::lock_guard hold(impl_->mutex);
  int64_t bytes = 0, count = 0;
  return impl_->index.totals(bytes, count) ? uint64_t(count) : 0;
}

DiskStoreStats DiskStore::stats() const {
  std::lock_guard hold(impl_->mutex);
  return impl_->stats;
}

}  // namespace plan
}  // namespace gobo
