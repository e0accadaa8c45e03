// SPDX-License-Identifier: Apache-2.0
#include "plan/source_digest.h"

#ifndef GOBO_SOURCE_DIGEST  // else cmake/source_digest.cmake wrote it
namespace gobo {
inline namespace plan {
std::string_view sourceDigest() { return {}; }
}  // namespace plan
}  // namespace gobo
#endif
