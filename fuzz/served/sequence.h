// SPDX-License-Identifier: Apache-2.0
// Calls of several clients on one daemon, in any order and at the same time. A call is four bytes: who calls (and whether beside the calls
// before it), which method of the schema, how (given up at once, in the middle, or read to its end; the messages of a stream), how many edits
// (message_edits.h) its request gets; then these, of 10 bytes each. What one client calls comes one after the other.
#pragma once

#include <span>

#include <grpcpp/grpcpp.h>

#include "fuzz/properties.h"

namespace gobo::fuzz {

/// Answers that docs/protocol.md has for what a client may have done: not those of a fault of the server.
std::span<const grpc::StatusCode> documentedCodes();

/// Every answer is such a code, in time. Nobody is shown, nor may use, what is another client's: scenes, render ids, jobs. A picture is, bit for
/// bit, that of an engine that has nothing yet. At the end everything can be unloaded and deleted, and the memory that the daemon says it holds
/// is what caches may hold.
Outcome trySequence(Bytes bytes);

}  // namespace gobo::fuzz
