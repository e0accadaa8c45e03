// SPDX-License-Identifier: Apache-2.0
// Names and secrets that nobody can guess.
#pragma once

#include <optional>
#include <string>

namespace gobo::inline server {

/// Twice as many lower-case hex digits, from the kernel's generator; nothing if it has none.
std::optional<std::string> randomHex(size_t bytes);

}  // namespace gobo::inline server
