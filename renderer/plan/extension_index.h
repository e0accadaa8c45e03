// SPDX-License-Identifier: Apache-2.0
// ExtensionIndex: what an engine knows of renders that can be gone on with: which sample counts of a recipe were made, and the states of those
// that were stopped. Hints only: losing them costs time, never correctness. Bounded, the latest stay. Thread-safe.
#pragma once

#include <cstdint>
#include <list>
#include <mutex>
#include <set>
#include <vector>

#include "base/hash.h"
#include "base/latest_map.h"
#include "terms/term.h"

namespace gobo {
inline namespace plan {

class ExtensionIndex {
 public:
  /// `parkedBytes`: of stopped states together. A single one may be larger: without it a large render that is preempted again and again would never end.
  explicit ExtensionIndex(uint64_t parkedBytes = UINT64_MAX) : parkedBytes_(parkedBytes) {}

  void add(const Hash128& recipe, uint32_t blocks);
  /// Known counts below `blocks`, largest first.
  std::vector<uint32_t> below(const Hash128& recipe, uint32_t blocks) const;

  /// Of a run towards `blocks` that was stopped.
  void park(const Hash128& recipe, uint32_t blocks, TermPtr state);
  /// The one that was to get furthest of those towards at most `blocks`; one towards more stays for whoever asked for it. Null: there is none.
  TermPtr takeParked(const Hash128& recipe, uint32_t blocks);
  uint64_t parkedLimit() const { return parkedBytes_; }
  uint64_t parkedBytes() const;
  /// Drops stopped states, the oldest first, until they hold at most `most` bytes.
  void shrinkParked(uint64_t most);

  void clear();

 private:
  static constexpr size_t kRecipes = 4096, kCounts = 256, kParked = 32, kParkedOfRecipe = 2;  // kCounts: of a recipe
  struct Parked {
    Hash128 recipe;
    uint32_t blocks = 0;
    TermPtr state;
  };
  /// Under mutex_. Into `gone`, which is freed after it: pictures are large.
  void drop(std::list<Parked>::iterator parked, std::list<Parked>& gone);

  const uint64_t parkedBytes_;
  mutable std::mutex mutex_;
  LatestMap<Hash128, std::set<uint32_t>> counts_{kRecipes};
  std::list<Parked> parked_;  // the oldest first
  uint64_t bytes_ = 0;        // of parked_
};

}  // namespace plan
}  // namespace gobo
