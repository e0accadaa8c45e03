// SPDX-License-Identifier: Apache-2.0
#include "plan/extension_index.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace gobo {
inline namespace plan {

void ExtensionIndex::add(const Hash128& recipe, uint32_t blocks) {
  std::lock_guard lock(mutex_);
  std::set<uint32_t>& counts = counts_.touch(recipe);
  counts.insert(blocks);
  if (counts.size() > kCounts) counts.erase(counts.begin());
}

std::vector<uint32_t> ExtensionIndex::below(const Hash128& recipe, uint32_t blocks) const {
  std::lock_guard lock(mutex_);
  std::vector<uint32_t> out;
  const std::set<uint32_t>* counts = counts_.find(recipe);
  if (!counts) return out;
  for (auto c = counts->rbegin(); c != counts->rend(); ++c)
    if (*c < blocks) out.push_back(*c);
  return out;
}

void ExtensionIndex::drop(std::list<Parked>::iterator parked, std::list<Parked>& gone) {
  bytes_ -= parked->state->bytes();
  gone.splice(gone.end(), parked_, parked);
}

void ExtensionIndex::park(const Hash128& recipe, uint32_t blocks, TermPtr state) {
  std::list<Parked> gone;
  const std::lock_guard lock(mutex_);
  size_t alike = 0;
  auto least = parked_.end();  // of this recipe
  for (auto p = parked_.begin(); p != parked_.end();) {
    const auto here = p++;
    if (here->recipe != recipe) continue;
    if (here->blocks == blocks) {
      drop(here, gone);
      continue;
    }
    ++alike;
    if (least == parked_.end() || here->blocks < least->blocks) least = here;
  }
  if (alike >= kParkedOfRecipe) {
    if (blocks < least->blocks) return;  // this one got least far
    drop(least, gone);
  }
  bytes_ += state->bytes();
  parked_.push_back({recipe, blocks, std::move(state)});
  while (parked_.size() > kParked || (bytes_ > parkedBytes_ && parked_.size() > 1)) drop(parked_.begin(), gone);
}

TermPtr ExtensionIndex::takeParked(const Hash128& recipe, uint32_t blocks) {
  std::list<Parked> taken;
  const std::lock_guard lock(mutex_);
  auto best = parked_.end();
  for (auto p = parked_.begin(); p != parked_.end(); ++p)
    if (p->recipe == recipe && p->blocks <= blocks && (best == parked_.end() || p->blocks > best->blocks)) best = p;
  if (best == parked_.end()) return nullptr;
  drop(best, taken);
  return std::move(taken.front().state);
}

uint64_t ExtensionIndex::parkedBytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

void ExtensionIndex::shrinkParked(uint64_t most) {
  std::list<Parked> gone;
  const std::lock_guard lock(mutex_);
  while (bytes_ > most && !parked_.empty()) drop(parked_.begin(), gone);
}

void ExtensionIndex::clear() {
  std::list<Parked> gone;
  const std::lock_guard lock(mutex_);
  counts_.clear();
  gone.swap(parked_);
  bytes_ = 0;
}

}  // namespace plan
}  // namespace gobo
