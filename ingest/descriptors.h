// SPDX-License-Identifier: Apache-2.0
// Descriptors on their way through a Unix socket, with a byte that carries them.
#pragma once

#include <array>

namespace gobo::ingest {

/// Socket, output and life line of a reader (nursery.h).
using ReaderDescriptors = std::array<int, 3>;

/// Does not wait: false when the other end is gone, or takes none.
bool sendDescriptors(int socket, const ReaderDescriptors& descriptors);
/// Waits. False: the other end is gone. -1 in each: they could not be had here, and the other end sees its own ends close.
bool receiveDescriptors(int socket, ReaderDescriptors& descriptors);

}  // namespace gobo::ingest
