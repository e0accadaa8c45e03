// SPDX-License-Identifier: Apache-2.0
// The side of TermStore that people look at and change by hand: lists, eviction by name, pins.
#include <algorithm>
#include <map>

#include "plan/disk_store.h"
#include "plan/store.h"

namespace gobo {
inline namespace plan {

namespace {

template <typename Fits>
std::vector<StoredTerm> thoseOf(std::vector<StoredTerm> rows, const Fits& fits) {
  std::erase_if(rows, [&](const StoredTerm& row) { return !fits(row); });
  return rows;
}

Status tooManyPins(const char* where, const char* option, uint64_t want, uint64_t pinned, uint64_t most) {
  return {Code::FailedPrecondition, "pins " + std::string(where) + ": " + std::to_string(want) + " bytes more than the " + std::to_string(pinned) +
                                        " that are pinned; at most half of it may be, " + std::to_string(most) + " bytes (" + option +
                                        "). Unpin others, or pin less"};
}

}  // namespace

std::vector<StoredTerm> TermStore::list() const {
  std::map<Hash128, StoredTerm> rows;
  // The disk first: what goes there meanwhile is still in memory then.
  if (disk_)
    for (StoredTerm& row : disk_->list()) rows[row.key] = std::move(row);
  std::lock_guard hold(mutex_);
  for (const Entries* entries : {&lru_, &pinned_})
    for (const Entry& e : *entries) {
      StoredTerm& row = rows[e.key];
      row.key = e.key;
      row.type = e.term->type();
      if (!e.note.label.empty()) row.note = e.note;
      row.bytes = e.bytes;
      row.used = std::max(row.used, e.used);
      row.pinned = row.pinned || e.pinned;
    }
  std::vector<StoredTerm> out;
  out.reserve(rows.size());
  for (auto& [key, row] : rows) out.push_back(std::move(row));
  return out;
}

std::vector<StoredTerm> TermStore::evict(const std::function<bool(const StoredTerm&)>& fits, bool disk, bool pinned) {
  std::lock_guard changing(pinning_);
  std::vector<StoredTerm> rows = thoseOf(list(), [&](const StoredTerm& row) { return (pinned || !row.pinned) && (row.bytes > 0 || disk) && fits(row); });
  std::vector<TermPtr> gone;
  {
    std::lock_guard hold(mutex_);
    for (StoredTerm& row : rows) {
      if (const auto at = index_.find(row.key); at != index_.end()) remove(at->second, gone);
      else row.bytes = 0;
      if (disk || row.diskBytes == 0) pins_.erase(row.key);
    }
  }
  std::vector<Hash128> keys;
  for (StoredTerm& row : rows) {
    if (!disk) row.diskBytes = 0;
    if (row.diskBytes > 0) keys.push_back(row.key);
  }
  if (!keys.empty()) disk_->erase(keys);
  return rows;
}

Result<std::vector<StoredTerm>> TermStore::pin(const std::function<bool(const StoredTerm&)>& fits) {
  std::lock_guard changing(pinning_);
  std::vector<StoredTerm> rows = thoseOf(list(), fits);
  const uint64_t most = maxBytes_ / 2;
  {
    std::lock_guard hold(mutex_);
    uint64_t want = 0;
    for (const StoredTerm& row : rows)
      if (row.diskBytes == 0 && !row.pinned) want += row.bytes;
    if (want > 0 && pinnedBytes_ + want > most) return tooManyPins("in memory", "engine.store_bytes", want, pinnedBytes_, most);
  }
  std::vector<Hash128> onDisk;
  for (const StoredTerm& row : rows)
    if (row.diskBytes > 0) onDisk.push_back(row.key);
  if (!onDisk.empty()) GOBO_TRY(disk_->pin(onDisk, true));
  std::lock_guard hold(mutex_);
  // Those that have no file come first: the others are kept by theirs.
  for (const bool file : {false, true})
    for (StoredTerm& row : rows) {
      if ((row.diskBytes > 0) != file) continue;
      const auto at = index_.find(row.key);
      const bool room = at != index_.end() && (at->second->pinned || pinnedBytes_ + at->second->bytes <= most);
      row.pinned = file || room;  // else it went while the disk was written
      if (!row.pinned) continue;
      pins_.insert(row.key);
      if (room) setPinned(at->second, true);
    }
  return thoseOf(std::move(rows), [](const StoredTerm& row) { return row.pinned; });
}

Result<std::vector<StoredTerm>> TermStore::unpin(const std::function<bool(const StoredTerm&)>& fits) {
  std::lock_guard changing(pinning_);
  std::vector<StoredTerm> rows = thoseOf(list(), [&](const StoredTerm& row) { return row.pinned && fits(row); });
  std::vector<Hash128> onDisk;
  for (const StoredTerm& row : rows)
    if (row.diskBytes > 0) onDisk.push_back(row.key);
  if (!onDisk.empty()) GOBO_TRY(disk_->pin(onDisk, false));
  std::lock_guard hold(mutex_);
  for (StoredTerm& row : rows) {
    if (const auto at = index_.find(row.key); at != index_.end()) setPinned(at->second, false);
    pins_.erase(row.key);
    row.pinned = false;
  }
  return rows;
}

uint64_t TermStore::pinnedBytes() const {
  std::lock_guard hold(mutex_);
  return pinnedBytes_;
}

uint64_t TermStore::pinnedDiskBytes() const { return disk_ ? disk_->pinnedBytes() : 0; }
uint64_t TermStore::maxDiskBytes() const { return disk_ ? disk_->maxBytes() : 0; }

}  // namespace plan
}  // namespace gobo
