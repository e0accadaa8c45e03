// SPDX-License-Identifier: Apache-2.0
#include "plan/source_digest.h"

#ifndef GOBO_SOURCE_DIGEST  // else cmake/source_digest.cmake wrote it
namespace gobo::inline plan {
std::string_view sourceDigest() { return {}; }
}  // namespace gobo::inline plan
#endif
