// SPDX-License-Identifier: Apache-2.0
#include "base/memory_ledger.h"

#include <algorithm>

namespace gobo {
inline namespace base {

namespace {
constexpr int kPasses = 16;

/// Sums that cannot wrap: bounds may be "as much as there is".
uint64_t plus(uint64_t a, uint64_t b) { return a > UINT64_MAX - b ? UINT64_MAX : a + b; }
}  // namespace

std::shared_ptr<const MemoryHolder> MemoryLedger::add(MemoryHolder holder) {
  auto added = std::make_shared<const MemoryHolder>(std::move(holder));
  const std::lock_guard lock(mutex_);
  std::erase_if(holders_, [](const auto& h) { return h.expired(); });
  holders_.push_back(added);
  return added;
}

std::vector<std::shared_ptr<const MemoryHolder>> MemoryLedger::holders() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<const MemoryHolder>> out;
  for (const auto& weak : holders_)
    if (auto holder = weak.lock()) out.push_back(std::move(holder));
  return out;
}

uint64_t MemoryLedger::held() const {
  uint64_t sum = 0;
  for (const auto& h : holders()) sum = plus(sum, h->bytes());
  return sum;
}

Status MemoryLedger::makeRoom(uint64_t more, const std::string& what) {
  if (total_ == UINT64_MAX) return {};
  const auto over = [&]() -> uint64_t {
    const uint64_t sum = plus(held(), more);  // once: others give back meanwhile
    return sum > total_ ? sum - total_ : 0;
  };
  if (over() == 0) return {};
  const std::lock_guard one(shrinking_);
  const auto all = holders();
  // Several times: others may grow meanwhile.
  for (int pass = 0; pass < kPasses; ++pass)
    for (const auto& h : all) {
      const uint64_t missing = over();
      if (missing == 0) return {};
      if (!h->shrink) continue;
      const uint64_t has = h->bytes();
      h->shrink(has > missing ? has - missing : 0);
    }
  if (over() == 0) return {};
  std::vector<std::pair<uint64_t, std::string>> largest;
  for (const auto& h : all) largest.push_back({h->bytes(), h->name});
  std::sort(largest.rbegin(), largest.rend());
  std::string said;
  for (size_t i = 0; i < largest.size() && i < 3 && largest[i].first > 0; ++i)
    said += (i ? ", " : "") + largest[i].second + " " + std::to_string(largest[i].first);
  return {Code::ResourceExhausted, "no room for " + what + " of " + std::to_string(more) + " bytes: in use are " + (said.empty() ? "none" : said) +
                                       "; at most " + std::to_string(total_) + " together (engine.memory_bytes)"};
}

}  // namespace base
}  // namespace gobo
