// SPDX-License-Identifier: Apache-2.0
#include "server/freed_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>

namespace gobo {
inline namespace server {

namespace {
constexpr std::chrono::seconds kEvery{1};

/// Free in malloc's arenas and resident: malloc counts pages that were given back as free too.
uint64_t leftover() {
  uint64_t total = 0, resident = 0, shared = 0;
  std::ifstream("/proc/self/statm") >> total >> resident >> shared;
  const uint64_t own = (resident - std::min(resident, shared)) * uint64_t(::sysconf(_SC_PAGESIZE));  // of no file
  const struct mallinfo2 info = ::mallinfo2();
  return std::min<uint64_t>(info.fordblks, own - std::min<uint64_t>(own, info.uordblks + info.hblkhd));
}
}  // namespace

uint64_t FreedMemory::keepOf(uint64_t total) { return std::clamp<uint64_t>(total / 16, 64ull << 20, 1ull << 30); }

void FreedMemory::boundMalloc() {
  ::mallopt(M_MMAP_THRESHOLD, 8 << 20);
  ::mallopt(M_TRIM_THRESHOLD, 16 << 20);  // the end of an arena; would be 128 KiB once the other is fixed
}

void FreedMemory::start() {
  looking_.start(kEvery, [this] { look(); });
}

uint64_t FreedMemory::look() {
  const uint64_t before = leftover();
  stuck_ = std::min(stuck_, before);
  if (before <= keep_ || before - stuck_ <= keep_ / 4) return 0;
  ::malloc_trim(0);
  stuck_ = leftover();
  return before - std::min(before, stuck_);
}

}  // namespace server
}  // namespace gobo
