// SPDX-License-Identifier: Apache-2.0
// Shared objects of this build that are loaded when they are first needed, because what they link costs a program's start more than the program
// (renderer/codec, renderer/color).
#pragma once

#include "base/status.h"

namespace gobo {
inline namespace base {

/// What `name` ("libgobo_color.so") exports as `symbol`, for as long as the process lives. It is looked for by the program's place (beside it, in the build
/// folder, installed), then by the search path. Internal when it cannot be loaded: "`what` cannot be loaded: " and why. Thread-safe.
Result<const void*> sharedSymbol(const char* name, const char* symbol, const char* what);

}  // namespace base
}  // namespace gobo
