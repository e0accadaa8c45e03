// SPDX-License-Identifier: Apache-2.0
#include "base/mapped_faults.h"

#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>

namespace gobo {
inline namespace base {
namespace {

static_assert(std::atomic<uintptr_t>::is_always_lock_free && std::atomic<uint32_t>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

// Blocks are added, never taken away: the handler may be in any of them.
struct Block {
  MappedRange ranges[256];
  std::atomic<Block*> next{nullptr};
};
Block first;
std::mutex changing;  // who adds and removes; the handler takes no lock

struct sigaction before {};  // written before the handler is in place
std::atomic<bool> installed{false};
std::atomic<void (*)(int)> otherwise{nullptr};

/// Puts zeroes over the range that holds `at`; false if there is none.
bool cover(uintptr_t at) {
  for (Block* block = &first; block; block = block->next.load())
    for (MappedRange& range : block->ranges) {
      const uint32_t version = range.version.load();
      const uintptr_t begin = range.begin.load(), end = range.end.load();
      if (at < begin || at >= end || version % 2 != 0 || range.version.load() != version) continue;
      range.broken.store(true);  // before anybody can read a zero
      // The call itself: a sanitizer's mmap() keeps books, which a handler may not.
      const long page = ::sysconf(_SC_PAGESIZE), bytes = long(end - begin + uintptr_t(page) - 1) / page * page;
      return ::syscall(SYS_mmap, begin, bytes, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED | MAP_NORESERVE, -1, 0) == long(begin);
    }
  return false;
}

void onBusError(int signal, siginfo_t* info, void* context) {
  const int error = errno;
  const bool covered = info->si_code > 0 && cover(reinterpret_cast<uintptr_t>(info->si_addr));  // > 0: of the kernel
  errno = error;
  if (covered) return;
  if ((before.sa_flags & SA_SIGINFO) && before.sa_sigaction) return before.sa_sigaction(signal, info, context);
  if (before.sa_handler != SIG_DFL && before.sa_handler != SIG_IGN) return before.sa_handler(signal);
  if (void (*then)(int) = otherwise.load()) return then(signal);
  ::signal(signal, SIG_DFL);
  ::raise(signal);  // comes when this handler has returned
}

void install() {  // under `changing`
  if (installed.load() || ::sigaction(SIGBUS, nullptr, &before) != 0) return;
  struct sigaction wanted {};
  wanted.sa_sigaction = onBusError;
  wanted.sa_flags = SA_SIGINFO | SA_ONSTACK;
  installed.store(::sigaction(SIGBUS, &wanted, nullptr) == 0);
}

MappedRange* freeRange() {  // under `changing`
  for (Block* block = &first;; block = block->next.load()) {
    for (MappedRange& range : block->ranges)
      if (range.begin.load() == 0) return &range;
    if (!block->next.load()) block->next.store(new Block);
  }
}

void set(MappedRange& range, uintptr_t begin, uintptr_t end) {
  range.version.fetch_add(1);
  range.begin.store(begin);
  range.end.store(end);
  range.broken.store(false);
  range.version.fetch_add(1);
}

}  // namespace

MappedRange* watchMapped(const void* begin, size_t bytes) {
  const std::lock_guard lock(changing);
  install();
  MappedRange* range = freeRange();
  set(*range, reinterpret_cast<uintptr_t>(begin), reinterpret_cast<uintptr_t>(begin) + bytes);
  return range;
}

void unwatchMapped(MappedRange* range) {
  const std::lock_guard lock(changing);
  set(*range, 0, 0);
}

bool runOnOtherBusError(void (*then)(int)) {
  const std::lock_guard lock(changing);
  struct sigaction now {};
  if (!installed.load() || ::sigaction(SIGBUS, nullptr, &now) != 0 || !(now.sa_flags & SA_SIGINFO) || now.sa_sigaction != onBusError) return false;
  otherwise.store(then);
  return true;
}

}  // namespace base
}  // namespace gobo
