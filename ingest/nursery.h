// SPDX-License-Identifier: Apache-2.0
// The nursery: gobo-ingest with its libraries loaded, which forks a reader for each file. Loading them costs 0.4 s of processor, a fork
// 3 ms. It reads nothing that comes from outside; each reader still goes behind its own sandbox and ends after one file.
#pragma once

#include <cstdint>

namespace gobo::ingest {

constexpr int32_t kTakenIn = -1;  ///< no wait status

/// Serves requests of the daemon on `control` (a SOCK_SEQPACKET): one byte with three descriptors, which are the reader's socket, its output
/// and its life line. kTakenIn is written to the life line when the reader's guard lives, and its wait status (int32) when it has ended; a life
/// line that the daemon shuts ends the reader. Returns in each reader, with descriptors 3 and 4 in their places (wire.h); ends the process when the daemon is
/// gone. To be called in a process of one thread.
void tendReaders(int control);

}  // namespace gobo::ingest
