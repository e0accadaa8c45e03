// SPDX-License-Identifier: Apache-2.0
#include "plan/store.h"

#include <algorithm>
#include <chrono>

#include "plan/disk_store.h"

namespace gobo {
inline namespace plan {

static int64_t wallMicros() {
  return int64_t(std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count());
}

TermStore::TermStore(uint64_t maxBytes, std::unique_ptr<DiskStore> disk) : maxBytes_(maxBytes), disk_(std::move(disk)) {
  if (disk_)
    for (const StoredTerm& row : disk_->list())
      if (row.pinned) pins_.insert(row.key);
}
TermStore::~TermStore() = default;

static std::string variantsOf(const TermNote& note) { return note.label + '\n' + note.scene; }

static bool isCheap(const TermNote& note, const Term& term) {
  const double mib = double(term.bytes()) / double(1 << 20), fresh = double(term.freshBytes()) / double(1 << 20);
  return !note.label.empty() && term.bytes() >= TermStore::kCheapBytes && note.ms <= TermStore::kCheapMsPerMiB * mib + TermStore::kFreshMsPerMiB * fresh;
}

void TermStore::boundVariants(Entry& added, std::vector<TermPtr>& gone) {
  std::vector<Hash128>& all = variants_[variantsOf(added.note)];
  added.cheap = true;
  all.push_back(added.key);
  if (all.size() <= kCheapVariants) return;
  for (const Hash128& key : all) {
    const auto at = index_.find(key);
    if (key == added.key || at->second->pinned) continue;
    remove(at->second, gone);
    return;
  }
}

void TermStore::remove(Entries::iterator at, std::vector<TermPtr>& gone) {
  bytes_ -= at->bytes;
  if (at->pinned) pinnedBytes_ -= at->bytes;
  if (at->cheap) {
    const auto of = variants_.find(variantsOf(at->note));
    std::erase(of->second, at->key);
    if (of->second.empty()) variants_.erase(of);
  }
  index_.erase(at->key);
  gone.push_back(std::move(at->term));
  (at->pinned ? pinned_ : lru_).erase(at);
}

void TermStore::setPinned(Entries::iterator at, bool pinned) {
  if (at->pinned == pinned) return;
  Entries &from = pinned ? lru_ : pinned_, &to = pinned ? pinned_ : lru_;
  to.splice(to.begin(), from, at);
  at->pinned = pinned;
  pinnedBytes_ = pinned ? pinnedBytes_ + at->bytes : pinnedBytes_ - at->bytes;
}

void TermStore::insert(const Hash128& key, TermPtr term, const TermNote& note, std::vector<TermPtr>& gone) {
  if (const auto old = index_.find(key); old != index_.end()) remove(old->second, gone);
  const uint64_t bytes = term->bytes();
  const bool cheap = isCheap(note, *term);
  if (bytes > maxBytes_ - pinnedBytes_) return;
  while (bytes_ + bytes > maxBytes_) remove(std::prev(lru_.end()), gone);
  lru_.push_front({key, std::move(term), bytes, wallMicros(), note});
  index_[key] = lru_.begin();
  bytes_ += bytes;
  if (pins_.count(key) && pinnedBytes_ + bytes <= maxBytes_ / 2) setPinned(lru_.begin(), true);
  if (cheap) boundVariants(*index_[key], gone);
}

TermPtr TermStore::get(const Hash128& key, Tier* from, const StopToken& stop) {
  if (from) *from = Tier::None;
  {
    std::lock_guard hold(mutex_);
    if (const auto at = index_.find(key); at != index_.end()) {
      Entries& entries = at->second->pinned ? pinned_ : lru_;
      entries.splice(entries.begin(), entries, at->second);
      at->second->used = wallMicros();
      if (at->second->cheap) {
        std::vector<Hash128>& all = variants_[variantsOf(at->second->note)];
        std::rotate(std::find(all.begin(), all.end(), key), std::find(all.begin(), all.end(), key) + 1, all.end());
      }
      if (from) *from = Tier::Memory;
      return at->second->term;
    }
  }
  TermPtr term = disk_ ? disk_->get(key, stop) : nullptr;
  if (!term) return nullptr;
  if (from) *from = Tier::Disk;
  std::vector<TermPtr> gone;
  std::lock_guard hold(mutex_);
  // While the file was read somebody may have put the key, perhaps with more sample blocks: theirs is the newer one.
  if (const auto at = index_.find(key); at != index_.end()) return at->second->term;
  insert(key, term, {}, gone);
  return term;
}

TermStore::Tier TermStore::holds(const Hash128& key) const {
  {
    std::lock_guard hold(mutex_);
    if (index_.count(key)) return Tier::Memory;
  }
  return disk_ && disk_->holds(key) ? Tier::Disk : Tier::None;
}

bool TermStore::put(const Hash128& key, TermPtr term, bool persist, const StopToken& stop, const TermNote& note) {
  GOBO_CHECK(term != nullptr);
  {
    std::vector<TermPtr> gone;  // freed after the lock: declared before it
    std::lock_guard hold(mutex_);
    insert(key, term, note, gone);
  }
  if (!persist || !disk_) return false;
  const Status status = disk_->put(key, *term, stop, note);
  std::lock_guard hold(mutex_);
  if (status.ok()) {
    if (const auto at = index_.find(key); at != index_.end()) at->second->note.unsaved = 0;
    return true;
  }
  if (status.code() == Code::Cancelled) return false;
  ++diskErrors_;
  lastDiskError_ = status;
  return false;
}

TermNote TermStore::note(const Hash128& key) const {
  std::lock_guard hold(mutex_);
  const auto at = index_.find(key);
  return at == index_.end() ? TermNote{} : at->second->note;
}

void TermStore::erase(const Hash128& key) {
  std::vector<TermPtr> gone;
  {
    std::lock_guard hold(mutex_);
    if (const auto at = index_.find(key); at != index_.end()) remove(at->second, gone);
    pins_.erase(key);
  }
  if (disk_) disk_->erase({&key, 1});
}

void TermStore::clear(bool disk) {
  if (disk && disk_) disk_->clear();
  const std::vector<StoredTerm> left = disk_ ? disk_->list() : std::vector<StoredTerm>();
  Entries gone, alsoGone;
  std::lock_guard hold(mutex_);
  gone.swap(lru_);
  alsoGone.swap(pinned_);
  index_.clear();
  variants_.clear();
  pins_.clear();
  for (const StoredTerm& row : left)
    if (row.pinned) pins_.insert(row.key);
  bytes_ = pinnedBytes_ = 0;
}

void TermStore::shrink(uint64_t most) {
  std::vector<TermPtr> gone;
  std::lock_guard hold(mutex_);
  while (bytes_ > most && !lru_.empty()) remove(std::prev(lru_.end()), gone);
}

uint64_t TermStore::bytes() const {
  std::lock_guard hold(mutex_);
  return bytes_;
}

uint64_t TermStore::count() const {
  std::lock_guard hold(mutex_);
  return lru_.size() + pinned_.size();
}

uint64_t TermStore::diskErrors() const {
  std::lock_guard hold(mutex_);
  return diskErrors_;
}

Status TermStore::lastDiskError() const {
  std::lock_guard hold(mutex_);
  return lastDiskError_;
}

uint64_t TermStore::diskBytes() const { return disk_ ? disk_->bytes() : 0; }

}  // namespace plan
}  // namespace gobo
