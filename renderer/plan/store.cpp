// SPDX-License-Identifier: Apache-2.0
#include "plan/store.h"

#include "plan/disk_store.h"

namespace gobo {

TermStore::TermStore(uint64_t maxBytes, std::unique_ptr<DiskStore> disk) : maxBytes_(maxBytes), disk_(std::move(disk)) {}
TermStore::~TermStore() = default;

void TermStore::remove(std::list<Entry>::iterator at, std::vector<TermPtr>& gone) {
  bytes_ -= at->bytes;
  index_.erase(at->key);
  gone.push_back(std::move(at->term));
  lru_.erase(at);
}

void TermStore::insert(const Hash128& key, TermPtr term, std::vector<TermPtr>& gone) {
  if (const auto old = index_.find(key); old != index_.end()) remove(old->second, gone);
  const uint64_t bytes = term->bytes();
  if (bytes > maxBytes_) return;
  while (bytes_ + bytes > maxBytes_) remove(std::prev(lru_.end()), gone);
  lru_.push_front({key, std::move(term), bytes});
  index_[key] = lru_.begin();
  bytes_ += bytes;
}

TermPtr TermStore::get(const Hash128& key, Tier* from, const StopToken& stop) {
  if (from) *from = Tier::None;
  {
    std::lock_guard hold(mutex_);
    if (const auto at = index_.find(key); at != index_.end()) {
      lru_.splice(lru_.begin(), lru_, at->second);
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
  insert(key, term, gone);
  return term;
}

TermStore::Tier TermStore::holds(const Hash128& key) const {
  {
    std::lock_guard hold(mutex_);
    if (index_.count(key)) return Tier::Memory;
  }
  return disk_ && disk_->holds(key) ? Tier::Disk : Tier::None;
}

void TermStore::put(const Hash128& key, TermPtr term, bool persist, const StopToken& stop) {
  GOBO_CHECK(term != nullptr);
  {
    std::vector<TermPtr> gone;  // freed after the lock: declared before it
    std::lock_guard hold(mutex_);
    insert(key, term, gone);
  }
  if (!persist || !disk_) return;
  const Status status = disk_->put(key, *term, stop);
  if (status.ok() || status.code() == Code::Cancelled) return;
  std::lock_guard hold(mutex_);
  ++diskErrors_;
  lastDiskError_ = status;
}

void TermStore::erase(const Hash128& key) {
  std::vector<TermPtr> gone;
  {
    std::lock_guard hold(mutex_);
    if (const auto at = index_.find(key); at != index_.end()) remove(at->second, gone);
  }
  if (disk_) disk_->erase(key);
}

void TermStore::clear(bool disk) {
  std::list<Entry> gone;
  {
    std::lock_guard hold(mutex_);
    gone.swap(lru_);
    index_.clear();
    bytes_ = 0;
  }
  if (disk && disk_) disk_->clear();
}

void TermStore::shrink(uint64_t most) {
  std::vector<TermPtr> gone;
  std::lock_guard hold(mutex_);
  while (bytes_ > most) remove(std::prev(lru_.end()), gone);
}

uint64_t TermStore::bytes() const {
  std::lock_guard hold(mutex_);
  return bytes_;
}

uint64_t TermStore::count() const {
  std::lock_guard hold(mutex_);
  return lru_.size();
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

}  // namespace gobo
