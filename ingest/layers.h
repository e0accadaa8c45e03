// SPDX-License-Identifier: Apache-2.0
// Layers around the reader of files beside its seccomp filter, each of which must be broken on its own: namespaces in which there is no
// file, no network and no other process's IPC, and Landlock. A machine that lacks one (containers often forbid user namespaces, old
// kernels have no Landlock) costs that layer, never the load.
#pragma once

#include "ingest/wire.h"

namespace gobo::ingest {

/// A user namespace of its own, which gives the right to the other ones. Before any library starts a thread: needs a process of one.
void enterUserNamespace(Layers& layers);

/// Leaves the machine's namespaces: mount with an empty read-only root, network without an interface, IPC, UTS; then gives all
/// capabilities up. No PID namespace: the reader would
/// be its init, to which the kernel does not send the signals of its limits and faults, and it hides only what the filter keeps
/// out of reach anyway (kill, ptrace, /proc). What is open stays open.
void enterNamespaces(Layers& layers);

/// Landlock without a rule: every right that the kernel's version of it knows is denied, on files, TCP ports, abstract sockets and
/// signals. Sets no_new_privs.
void denyFiles(Layers& layers);

}  // namespace gobo::ingest
