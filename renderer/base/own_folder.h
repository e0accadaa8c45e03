// SPDX-License-Identifier: Apache-2.0
// Own folders: those whose files are believed without another look, because nobody else can have written them: the term store, the
// blob cache, the jobs folder. Such a folder must belong to this user and be writable by no other; a link on the way must be this
// user's or root's; and nobody else may be able to put another folder in its place, so the folders above it are writable by no other
// either, unless they are sticky (/tmp). Above it, write access of a group counts only if the group is neither root's nor this
// process's own (a private group with umask 002). Access lists beyond the mode are not looked at. Functions are thread-safe.
#pragma once

#include <string>

#include "base/status.h"

namespace gobo {
inline namespace base {

/// FailedPrecondition when `folder` is not an own folder, naming it, what is wrong and the remedy; `what` begins the message ("blob
/// cache"). Other errors: it cannot be examined.
Status checkOwnFolder(const std::string& folder, const std::string& what);

/// Makes it (mode 0700; missing folders above it 0755) unless it is there, then checkOwnFolder(). Other errors: NotFound,
/// PermissionDenied (also a read-only file system), ResourceExhausted, Unavailable.
Status makeOwnFolder(const std::string& folder, const std::string& what);

}  // namespace base
}  // namespace gobo
