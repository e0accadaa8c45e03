// SPDX-License-Identifier: Apache-2.0
// What becomes of SIGBUS under a mapped file (MappedFile): the range is marked as broken, and zeroes are put over all of it, so that whoever
// touched it goes on. All of it and not the page alone: a file that was emptied would otherwise fault once a page, and each patch would
// be a mapping of its own, of which a process has 65530. Zeroes are valid wherever a checked blob is read: indices are in range, numbers finite.
// The table is read by the handler without a lock. A SIGBUS elsewhere, or one that somebody sent, goes to whoever had the signal before.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace gobo {
inline namespace base {

/// A place in the table. `version` is odd while the others change: the handler passes it over then, since a range that is being
/// added or removed is one that nobody reads yet or any more.
struct MappedRange {
  std::atomic<uint32_t> version{0};
  std::atomic<uintptr_t> begin{0}, end{0};  // 0: free
  std::atomic<bool> broken{false};
};

/// From now on faults in these bytes, which are mapped, are survived. Installs the handler, once in a process.
MappedRange* watchMapped(const void* begin, size_t bytes);
/// Before the bytes are unmapped; nobody may read them any more.
void unwatchMapped(MappedRange* range);
/// What is run on a SIGBUS that is no mapped file's where nobody else had the signal before. Async-signal-safe. Whether the handler here is in
/// place to run it: if not, the caller installs its own.
bool runOnOtherBusError(void (*then)(int signal));

}  // namespace base
}  // namespace gobo
