// SPDX-License-Identifier: Apache-2.0
// MemoryLedger: what a process holds, kind by kind and caller by caller, under one total. Holders count for themselves; the ledger asks them, so
// that nothing is counted twice and nothing can be forgotten to be given back. Thread-safe.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace base {

using BytesOfCallers = std::map<std::string, uint64_t>;  ///< "": everybody's

struct MemoryHolder {
  std::string name;
  std::function<uint64_t()> limit;  ///< its own bound
  std::function<uint64_t()> bytes;
  /// Gives up what nobody uses until it holds at most so much, or has nothing more to give. Empty: gives nothing.
  std::function<void(uint64_t most)> shrink = {};
  std::function<BytesOfCallers()> callers = {};  ///< empty: what it holds belongs to nobody in particular
};

class MemoryLedger {
 public:
  explicit MemoryLedger(uint64_t total = UINT64_MAX) : total_(total) {}
  /// Asked for as long as what is returned lives. Those that were added first give first. Its functions may not call the ledger.
  [[nodiscard]] std::shared_ptr<const MemoryHolder> add(MemoryHolder holder);
  uint64_t total() const { return total_; }
  uint64_t held() const;
  /// Room for `more` bytes below the total: holders shrink as far as that needs. Not to be called under a lock that a holder's functions take.
  /// Errors: ResourceExhausted that says what holds how much, once everything that could go has gone.
  Status makeRoom(uint64_t more, const std::string& what);
  /// The same after something has grown.
  void settle() { (void)makeRoom(0, ""); }
  std::vector<std::shared_ptr<const MemoryHolder>> holders() const;

 private:
  const uint64_t total_;
  mutable std::mutex mutex_;  // holders_
  std::mutex shrinking_;      // one at a time: two would both take what one needs
  std::vector<std::weak_ptr<const MemoryHolder>> holders_;
};

}  // namespace base
}  // namespace gobo
