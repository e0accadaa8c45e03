// SPDX-License-Identifier: Apache-2.0
// Things that the sandbox must stop, tried on purpose after lockDown: the tests' (and `gobo-ingest --probe NAME`'s) proof. The daemon
// never sends such a job.
#pragma once

#include <string>

#include "base/status.h"

namespace gobo::ingest {

/// Tries `what`: open, create, socket, exec, fork, thread, kill, ptrace, mmap-exec, descriptor (answers FailedPrecondition "denied: errno text"
/// where the sandbox refuses, Internal "NOT denied" where it does not; some kill the process instead); segv, abort, spin, sleep,
/// allocate, write (run into a limit); silent (leaves without a word), babble (breaks the protocol).
Status probe(const std::string& what);

}  // namespace gobo::ingest
