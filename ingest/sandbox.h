// SPDX-License-Identifier: Apache-2.0
// What gobo-ingest gives up before it reads a byte from outside. One way: nothing here can be undone.
#pragma once

#include "base/status.h"
#include "ingest/wire.h"

namespace gobo::ingest {

/// Library state that would start threads or open files later: OpenImageIO and OpenEXR use the calling thread only.
/// Loading the codec of pictures is nearly all that it takes; a reader without it can read none.
void prepareLibraries(bool withCodec);

/// Namespaces and Landlock as far as the machine has them (layers.h; `layers` says which); core files off, no new privileges, death
/// with the parent, every descriptor but 0-4 closed; limits of the job (address
/// space, CPU seconds, size of the output, no new descriptors); then a seccomp filter: an allow-list of system calls for
/// memory, the descriptors that are open, time and leaving. Looking at files answers EPERM (libraries probe for their
/// configuration), and so does making threads; every other call, sockets and exec among them, kills the process (SIGSYS).
/// Memory can no longer become executable. Errors: Internal; the caller must leave then.
Status lockDown(const Job& job, Layers& layers);

}  // namespace gobo::ingest
