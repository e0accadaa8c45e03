// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/store_looks.h"

#include <algorithm>

namespace gobo {
inline namespace jobs {

uint64_t StoreLooks::number(uint64_t version) {
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  if (version <= asked_ && now < next_) return number_;
  const Result<std::string> edition = store_.edition();
  asked_ = std::max(asked_, version);
  next_ = now + std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(kEvery));
  if (edition.ok() && *edition == edition_) return number_;
  edition_ = edition.ok() ? *edition : std::string();
  return ++number_;
}

}  // namespace jobs
}  // namespace gobo
